"""``registry check``: every way in which an entry can be wrong, named by its path, in CI as by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.records import replace
from calibrary.registry.entry import UNSTATED, Alias, Entry, Status
from calibrary.registry.entry_yaml import entry_yaml
from tests.cli.registry.direct import put, put_bytes
from tests.cli.registry.fleets import printed, run
from tests.registry.entries import an_entry
from tests.registry.git.repositories import git

GOOD = an_entry()


def replaced(old: str, new: str, entry: Entry = GOOD) -> bytes:
    """An entry's file with one text changed by hand."""
    text = entry_yaml(entry).decode()
    assert old in text
    return text.replace(old, new, 1).encode()


def test_a_good_registry_is_good(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    commit = put(fleet, GOOD, an_entry(model="Other"))
    code, out, _ = run(capsys, "check")
    assert (code, out) == (0, f"good: 2 entries at {commit[:12]}: 0 errors, 0 warnings\n")
    document = printed(capsys, "registry-check-1", "check")
    assert (document["verdict"], document["entries"], document["commit"]) == ("good", 2, commit)


def test_a_rule_on_no_entry_is_a_warning(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put(fleet, GOOD)
    with (fleet / "registry.yaml").open("a") as rules:
        rules.write("repeat: [{of: dji/fc63lOr, months: 12}, {of: dji, months: 18}]\n")
    git(fleet, "commit", "-qam", "When to calibrate again")
    code, out, err = run(capsys, "check")
    assert code == 0
    assert (out + err).count("repeat: no KEY begins with dji/fc63lOr, so it says nothing") == 1
    assert "1 warning" in out
    assert "repeat: no KEY begins with dji/fc63lOr" in "".join(run(capsys, "check", "--worktree")[1:])


@pytest.mark.usefixtures("fleet")
def test_an_empty_registry_is_good(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "check")[0] == 0


@pytest.mark.parametrize(
    ("path", "data", "rule"),
    [
        (GOOD.path, replaced("fx: 3661.25", "fx: 3662.25"), "digest"),
        (GOOD.path, replaced('grade: "calibrated"', 'grade: "guessed"'), "entry"),
        (GOOD.path, b"\x00no yaml", "entry"),
        ("cameras/dji/elsewhere/1x1.yaml", entry_yaml(GOOD), "path"),
        (GOOD.path, entry_yaml(replace(GOOD, supersedes="dji/gone/1x1")), "supersedes"),
    ],
)
def test_one_line_says_where_and_what_to_do(
    fleet: Path, capsys: pytest.CaptureFixture[str], path: str, data: bytes, rule: str
) -> None:
    put_bytes(fleet, {path: data})
    code, out, _ = run(capsys, "check")
    said = [line for line in out.splitlines() if line.startswith(f"{path}: error: ")]
    findings = [line for line in said if not line.endswith("(approval)")]
    assert code == 1
    assert len(findings) == 1
    assert findings[0].endswith(f"({rule})")
    assert out.splitlines()[-1].startswith("bad: 1 entry at")


def test_the_policy_is_the_registrys_own_unless_another_is_named(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lopsided = an_entry(fx=3661.25)
    K = replace(lopsided.calibration.intrinsics, fy=3661.25 * 1.12)
    put(fleet, replace(lopsided, calibration=replace(lopsided.calibration, intrinsics=K)))
    strict = tmp_path / "strict.yaml"
    strict.write_text('schema: calibrary/policy-1\nname: "strict"\nbase: "fleet"\nfocal_symmetry_max: 0.05\n')
    assert run(capsys, "check")[0] == 0
    code, out, _ = run(capsys, "check", "--policy", strict)
    assert code == 1
    assert "fx" in out


class TestRange:
    """Only what a branch changes is judged, and what that means for the entries it meets."""

    def test_what_was_wrong_before_is_not_this_branchs_fault(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put_bytes(fleet, {"cameras/old/sin/1x1.yaml": b"no entry"})
        before = put(fleet, an_entry(model="Before"))
        put(fleet, GOOD)
        document = printed(capsys, "registry-check-1", "check", f"{before}..HEAD")
        assert (document["verdict"], document["entries"], document["before"]) == ("good", 1, before)
        assert run(capsys, "check")[0] == 1

    def test_an_entry_far_away_that_claims_its_name_is_met(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        before = put(fleet, an_entry(make="Zeta", aliases=(Alias(make="DJI", model="FC6310R"),)))
        put(fleet, GOOD)
        code, out, _ = run(capsys, "check", f"{before}..")
        assert code == 1
        assert "DJI FC6310R has entries of its own" in out

    def test_an_entry_that_supersedes_one_that_stands_is_good(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        old = an_entry(make="Alpha", status=Status.RETIRED, reason="worn")
        before = put(fleet, old)
        put(fleet, replace(GOOD, supersedes=old.id))
        assert run(capsys, "check", f"{before}..")[0] == 0

    @pytest.mark.parametrize("text", ["main", "..main", "a...b"])
    def test_what_is_no_range_says_what_is_one(
        self, fleet: Path, capsys: pytest.CaptureFixture[str], text: str
    ) -> None:
        put(fleet, GOOD)
        code, _, err = run(capsys, "check", text)
        assert code == 4
        assert "expected REV..REV" in err


def test_a_shallow_checkout_as_ci_makes_it_is_checked(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = put(fleet, GOOD)
    put(fleet, an_entry(model="Other"))
    git(tmp_path, "clone", "--quiet", "--depth=1", f"file://{fleet}", "ci")
    git(tmp_path / "ci", "checkout", "--quiet", "--detach")
    assert run(capsys, "check", "--registry", tmp_path / "ci")[0] == 0
    code, _, err = run(capsys, "check", f"{first}..HEAD", "--registry", tmp_path / "ci")
    assert code == 4
    assert f"git -C {tmp_path / 'ci'} fetch --unshallow" in err


class TestWorkTree:
    """For whoever edits files by hand, before they are committed."""

    def test_files_are_judged_as_they_lie(self, fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
        put(fleet, GOOD)
        (fleet / GOOD.path).write_bytes(replaced("fx: 3661.25", "fx: 3662.25"))
        assert run(capsys, "check")[0] == 0
        code, out, _ = run(capsys, "check", "--worktree")
        assert code == 1
        assert "registry add" in out

    def test_a_name_that_some_disk_would_stumble_over_is_told(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put(fleet, GOOD)
        file = fleet / "cameras/DJI/Aux/1x1.yaml"
        file.parent.mkdir(parents=True)
        file.write_bytes(entry_yaml(GOOD))
        code, out, _ = run(capsys, "check", "--worktree")
        assert code == 1
        assert "no camera's KEY gives this path" in out

    def test_a_file_that_cannot_be_read_stops_no_other(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put(fleet, GOOD, an_entry(model="Sealed"))
        other = an_entry(model="A Link").path
        (fleet / other).parent.mkdir(parents=True)
        (fleet / other).symlink_to(fleet / GOOD.path)
        (fleet / an_entry(model="Sealed").path).write_bytes(replaced("fx: 3661.25", "fx: 3662.25"))
        code, out, _ = run(capsys, "check", "--worktree")
        assert code == 1
        assert f"{other}: error: expected a regular file (entry)" in out
        assert f"{an_entry(model='Sealed').path}: error: " in out

    def test_a_plain_folder_is_checked_like_one(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        file = tmp_path / "plain" / GOOD.path
        file.parent.mkdir(parents=True)
        file.write_bytes(entry_yaml(GOOD))
        code, out, _ = run(capsys, "check", "--registry", f"folder:{tmp_path / 'plain'}")
        assert (code, out) == (0, "good: 1 entry in the folder: 0 errors, 0 warnings\n")

    def test_a_bare_registry_has_none(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        git(tmp_path, "clone", "--quiet", "--bare", str(fleet), "bare.git")
        code, _, err = run(capsys, "check", "--worktree", "--registry", tmp_path / "bare.git")
        assert code == 4
        assert "leave out --worktree" in err


@pytest.mark.usefixtures("fleet")
def test_files_have_no_range(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "check", "--worktree", "a..b")[0] == 2


def test_names_out_of_entries_do_not_steer_the_terminal(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hostile = an_entry(model="\x1b[2J[red]x", provenance=UNSTATED)
    put_bytes(fleet, {"cameras/dji/elsewhere/1x1.yaml": entry_yaml(hostile)})
    _, out, _ = run(capsys, "check")
    assert "\x1b" not in out


def test_a_link_among_the_cameras_is_told(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    link = fleet / "cameras/dji/other.yaml"
    link.parent.mkdir(parents=True)
    link.symlink_to("../../registry.yaml")
    git(fleet, "add", "cameras/dji/other.yaml")
    git(fleet, "commit", "-qm", "Link it")
    code, out, _ = run(capsys, "check")
    assert code == 1
    assert "cameras/dji/other.yaml: error: is a link" in out
