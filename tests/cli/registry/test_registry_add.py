"""``registry add``: what enters a registry, what is shown before, and what is refused."""

from __future__ import annotations

import argparse
import hashlib
from pathlib import Path

import numpy as np
import pytest

from calibrary.calibration import Grade
from calibrary.cli.registry import where
from calibrary.known_camera import hash_serial
from calibrary.records import replace
from calibrary.registry.entry import Status
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.registry import Registry
from tests.cli.registry.fleets import CAMERA, P4R, add, commit_of, held, run, xml
from tests.jobs.extract.fleet import DEWARP, picture
from tests.jobs.extract.fleet import P4R as P4R_TAGS
from tests.registry.entries import an_entry
from tests.registry.git.repositories import git


def test_a_new_entry_is_a_draft_with_its_whole_provenance(fleet: Path, tmp_path: Path) -> None:
    file = xml(tmp_path / "a.xml")
    add(file, "--reason", "first flight", "--note", "lens cap was scratched")
    entry = held(fleet).entry
    made = entry.calibration.provenance
    assert entry.status is Status.DRAFT
    assert (made.source, made.sha256) == ("a.xml", hashlib.sha256(file.read_bytes()).hexdigest())
    # What the file does not state is not known; who added it, and when, is the commit's.
    assert (made.operator, made.date, made.tool) == (None, None, None)
    assert git(fleet, "log", "-1", "--format=%an") == "Ada Keeper"
    assert git(fleet, "log", "-1", "--format=%(trailers:key=Source-File,valueonly)") == "a.xml"
    assert entry.notes == ("lens cap was scratched",)
    assert git(fleet, "log", "-1", "--format=%(trailers:key=Reason,valueonly)") == "first flight"
    assert git(fleet, "status", "--porcelain") == ""


@pytest.mark.usefixtures("fleet")
@pytest.mark.parametrize(("flags", "is_told"), [((), True), (("--approve", "--reason", "flown"), False)])
def test_a_proposal_is_told_how_it_comes_into_use(
    flags: tuple[str, ...], is_told: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, _, err = run(capsys, "add", xml(tmp_path / "a.xml"), *CAMERA, *flags, "--yes")
    assert ("a proposal is not used yet; next: calibrary registry approve" in err) is is_told


def test_a_k_of_no_camera_enters_by_force_only(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = xml(tmp_path / "a.xml", f=4.95)
    code, _, err = run(capsys, "add", file, *CAMERA, "--yes")
    assert code == 3
    assert "4.95 px" in err
    assert "--force" in err
    assert run(capsys, "add", file, *CAMERA, "--yes", "--force", "--reason", "a test of units")[0] == 0
    assert held(fleet).entry.calibration.intrinsics.fx == 4.95


def test_flags_say_what_the_source_does_not_and_nothing_else_does(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "a.xml"), "--date", "2019-03-05", "--tool", "lab 3.1", "--operator", "B. Solver")
    made = held(fleet).entry.calibration.provenance
    assert (made.date, made.tool, made.operator) == ("2019-03-05", "lab 3.1", "B. Solver")
    file = fleet / f"cameras/{P4R}.yaml"
    code, out, _ = run(capsys, "add", file, "--date", "2020-01-02", "--yes")
    assert code == 0
    assert "the source states the date '2019-03-05', and --date replaces it" in " ".join(out.split())
    assert held(fleet).entry.calibration.provenance.date == "2020-01-02"
    with pytest.raises(SystemExit):
        run(capsys, "add", file, "--date", "05.03.2019")


@pytest.mark.usefixtures("fleet")
def test_without_a_name_for_the_camera_the_flags_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = run(capsys, "add", xml(tmp_path / "a.xml"), "--make", "DJI", "--yes")
    assert code == 3
    assert err == (
        "calibrary: a.xml: does not state the camera's model, by which an entry is found; state it with --model NAME\n"
    )


def test_without_an_image_size_the_flag_is_named(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.save(tmp_path / "K.npy", np.array([[3660.5, 0, 2731.5], [0, 3655.25, 1846.75], [0, 0, 1]]))
    code, _, err = run(capsys, "add", tmp_path / "K.npy", *CAMERA, "--yes")
    assert (code, "--image-size" in err) == (3, True)
    add(tmp_path / "K.npy", "--image-size", "5472x3648")
    assert held(fleet).entry.calibration.intrinsics.fx == 3660.5


def test_the_flags_come_before_the_file(fleet: Path, tmp_path: Path) -> None:
    add(xml(tmp_path / "a.xml"), "--sub-camera", "wide", "--focal-mm", "8.8", "--firmware", "01.09")
    entry = held(fleet, "fc6310r").entry
    assert entry.id == "dji/fc6310r/5472x3648+sub-wide+f8.8"
    assert entry.calibration.provenance.firmware == "01.09"


def test_a_range_of_firmware_is_part_of_the_key(fleet: Path, tmp_path: Path) -> None:
    add(xml(tmp_path / "a.xml"), "--firmware-range", "01.08..01.09")
    add(xml(tmp_path / "b.xml", 3665.0), "--firmware-range", "01.10..")
    ranges = [one.entry.firmware for one in Registry.open(fleet).snapshot().proposals()]
    assert ranges == [FirmwareRange(min="01.08", max="01.09"), FirmwareRange(min="01.10")]


def test_a_serial_number_is_hashed(fleet: Path, tmp_path: Path) -> None:
    add(xml(tmp_path / "a.xml"), "--serial", "0V2ABC1234567")
    [path] = Registry.open(fleet).snapshot().cameras
    assert path == f"cameras/dji/fc6310r/sn-{hash_serial('DJI', '0V2ABC1234567')}/5472x3648.yaml"
    assert "0V2ABC1234567" not in git(fleet, "log", "-p", "--no-textconv")


def test_a_serial_number_in_an_entrys_file_is_hashed(fleet: Path, tmp_path: Path) -> None:
    (tmp_path / "entry.yaml").write_bytes(entry_yaml(an_entry(serial="0V2ABC1234567")))
    add(tmp_path / "entry.yaml", camera=())
    assert "0V2ABC1234567" not in git(fleet, "log", "-p", "--no-textconv")


def test_what_only_another_program_needs_stays_out(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = xml(tmp_path / "a.xml")
    file.write_text(file.read_text().replace("</calibration>", "<owner>Jane Doe</owner></calibration>"))
    code, printed, _ = run(capsys, "add", file, *CAMERA, "--yes")
    assert (code, "fields of the file that only its program uses stay out of the entry" in printed) == (
        0,
        True,
    )
    assert held(fleet).entry.calibration.extras == ()
    assert b"Jane Doe" not in entry_yaml(held(fleet).entry)


def test_an_image_enters_by_its_metadata_with_its_grade(fleet: Path, tmp_path: Path) -> None:
    image = picture(tmp_path / "a.jpg", **P4R_TAGS, dewarp=DEWARP)
    add(image, camera=())
    calibration = held(fleet, "fc6310r").entry.calibration
    assert calibration.grade is Grade.CALIBRATED
    assert calibration.provenance.kind == "image-metadata"
    assert calibration.provenance.sha256 == hashlib.sha256(image.read_bytes()).hexdigest()


def test_of_an_image_only_a_measured_k_names_the_unit(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(picture(tmp_path / "a.jpg", **P4R_TAGS, body_serial="77A"), camera=())
    [one] = Registry.open(fleet).snapshot().proposals()
    assert one.entry.calibration.grade is Grade.DERIVED
    assert one.entry.calibration.camera.serial is None
    assert "no serial number is stored" in capsys.readouterr().out


@pytest.mark.parametrize("grade", [Grade.PRIOR, Grade.SEED])
@pytest.mark.usefixtures("fleet")
def test_a_guess_is_refused(
    tmp_path: Path,
    grade: Grade,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    guess = replace(an_entry().calibration, grade=grade)
    monkeypatch.setattr("calibrary.parsers.read", lambda *_, **__: [guess])
    code, _, err = run(capsys, "add", xml(tmp_path / "a.xml"), "--yes")
    assert (code, f"grade {grade.value} is a guess" in err) == (3, True)


def test_every_camera_of_a_file_enters_in_one_commit_or_one_is_chosen(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "cameras.txt"
    file.write_text(
        "1 PINHOLE 4000 3000 2931.4 2930.9 2004.3 1496.1\n2 PINHOLE 2000 1500 1465.7 1465.4 1002.1 748.0\n"
    )
    before = commit_of(fleet)
    code, out, _ = run(capsys, "add", file, *CAMERA, "--camera", "2", "--yes")
    assert (code, "the file states the sub-camera '2'" in out) == (0, True)
    assert [one.id for one in Registry.open(fleet).snapshot().proposals()] == ["dji/fc6310r/2000x1500+sub-2"]
    add(file, "--sub-camera", "")
    assert git(fleet, "rev-list", "--count", f"{before}..HEAD") == "2"
    ids = ["dji/fc6310r/2000x1500", "dji/fc6310r/2000x1500+sub-2", "dji/fc6310r/4000x3000"]
    assert sorted(one.id for one in Registry.open(fleet).snapshot().proposals()) == ids


@pytest.mark.usefixtures("fleet")
def test_cameras_that_would_be_one_entry_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "cameras.txt"
    file.write_text(
        "1 PINHOLE 4000 3000 2931.4 2930.9 2004.3 1496.1\n2 PINHOLE 4000 3000 2933.7 2931.4 2003.1 1497.0\n"
    )
    code, _, err = run(capsys, "add", file, *CAMERA, "--sub-camera", "wide", "--yes")
    assert (code, "--camera N" in err) == (3, True)


@pytest.mark.parametrize(("given", "said"), [(None, ""), (Path("my fleet"), " --registry 'my fleet'")])
def test_the_next_command_names_the_registry_that_was_given(given: Path | None, said: str) -> None:
    assert where(argparse.Namespace(registry=given)) == said
