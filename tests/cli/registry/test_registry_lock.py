"""``registry lock`` and ``extract --locked``: a run repeated on the entries it rested on, or refused."""

from __future__ import annotations

import json
import shutil
from datetime import date
from inspect import signature
from pathlib import Path
from typing import Any

import pytest

from calibrary.cli.main import build_parser, main
from calibrary.jobs.fleet import Fleet
from calibrary.records import replace
from calibrary.registry.entry import Status, Validity
from calibrary.registry.locking import LOCK_FILE, read_lock
from tests.cli.registry.direct import put
from tests.cli.registry.fleets import P4R, add, printed, run, xml
from tests.jobs.extract.fleet import picture
from tests.registry.entries import an_entry
from tests.registry.git.repositories import git

ENTRY = an_entry(focal_mm=None)
TAGS: dict[str, Any] = {"make": "DJI", "model": "FC6310R"}


@pytest.fixture(autouse=True)
def flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A flight whose images tell a camera and no K, in the folder that the commands run in."""
    monkeypatch.chdir(tmp_path)
    picture(tmp_path / "flight/a.jpg", **TAGS)
    return tmp_path / "flight"


def extracted(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, float | None, str]:
    """The exit code, fx, and what was said to people."""
    capsys.readouterr()
    code = main(["extract", "--image-dir", "flight", "--dry-run", "--json", *map(str, arguments)])
    said = capsys.readouterr()
    fx = None
    if said.out:
        [camera] = json.loads(said.out)["cameras"]
        fallback = camera.get("calibration")
        fx = fallback["intrinsics"]["fx"] if fallback is not None else None
    # Notes are wrapped to the terminal.
    return code, fx, " ".join(said.err.split())


def test_the_default_place_is_the_one_that_extract_looks_at() -> None:
    assert signature(Fleet.lock).parameters["out"].default == LOCK_FILE
    assert build_parser().parse_args(["extract", "--locked"]).locked == LOCK_FILE


class TestLock:
    def test_every_entry_in_use_is_pinned_at_the_commit(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put(fleet, ENTRY, an_entry(model="Draft", status=Status.DRAFT))
        commit = put(fleet, an_entry(model="Other"))
        document = printed(capsys, "lock-1", "lock")
        written = read_lock(Path("calibrary.lock"))
        assert [pin.path for pin in written.pins] == sorted([ENTRY.path, an_entry(model="Other").path])
        assert (written.commit, written.registry) == (commit, "fleet")
        assert document["commit"] == commit
        assert written.pins[0].blob == git(fleet, "rev-parse", f"HEAD:{written.pins[0].path}")

    def test_a_flight_pins_what_answers_for_its_images(
        self, fleet: Path, flight: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put(fleet, ENTRY, an_entry(model="Other"))
        picture(flight / "b.jpg", make="Nobody", model="Knows")
        code, out, err = run(capsys, "lock", "flight", "--out", "flight.lock")
        assert (code, out.startswith("flight.lock: 1 entry pinned at ")) == (0, True)
        assert [pin.path for pin in read_lock(Path("flight.lock")).pins] == [ENTRY.path]
        assert "no entry applies to Nobody Knows" in err

    def test_keys_pin_what_they_name(self, fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
        put(fleet, ENTRY, an_entry(model="Other"))
        assert run(capsys, "lock", "dji/other")[0] == 0
        assert [pin.path for pin in read_lock(Path("calibrary.lock")).pins] == [an_entry(model="Other").path]

    def test_the_same_state_gives_the_same_bytes(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put(fleet, ENTRY)
        run(capsys, "lock")
        first = Path("calibrary.lock").read_bytes()
        run(capsys, "lock")
        assert Path("calibrary.lock").read_bytes() == first

    @pytest.mark.usefixtures("fleet")
    @pytest.mark.parametrize(("what", "code"), [([], 4), (["nobody/here"], 4)])
    def test_nothing_to_pin_is_an_error_and_no_empty_lock(
        self, capsys: pytest.CaptureFixture[str], what: list[str], code: int
    ) -> None:
        assert run(capsys, "lock", *what)[0] == code
        assert not Path("calibrary.lock").exists()


class TestLockedRun:
    def test_it_rests_on_what_was_pinned_and_tells_what_has_become_of_it(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put(fleet, ENTRY)
        run(capsys, "lock")
        put(fleet, an_entry(focal_mm=None, fx=3700.0))
        code, fx, err = extracted(capsys, "--registry", fleet, "--locked")
        assert (code, fx) == (0, 3661.25)
        assert f"{ENTRY.path} was changed" in err
        assert extracted(capsys, "--registry", fleet)[1] == 3700.0

    def test_an_entry_that_was_retired_since_is_told_with_its_reason(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put(fleet, ENTRY)
        run(capsys, "lock")
        put(fleet, replace(ENTRY, status=Status.RETIRED, reason="lens was swapped"))
        code, fx, err = extracted(capsys, "--registry", fleet, "--locked")
        assert (code, fx) == (0, 3661.25)
        assert "was retired (lens was swapped)" in err

    def test_an_earlier_period_gets_its_k_as_the_pinned_commit_has_it(
        self, fleet: Path, flight: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        spring, autumn = Validity(first=date(2026, 3, 1)), Validity(first=date(2026, 9, 1))
        put(fleet, replace(ENTRY, validity=spring))
        put(fleet, an_entry(focal_mm=None, fx=3670.0, validity=autumn))
        run(capsys, "lock")
        put(fleet, an_entry(focal_mm=None, fx=3680.0, validity=autumn))
        for taken, expected in (("2026:05:05", 3661.25), ("2026:10:10", 3670.0)):
            picture(flight / "a.jpg", **TAGS, date_time=f"{taken} 12:00:00")
            code, fx, _ = extracted(capsys, "--registry", fleet, "--locked")
            assert (code, fx) == (0, expected)

    def test_a_bare_registry_is_read_alike(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put(fleet, ENTRY)
        run(capsys, "lock")
        put(fleet, an_entry(focal_mm=None, fx=3700.0))
        git(tmp_path, "clone", "--quiet", "--bare", str(fleet), "bare.git")
        assert extracted(capsys, "--registry", "bare.git", "--locked")[:2] == (0, 3661.25)
        assert extracted(capsys, "--registry", "bare.git")[:2] == (0, 3700.0)

    def test_a_registry_that_has_lost_the_commit_is_refused(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put(fleet, ENTRY)
        run(capsys, "lock")
        put(fleet, an_entry(focal_mm=None, fx=3700.0))
        git(tmp_path, "clone", "--quiet", "--depth=1", f"file://{fleet}", "shallow")
        code, _, err = extracted(capsys, "--registry", "shallow", "--locked")
        assert code == 4
        assert "fetch --unshallow" in err

    def test_a_lock_that_was_tampered_with_is_refused(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        first = put(fleet, ENTRY)
        second = put(fleet, an_entry(focal_mm=None, fx=3700.0))
        run(capsys, "lock")
        file = Path("calibrary.lock")
        file.write_text(file.read_text().replace(second, first))
        code, _, err = extracted(capsys, "--registry", fleet, "--locked")
        assert (code, "the registry differs from" in err) == (4, True)

    def test_a_plain_folder_that_changed_is_refused(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put(fleet, ENTRY)
        shutil.copytree(fleet / "cameras", tmp_path / "plain/cameras")
        assert run(capsys, "lock", "--registry", f"folder:{tmp_path / 'plain'}")[0] == 0
        assert extracted(capsys, "--registry", "folder:plain", "--locked")[:2] == (0, 3661.25)
        file = tmp_path / "plain" / ENTRY.path
        file.write_text(file.read_text() + 'notes: ["a scratch"]\n')
        code, _, err = extracted(capsys, "--registry", "folder:plain", "--locked")
        assert (code, "the registry differs from" in err) == (4, True)


class TestGitRegistryOfExtract:
    def test_what_is_committed_counts_and_what_is_not_is_told(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put(fleet, ENTRY)
        file = fleet / ENTRY.path
        assert extracted(capsys, "--registry", fleet) == (0, 3661.25, "")
        file.write_text(file.read_text().replace("3661.25", "9661.25"))
        code, fx, err = extracted(capsys, "--registry", fleet)
        assert (code, fx) == (0, 3661.25)
        assert f"{ENTRY.path} differs in its work tree and is not committed" in err

    def test_a_folder_of_entries_in_somebodys_repository_is_read_as_it_lies_where_it_is_named_so(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put(fleet, ENTRY)
        shutil.copytree(fleet / "cameras", tmp_path / "scripts/cameras")
        git(tmp_path, "init", "--quiet", "scripts")
        git(tmp_path / "scripts", "commit", "--quiet", "--allow-empty", "-m", "scripts")
        code, _, err = extracted(capsys, "--registry", "scripts")
        assert (code, "not a registry" in err) == (4, True)
        assert extracted(capsys, "--registry", "folder:scripts")[:2] == (0, 3661.25)

    def test_a_git_repository_of_something_else_is_no_registry(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        git(tmp_path, "init", "--quiet", "scripts")
        code, _, err = extracted(capsys, "--registry", "scripts")
        assert (code, "empty registry" in err) == (4, True)


def test_the_pinned_entry_is_the_one_that_extract_takes(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, ENTRY)
    run(capsys, "lock", "flight")
    [pin] = read_lock(Path("calibrary.lock")).pins
    assert pin.path.endswith(f"{P4R}.yaml")
    assert extracted(capsys, "--registry", fleet, "--locked")[:2] == (0, 3661.25)


def test_what_is_proposed_beside_it_is_mentioned_by_lock_export_and_extract(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, ENTRY)
    add(xml(tmp_path / "new.xml", f=3663.0))
    for words in (("lock",), ("export", "--to", "csv", "--out", "all.csv")):
        code, _, err = run(capsys, *words)
        assert (code, f"proposed and not approved, so not used: {P4R}" in " ".join(err.split())) == (
            0,
            True,
        ), words
    code, fx, err = extracted(capsys, "--registry", fleet)
    assert (code, fx, f"so not used: {P4R}" in err) == (0, 3661.25, True)
