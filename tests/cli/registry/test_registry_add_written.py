"""``registry add`` and the entry that is there already: what is shown, asked, kept and written."""

from __future__ import annotations

import io
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrary.calibration import Quality
from calibrary.cli.main import main
from calibrary.records import replace
from calibrary.registry import proposals
from calibrary.registry.entry import Alias, Status
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.writing import Written
from calibrary.registry.places import default_place
from calibrary.registry.proposals import write_changes
from calibrary.registry.registry import Registry
from tests.cli.registry.fleets import CAMERA, P4R, add, commit_of, held, looked_at, printed, run, xml
from tests.registry.entries import an_entry
from tests.registry.git.repositories import git


def test_the_difference_is_shown_field_by_field_with_its_size(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    quality = Quality(std={"fx": 0.3, "fy": 0.3})
    for name, fx in (("one.yaml", 3660.0), ("two.yaml", 3662.0)):
        (tmp_path / name).write_bytes(entry_yaml(an_entry(fx=fx, quality=quality)))
    add(tmp_path / "one.yaml", camera=())
    document = printed(capsys, "registry-change-1", "add", tmp_path / "two.yaml", "--yes")
    [entry] = document["entries"]
    [fx] = [change for change in entry["changes"] if change["field"] == "intrinsics.fx"]
    assert (fx["before"], fx["after"], fx["delta"]) == (3660.0, 3662.0, 2.0)
    assert fx["z"] == pytest.approx(2.0 / np.hypot(0.3, 0.3))
    assert document["commit"] == commit_of(fleet)


def test_the_same_file_again_changes_nothing_and_nobodys_approval(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "a.xml"), "--approve", "--date", "2019-03-05", "--operator", "Lab")
    before = commit_of(fleet)
    code, out, _ = run(capsys, "add", tmp_path / "a.xml", *CAMERA, "--yes")
    assert (code, "is there already" in out) == (0, True)
    assert commit_of(fleet) == before
    assert held(fleet).entry.status is Status.APPROVED


def test_a_new_k_of_an_approved_camera_waits_beside_it(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "a.xml"), "--approve")
    code, out, _ = run(capsys, "add", xml(tmp_path / "b.xml", 3663.0), *CAMERA, "--yes")
    assert code == 0
    assert "stays in use until this is approved" in out
    assert (held(fleet).entry.status, held(fleet).entry.calibration.intrinsics.fx) == (
        Status.APPROVED,
        3660.5,
    )
    proposed = held(fleet, f"{P4R}@proposed").entry
    assert (proposed.status, proposed.calibration.intrinsics.fx) == (Status.DRAFT, 3663.0)


def test_what_the_registry_knows_of_a_camera_outlives_a_new_k(fleet: Path, tmp_path: Path) -> None:
    known = an_entry(aliases=(Alias(make="DJI", model="Phantom 4 RTK"),), tolerance=0.01, focal_mm=None)
    (tmp_path / "entry.yaml").write_bytes(entry_yaml(replace(known, extensions={"x-owner": "survey"})))
    add(tmp_path / "entry.yaml", camera=())
    add(xml(tmp_path / "a.xml", 3664.0))
    entry = held(fleet).entry
    assert entry.calibration.intrinsics.fx == 3664.0
    assert (entry.aliases, entry.tolerance) == (known.aliases, 0.01)
    assert entry.extensions == {"x-owner": "survey"}


def test_where_nobody_can_be_asked_yes_is_wanted(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    before = commit_of(fleet)
    with pytest.raises(SystemExit) as ended:
        main(["registry", "add", str(xml(tmp_path / "a.xml")), *CAMERA])
    assert ended.value.code == 2
    assert "say --yes" in capsys.readouterr().err
    assert commit_of(fleet) == before


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("answer", "wrote"), [("y\n", True), ("n\n", False), ("\n", False), ("", False)])
def test_a_person_is_asked(
    fleet: Path, tmp_path: Path, answer: str, wrote: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", Terminal(answer))
    before = commit_of(fleet)
    assert main(["registry", "add", str(xml(tmp_path / "a.xml")), *CAMERA]) == 0
    assert (commit_of(fleet) != before) is wrote


def test_what_the_check_objects_to_is_not_written(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = commit_of(fleet)
    off = xml(tmp_path / "a.xml", cx=-900.0)
    code, _, err = run(capsys, "add", off, *CAMERA, "--approve", "--yes")
    assert (code, "without --approve" in err) == (1, True)
    assert commit_of(fleet) == before
    assert run(capsys, "add", off, *CAMERA, "--yes")[0] == 0
    assert run(capsys, "approve", *looked_at(fleet, P4R))[0] == 1
    assert held(fleet).entry.status is Status.DRAFT


def test_the_registrys_own_policy_decides(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    configuration = fleet / "registry.yaml"
    ours = '{schema: "calibrary/policy-1", name: "ours", principal_point_drift_max: 0.0001}'
    configuration.write_text(configuration.read_text().replace('policy: "fleet"\n', f"policy: {ours}\n"))
    git(fleet, "commit", "--quiet", "-am", "Ask for more")
    oid = git(fleet, "rev-parse", "HEAD:registry.yaml")
    assert run(capsys, "approve", "registry.yaml", "--digest", oid)[0] == 0
    assert run(capsys, "add", xml(tmp_path / "a.xml"), *CAMERA, "--approve", "--yes")[0] == 1


def test_of_two_writers_the_second_is_told_what_the_first_wrote_and_writes_nothing(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    add(xml(tmp_path / "a.xml"))

    def after_another(*given: Any, **named: Any) -> Written:
        monkeypatch.setattr(proposals, "write_changes", write_changes)
        add(xml(tmp_path / "theirs.xml", 3661.0))
        return write_changes(*given, **named)

    monkeypatch.setattr(proposals, "write_changes", after_another)
    code, _, err = run(capsys, "add", xml(tmp_path / "ours.xml", 3662.0), *CAMERA, "--yes")
    assert code == 4
    assert "nothing was written" in err
    assert "theirs, and what was to be written" in err
    assert held(fleet).entry.calibration.intrinsics.fx == 3661.0


def test_an_entry_edited_by_hand_in_the_work_tree_is_sealed_and_says_so(fleet: Path, tmp_path: Path) -> None:
    add(xml(tmp_path / "a.xml"), "--approve")
    file = fleet / f"cameras/{P4R}.yaml"
    lines = [line for line in file.read_text().splitlines(keepends=True) if not line.startswith("digest:")]
    file.write_text("".join(lines).replace("fx: 3660.5", "fx: 3661.5"))
    add(file, "--reason", "typing error", camera=())
    assert held(fleet).entry.calibration.intrinsics.fx == 3660.5
    calibration = held(fleet, f"{P4R}@proposed").entry.calibration
    assert calibration.intrinsics.fx == 3661.5
    assert "numbers changed by hand" in calibration.provenance.assumptions
    assert (calibration.provenance.date, calibration.provenance.operator) == (None, None)
    assert git(fleet, "status", "--porcelain") == ""


def test_a_hand_made_entry_in_the_work_tree_takes_its_place(fleet: Path) -> None:
    entry = an_entry()
    file = fleet / entry.path
    file.parent.mkdir(parents=True)
    text = entry_yaml(entry).decode()
    file.write_text(
        "".join(line for line in text.splitlines(keepends=True) if not line.startswith("digest:"))
    )
    add(file, camera=())
    assert held(fleet, "fc6310r").entry.calibration.intrinsics == entry.calibration.intrinsics
    assert git(fleet, "status", "--porcelain") == ""


def test_a_hand_edit_survives_a_write_that_fails(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    add(xml(tmp_path / "a.xml"), "--approve")
    file = fleet / f"cameras/{P4R}.yaml"
    lines = [line for line in file.read_text().splitlines(keepends=True) if not line.startswith("digest:")]
    edited = "".join(lines).replace("fx: 3660.5", "fx: 3661.5")
    file.write_text(edited)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(proposals, "write_changes", full)
    monkeypatch.setenv("CALIBRARY_DEBUG", "")
    assert run(capsys, "add", file, "--yes")[0] != 0
    assert file.read_text() == edited


def test_of_an_entry_that_cannot_be_read_the_approved_revision_is_used(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "a.xml"), "--approve")
    file = fleet / f"cameras/{P4R}.yaml"
    file.write_text(file.read_text().replace("fx: 3660.5", "fx: 3999.5"))
    git(fleet, "commit", "--quiet", "-am", "Break the seal")
    code, out, _ = run(capsys, "add", tmp_path / "a.xml", *CAMERA, "--approve", "--yes")
    assert (code, "is there already" in out) == (0, True)
    assert held(fleet).entry.calibration.intrinsics.fx == 3660.5


def test_the_first_entry_of_a_user_begins_a_registry_of_his_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("CALIBRARY_REGISTRY")
    monkeypatch.chdir(tmp_path)
    code, _, err = run(capsys, "add", xml(tmp_path / "a.xml"), *CAMERA, "--yes")
    assert (code, "your own was created" in err) == (0, True)
    assert held(default_place()).id == P4R


@pytest.mark.usefixtures("fleet")
def test_a_folder_is_no_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "add", tmp_path, *CAMERA, "--yes")[0] == 3
    assert run(capsys, "add", tmp_path / "none.xml", *CAMERA, "--yes")[0] == 3


def test_what_a_person_wrote_into_the_file_of_an_entry_stays_over_every_command(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "a.xml"), "--approve", "--yes")
    file = fleet / held(fleet).path
    text = file.read_text()
    grade = re.search("^grade: .*\n", text, re.MULTILINE)
    assert grade is not None
    text = text.replace(grade[0], "").replace("camera:\n", f"{grade[0]}camera:  # Ada's\n  # of 2026\n")
    file.write_text(text)
    git(fleet, "commit", "-qam", "Comment")
    commands: tuple[tuple[str, ...], ...] = (
        ("set", P4R, "+survey", "--yes"),
        ("add", str(xml(tmp_path / "b.xml", 3661.5)), "--make", "DJI", "--model", "FC6310R", "--yes"),
        ("approve", P4R, "--digest", "", "--reason", "new board"),
        ("retire", P4R, "--reason", "lens cracked"),
    )
    for words in commands:
        seen = [str(oid)[:12] for oid in Registry.open(fleet).snapshot().proposed.values()]
        code, _, err = run(capsys, *(word or seen[0] for word in words))
        assert code == 0, err
        lines = file.read_text().splitlines()
        at = lines.index("camera:  # Ada's")
        assert (lines[at - 1][:5], lines[at + 1]) == ("grade", "  # of 2026")
    assert held(fleet).entry.status is Status.RETIRED
    assert held(fleet).entry.calibration.intrinsics.fx == 3661.5
