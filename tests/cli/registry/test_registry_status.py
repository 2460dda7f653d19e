"""``registry approve`` and ``retire``: whether an entry is used, and why."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Any

import pytest

from calibrary.cli.main import main
from calibrary.registry import proposals
from calibrary.registry.entry import Status
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.writing import Written
from calibrary.registry.proposals import write_changes
from calibrary.registry.registry import Registry
from tests.cli.registry.conftest import Filled
from tests.cli.registry.direct import put, put_bytes
from tests.cli.registry.fleets import P4R, add, commit_of, held, looked_at, printed, run, xml
from tests.registry.entries import an_entry
from tests.registry.git.repositories import git


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def two_drafts(fleet: Path) -> None:
    add(xml(fleet.parent / "a.xml"))
    add(xml(fleet.parent / "b.xml", 3661.0, (4864, 3648)))


@pytest.fixture
def drafts(fleet: Path, filled: Filled) -> Path:
    """Two drafts of one model, of two frames."""
    return filled(fleet, two_drafts)


def test_approving_says_who_and_why(drafts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = printed(
        capsys,
        "registry-change-1",
        "approve",
        *looked_at(drafts, P4R),
        "--reason",
        "checked over the test field",
    )
    [entry] = document["entries"]
    assert (entry["status_before"], entry["status"]) == ("draft", "approved")
    assert document["commit"] == commit_of(drafts)
    assert held(drafts).entry.reason == "checked over the test field"
    shown = git(drafts, "log", "-1", "--format=%an|%s|%(trailers:key=Reason,valueonly)")
    assert shown == f"Ada Keeper|Approve {P4R}|checked over the test field"


def test_several_are_approved_as_one_commit(drafts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = commit_of(drafts)
    assert run(capsys, "approve", *looked_at(drafts, P4R, "fc6310r/4864"))[0] == 0
    assert git(drafts, "rev-list", "--count", f"{before}..HEAD") == "1"


def test_if_one_fails_none_is_approved(
    drafts: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "off.xml", size=(4000, 3000), cx=-900.0))
    before = commit_of(drafts)
    code, _, err = run(capsys, "approve", *looked_at(drafts, P4R, "fc6310r/4000"))
    assert (code, "nothing was written" in err) == (1, True)
    assert commit_of(drafts) == before


def test_what_is_approved_already_stays_without_a_commit(
    drafts: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, "approve", *looked_at(drafts, P4R))
    before = commit_of(drafts)
    code, out, _ = run(capsys, "approve", P4R)
    assert (code, "it is already approved" in out) == (0, True)
    assert commit_of(drafts) == before


@pytest.mark.usefixtures("drafts")
def test_a_reason_is_wanted(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["registry", "retire", P4R])
    assert ended.value.code == 2
    assert "--reason" in capsys.readouterr().err


def test_a_retired_entry_keeps_its_file_and_is_used_no_more(
    drafts: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, "approve", *looked_at(drafts, P4R))
    assert run(capsys, "retire", P4R, "--reason", "lens was replaced")[0] == 0
    entry = held(drafts).entry
    assert (entry.status, entry.reason, entry.is_usable) == (Status.RETIRED, "lens was replaced", False)


def test_what_takes_its_place_says_so(drafts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(capsys, "approve", *looked_at(drafts, P4R, "fc6310r/4864"))
    before = commit_of(drafts)
    new = "dji/fc6310r/4864x3648"
    assert run(capsys, "retire", P4R, "--reason", "new frame", "--superseded-by", "fc6310r/4864")[0] == 0
    assert held(drafts, new).entry.supersedes == P4R
    assert git(drafts, "rev-list", "--count", f"{before}..HEAD") == "1"
    code, _, err = run(capsys, "retire", new, "--reason", "x", "--superseded-by", new)
    assert (code, "does not supersede itself" in err) == (4, True)


@pytest.mark.usefixtures("drafts")
@pytest.mark.parametrize(("verb", "why"), [("retire", "without @REV"), ("approve", "name the commit")])
def test_what_it_was_cannot_be_changed(verb: str, why: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = run(capsys, verb, f"{P4R}@HEAD", "--reason", "x")
    assert (code, why in err) == (4, True)


def test_a_proposal_that_is_not_wanted_is_withdrawn(drafts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "retire", P4R, "--reason", "blurred frames")[0] == 0
    assert f"cameras/{P4R}.yaml" not in Registry.open(drafts).snapshot().cameras
    printed = git(drafts, "log", "-1", "--format=%s|%(trailers:key=Reason,valueonly)")
    assert printed == f"Withdraw {P4R}|blurred frames"


class TestAnApprovalIsOfWhatWasLookedAt:
    def test_without_a_terminal_it_is_refused_and_told_how(
        self, drafts: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        before = commit_of(drafts)
        with pytest.raises(SystemExit) as ended:
            main(["registry", "approve", P4R])
        command = " ".join(looked_at(drafts, P4R))
        assert (ended.value.code, f"approve {command}" in capsys.readouterr().err) == (2, True)
        assert commit_of(drafts) == before

    @pytest.mark.parametrize(("answer", "status"), [("y\n", Status.APPROVED), ("\n", Status.DRAFT)])
    def test_a_person_is_asked(
        self, drafts: Path, answer: str, status: Status, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(sys, "stdin", Terminal(answer))
        assert main(["registry", "approve", P4R]) == 0
        assert held(drafts).entry.status is status

    def test_what_changed_since_it_was_shown_is_refused(
        self, drafts: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        shown, at = looked_at(drafts, P4R), commit_of(drafts)
        add(xml(tmp_path / "theirs.xml", 3661.0))
        for words in (shown, [f"{P4R}@{at[:10]}"]):
            code, _, err = run(capsys, "approve", *words)
            assert (code, "what is there now has the digest" in err) == (4, True)
        assert held(drafts).entry.status is Status.DRAFT
        assert run(capsys, "approve", f"{P4R}@{commit_of(drafts)[:10]}")[0] == 0
        assert held(drafts).entry.calibration.intrinsics.fx == 3661.0

    def test_the_new_k_is_shown_beside_the_old_in_pixels_and_on_the_ground(
        self, drafts: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        run(capsys, "approve", *looked_at(drafts, P4R))
        add(xml(tmp_path / "new.xml", 3670.0))
        code, out, _ = run(capsys, "approve", *looked_at(drafts, P4R), "--reason", "a new lens")
        out = " ".join(out.split())
        assert code == 0
        for words in ("intrinsics.fx 3660.5 3670.0 +9.5", "px at most over the frame", "on the ground"):
            assert words in out

    @pytest.mark.parametrize("digest", ["", "abc", "x" * 12])
    @pytest.mark.usefixtures("drafts")
    def test_a_digest_is_long_enough_to_mean_something(
        self, digest: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        code, _, err = run(capsys, "approve", P4R, "--digest", digest)
        assert (code, "is not a digest" in err) == (4, True)


@pytest.mark.usefixtures("drafts")
def test_an_unknown_camera_is_told_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = run(capsys, "approve", "dji/fc6310")
    assert (code, "dji/fc6310r" in err) == (4, True)


def test_an_approval_is_of_what_was_looked_at_whatever_is_written_meanwhile(
    drafts: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def after_another(*given: Any, **named: Any) -> Written:
        monkeypatch.setattr(proposals, "write_changes", write_changes)
        add(xml(tmp_path / "theirs.xml", 3661.0))
        return write_changes(*given, **named)

    seen = held(drafts).entry
    monkeypatch.setattr(proposals, "write_changes", after_another)
    assert run(capsys, "approve", *looked_at(drafts, P4R))[0] == 0
    assert held(drafts).entry.calibration == seen.calibration
    assert held(drafts, f"{P4R}@proposed").entry.calibration.intrinsics.fx == 3661.0


def test_a_k_that_is_wrong_is_retired_from_a_day_on(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    entry = an_entry(model="FC330", focal_mm=None)
    put(fleet, entry)
    assert run(capsys, "check")[0] == 1
    asked = ("resolve", "--make", "DJI", "--model", "FC330", "--image-size", "5472x3648", "--on")
    code, _, err = run(capsys, "retire", entry.id, "--reason", "sold", "--from", "2026-10-01")
    assert (code, "--force" in err) == (0, False)
    assert printed(capsys, "resolution-1", *asked, "2026-10-01")["entry"] is None
    assert printed(capsys, "resolution-1", *asked, "2026-09-30")["entry"]["id"] == entry.id


def test_what_nobody_approved_is_not_pinned(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put(fleet, an_entry())
    new = an_entry(model="FC330")
    put_bytes(fleet, {new.path: entry_yaml(new)})
    code, _, err = run(capsys, "lock", new.id, "--out", fleet.parent / "a.lock")
    assert (code, "not approved, so not used" in " ".join(err.split())) == (4, True)
