"""``registry log``, ``show`` and ``list``: what there is, and what became of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.cli.main import main
from tests.cli.registry.conftest import Filled
from tests.cli.registry.fleets import P4R, add, held, looked_at, printed, run, xml
from tests.registry.git.repositories import git


def measure_again(fleet: Path) -> None:
    add(xml(fleet.parent / "a.xml"), "--reason", "first flight", "--firmware", "01.08")
    assert main(["registry", "approve", *looked_at(fleet, P4R), "--reason", "checked"]) == 0
    add(xml(fleet.parent / "b.xml", 3663.0), "--reason", "new firmware", "--firmware", "01.09", "--approve")


@pytest.fixture
def kept(fleet: Path, filled: Filled) -> Path:
    """An entry that was added, approved, and measured again."""
    return filled(fleet, measure_again)


def test_a_log_tells_what_every_commit_changed_in_k(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    revisions = printed(capsys, "registry-log-1", "log", "fc6310r")["revisions"]
    assert [one["reason"] for one in revisions] == ["new firmware", "checked", "first flight"]
    assert [one["actions"] for one in revisions] == [["approve"], ["approve"], []]
    assert [one["firmware"] for one in revisions] == ["01.09", "01.08", "01.08"]
    assert [one["delta_K"]["fx"] if one["delta_K"] else None for one in revisions] == [2.5, 0.0, None]
    assert [one["commit"] for one in revisions] == git(kept, "log", "--format=%H", "-3").splitlines()


@pytest.mark.usefixtures("kept")
def test_a_log_is_a_table_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "log", "fc6310r")
    assert code == 0
    assert "3663.00 (+2.50)" in out
    assert "Ada Keeper" in out


def test_the_verb_of_a_commit_is_no_reason(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "a.xml"))
    assert git(fleet, "log", "--format=%s", "-1") == f"Add {P4R}"
    assert "Add" not in run(capsys, "log", "fc6310r")[1]


def test_a_log_of_the_registry_tells_every_commit(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    revisions = printed(capsys, "registry-log-1", "log")["revisions"]
    assert [one["commit"] for one in revisions] == git(kept, "log", "--format=%H").splitlines()
    assert revisions[0]["cameras"] == [P4R]
    assert "first flight" in run(capsys, "log")[1]


@pytest.mark.usefixtures("kept")
def test_the_newest_of_a_log_still_knows_what_was_before(capsys: pytest.CaptureFixture[str]) -> None:
    [one] = printed(capsys, "registry-log-1", "log", "fc6310r", "-n", "1")["revisions"]
    assert one["delta_K"]["fx"] == 2.5


def test_a_removed_entry_is_told_by_its_whole_id(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    git(kept, "rm", "--quiet", f"cameras/{P4R}.yaml")
    git(kept, "commit", "--quiet", "-m", "Remove it")
    revisions = printed(capsys, "registry-log-1", "log", P4R)["revisions"]
    assert (revisions[0]["K"], revisions[0]["subject"]) == (None, "Remove it")
    assert "removed" in run(capsys, "log", P4R)[1]
    assert run(capsys, "log", "dji/fc9999/1x1")[0] == 4


@pytest.mark.usefixtures("kept")
def test_show_tells_what_an_entry_is_and_was(capsys: pytest.CaptureFixture[str]) -> None:
    document = printed(capsys, "registry-show-1", "show", "fc6310r@firmware:01.08")
    assert document["calibration"]["intrinsics"]["fx"] == 3660.5
    assert document["status"] == "approved"
    assert ["intrinsics.fx", "3663", "px"] in [
        line.split() for line in run(capsys, "show", "fc6310r")[1].splitlines()
    ]


@pytest.mark.usefixtures("kept")
def test_show_holds_an_entry_against_another_revision(capsys: pytest.CaptureFixture[str]) -> None:
    document = printed(capsys, "registry-show-1", "show", "fc6310r", "--diff", "firmware:01.08")
    changes = {one["field"]: one for one in document["changes"]}
    assert changes["intrinsics.fx"]["delta"] == 2.5
    assert "distortion.k1" not in changes
    assert "+2.5" in run(capsys, "show", "fc6310r", "--diff", "HEAD~1")[1]
    assert "says what" in run(capsys, "show", "fc6310r", "--diff", "HEAD")[1]


def test_show_prints_the_file_as_it_stands(kept: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    assert main(["registry", "show", "fc6310r", "--yaml"]) == 0
    assert capfdbinary.readouterr().out == (kept / f"cameras/{P4R}.yaml").read_bytes()


@pytest.mark.parametrize("arguments", [(), ("fc6310r", "--diff", "HEAD", "--yaml")])
@pytest.mark.usefixtures("kept")
def test_show_wants_one_thing_to_show(arguments: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["registry", "show", *arguments])
    assert ended.value.code == 2


def test_list_and_show_print_one_form_of_an_entry(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    [listed] = printed(capsys, "entry-listing-1", "list")["entries"]
    shown = printed(capsys, "registry-show-1", "show", "fc6310r")
    of_show = {"schema", "recorded", "approved", "against", "changes", "use", "use_reason"}
    assert listed == {name: value for name, value in shown.items() if name not in of_show}
    assert listed["blob"] == held(kept).oid


@pytest.mark.usefixtures("kept")
def test_a_list_is_narrowed_by_words_status_grade_and_date(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "c.xml", 3661.0, (4864, 3648)))

    def ids(*arguments: str) -> list[str]:
        return [one["id"] for one in printed(capsys, "entry-listing-1", "list", *arguments)["entries"]]

    assert ids("fc6310", "4864") == ids("--status", "draft") == ["dji/fc6310r/4864x3648"]
    assert ids("--status", "approved") == ids("--at", "HEAD~1") == [P4R]
    assert len(ids("--grade", "adjusted", "--grade", "design")) == 2
    assert ids("--grade", "calibrated") == ids("canon") == []


def test_one_entry_that_cannot_be_read_does_not_hide_the_others(
    kept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "c.xml", 3661.0, (4864, 3648)))
    file = kept / f"cameras/{P4R}.yaml"
    file.write_text(file.read_text().replace("fx: 3663.0", "fx: 3999.5"))
    git(kept, "commit", "--quiet", "-am", "Break the seal")
    code, out, err = run(capsys, "list")
    assert (code, "4864x3648" in out, P4R in out) == (1, True, True)
    assert f"cameras/{P4R}.yaml" in err
