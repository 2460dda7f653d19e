"""``registry approve``, ``hold`` and ``retire``: whether an entry is used, and why."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.cli.main import main
from calibrary.registry.entry import Status
from calibrary.registry.git.writing import Written
from calibrary.registry.proposals import Proposals
from calibrary.registry.registry import Registry
from tests.cli.registry.fleets import P4R, add, commit_of, held, printed, run, xml
from tests.registry.git.repositories import git


@pytest.fixture
def drafts(fleet: Path, tmp_path: Path) -> Path:
    """Two drafts of one model, of two frames."""
    add(xml(tmp_path / "a.xml"))
    add(xml(tmp_path / "b.xml", 3250.0, (4864, 3648)))
    return fleet


def test_approving_says_who_and_why(drafts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = printed(capsys, "registry-change-1", "approve", P4R, "--reason", "checked over the test field")
    [entry] = document["entries"]
    assert (entry["status_before"], entry["status"]) == ("draft", "approved")
    assert document["commit"] == commit_of(drafts)
    assert held(drafts).entry.reason == "checked over the test field"
    told = git(drafts, "log", "-1", "--format=%an|%s|%(trailers:key=Reason,valueonly)")
    assert told == f"Ada Keeper|Approve {P4R}|checked over the test field"


def test_several_are_approved_as_one_commit(drafts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = commit_of(drafts)
    assert run(capsys, "approve", P4R, "fc6310r/4864")[0] == 0
    assert git(drafts, "rev-list", "--count", f"{before}..HEAD") == "1"


def test_if_one_fails_none_is_approved(
    drafts: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "off.xml", size=(4000, 3000), cx=-900.0))
    before = commit_of(drafts)
    code, _, told = run(capsys, "approve", P4R, "fc6310r/4000")
    assert (code, "nothing was written" in told) == (1, True)
    assert commit_of(drafts) == before


def test_what_is_approved_already_stays_without_a_commit(
    drafts: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, "approve", P4R)
    before = commit_of(drafts)
    code, told, _ = run(capsys, "approve", P4R)
    assert (code, "it is already approved" in told) == (0, True)
    assert commit_of(drafts) == before


@pytest.mark.parametrize("verb", ["hold", "retire"])
@pytest.mark.usefixtures("drafts")
def test_a_reason_is_wanted(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["registry", verb, P4R])
    assert ended.value.code == 2
    assert "--reason" in capsys.readouterr().err


def test_a_retired_entry_keeps_its_file_and_is_used_no_more(
    drafts: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(capsys, "retire", P4R, "--reason", "lens was replaced")[0] == 0
    entry = held(drafts).entry
    assert (entry.status, entry.reason, entry.is_usable) == (Status.RETIRED, "lens was replaced", False)


def test_what_takes_its_place_says_so(drafts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = commit_of(drafts)
    new = "dji/fc6310r/4864x3648"
    assert run(capsys, "retire", P4R, "--reason", "new frame", "--superseded-by", "fc6310r/4864")[0] == 0
    assert held(drafts, new).entry.supersedes == P4R
    assert git(drafts, "rev-list", "--count", f"{before}..HEAD") == "1"
    code, _, told = run(capsys, "retire", new, "--reason", "x", "--superseded-by", new)
    assert (code, "does not supersede itself" in told) == (4, True)


@pytest.mark.usefixtures("drafts")
def test_what_it_was_cannot_be_changed(capsys: pytest.CaptureFixture[str]) -> None:
    code, _, told = run(capsys, "approve", f"{P4R}@HEAD")
    assert (code, "without @REV" in told) == (4, True)


@pytest.mark.usefixtures("drafts")
def test_an_unknown_camera_is_told_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    code, _, told = run(capsys, "approve", "dji/fc6310")
    assert (code, "dji/fc6310r" in told) == (4, True)


def test_an_entry_that_changes_under_the_decision_is_a_conflict(
    drafts: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    save = Registry.save

    def after_another(registry: Registry, proposals: Proposals, **named: str | None) -> Written:
        monkeypatch.setattr(Registry, "save", save)
        add(xml(tmp_path / "theirs.xml", 3661.0))
        return save(registry, proposals, reason=named["reason"])

    monkeypatch.setattr(Registry, "save", after_another)
    code, _, told = run(capsys, "approve", P4R)
    assert (code, "nothing was written" in told) == (4, True)
    assert held(drafts).entry.status is Status.DRAFT
