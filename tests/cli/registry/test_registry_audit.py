"""``registry audit``: what flew, held against the registry."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import pytest

from calibrary.cli.main import main
from calibrary.registry.entry import Status
from tests.cli.registry.audits import TODAY, approved, audited, flight, phantom, rules
from tests.cli.registry.fleets import P4R, add, commit_of, held, looked_at, printed, run, xml
from tests.registry.git.repositories import git

__all__ = ["flight"]

OPENCV_2019 = """\
%YAML:1.0
---
calibration_time: "Tue 05 Mar 2019 10:11:12 AM UTC"
image_width: 5472
image_height: 3648
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 3660.5, 0., 2731.5, 0., 3660.5, 1831.25, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.02, 0.01, 0.0008, -0.0001, -0.003 ]
avg_reprojection_error: 0.31
"""
UNIT = "f41c07aa9e"
GRADE = 'grade: "adjusted"\n'


def test_a_k_that_waits_beside_the_one_in_use_is_noted(
    fleet: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"))
    add(xml(tmp_path / "b.xml", 3661.0), "--date", TODAY)
    document = audited(capsys, flight)
    (finding,) = (one for one in document["findings"] if one["rule"] == "another K proposed")
    assert (finding["severity"], finding["place"]) == ("note", P4R)
    shown = f"{P4R}@proposed"
    assert finding["remedy"] == f"calibrary diff {P4R} {shown}, then calibrary registry approve {P4R}"
    assert run(capsys, "show", shown)[0] == 0


def test_a_fleet_in_order_ends_with_0(
    fleet: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"))
    document = audited(capsys, flight)
    assert (document["verdict"], rules(document)) == ("clean", [])
    assert document["cameras"][0]["entry"] == P4R
    assert run(capsys, "audit", flight)[0] == 0


@pytest.mark.usefixtures("fleet")
def test_a_camera_without_an_entry_is_told_with_the_next_step(
    flight: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    [finding] = audited(capsys, flight)["findings"]
    assert (finding["rule"], finding["severity"]) == ("no entry", "error")
    assert finding["remedy"] == f"calibrary onboard {flight}"
    code, out, _ = run(capsys, "audit", flight)
    assert (code, "no entry" in out) == (1, True)


def test_a_draft_that_flies_is_no_entry_to_use(
    fleet: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "a.xml"))
    assert held(fleet).entry.status is Status.DRAFT
    [finding] = audited(capsys, flight)["findings"]
    assert (finding["rule"], finding["place"]) == ("only proposed", P4R)


def test_a_retired_entry_that_flies_is_told_with_its_reason(
    fleet: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"))
    run(capsys, "retire", P4R, "--reason", "lens was replaced")
    [finding] = audited(capsys, flight)["findings"]
    assert finding["rule"] == "retired in use"
    assert "lens was replaced" in finding["message"]


def restate(fleet: Path, old: str, new: str) -> None:
    """The entry with a line of its file changed, by hand and by git, and approved."""
    path = fleet / "cameras" / f"{P4R}.yaml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    git(fleet, "commit", "-qam", "by hand")
    assert main(["registry", "approve", *looked_at(fleet, P4R), "--reason", "looked at"]) == 0


def test_a_validity_that_is_over_is_told_of_what_flies_and_of_what_does_not(
    fleet: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"), "--valid-from", "2024-01-01", "--valid-until", "2025-01-01")
    assert rules(audited(capsys, flight)) == ["expired in use"]
    phantom(tmp_path / "else" / "b.jpg", model="FC330", dewarp=None)
    assert "validity over" in rules(audited(capsys, tmp_path / "else"), "warning")


def test_another_firmware_than_the_calibrations_is_told(
    fleet: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"), "--firmware", "v01.08.0000")
    [finding] = audited(capsys, flight)["findings"]
    assert (finding["rule"], finding["severity"]) == ("firmware changed", "warning")
    assert "v01.08.0000" in finding["message"]
    assert "v01.09.1691" in finding["message"]


def test_the_same_firmware_written_otherwise_is_no_change(
    fleet: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"), "--firmware", "1.9.1691")
    assert audited(capsys, flight)["findings"] == []


def test_an_editors_name_is_no_firmware(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"), "--firmware", "v01.09.1691")
    phantom(tmp_path / "flight" / "a.jpg", software="Gallery 4.1")
    assert "firmware changed" not in rules(audited(capsys, tmp_path / "flight"))


def test_a_firmware_that_the_entry_is_stated_to_be_of_is_no_change(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], fleet: Path
) -> None:
    firmware = ("--firmware", "01.08", "--firmware-range", "01.08..01.10")
    add(xml(tmp_path / "a.xml"), *firmware, "--date", TODAY, "--approve")
    assert audited(capsys, flight)["findings"] == []
    assert commit_of(fleet)


def test_a_16_9_mode_is_told_as_a_part_of_the_frame(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"))
    phantom(tmp_path / "wide" / "a.jpg", (5472, 3078))
    [finding] = audited(capsys, tmp_path / "wide")["findings"]
    assert finding["rule"] == "image size changed"
    assert finding["severity"] == "warning"
    assert "cropped 5472×3648 → 5472×3078; assumed: the crop is centred" in finding["message"]


def test_images_that_a_program_changed_are_told_and_not_as_another_scale(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"))
    image = phantom(tmp_path / "small" / "a.jpg", (2736, 1824), pixel_size=(5472, 3648))
    [finding] = audited(capsys, tmp_path / "small")["findings"]
    assert finding["rule"] == "images changed by a program"
    assert finding["remedy"] == "provide the original files from the camera"
    assert "nothing shows that this K describes it" in run(capsys, "resolve", image)[2]


@pytest.mark.usefixtures("fleet")
def test_an_entry_of_smaller_images_sends_no_camera_back_to_its_full_frame(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "a.xml", 3660.5 / 2, (2736, 1824)), "--approve", "--date", TODAY)
    [finding] = [one for one in audited(capsys, flight)["findings"] if one["rule"] == "image size changed"]
    assert finding["remedy"] == "calibrate it at this size and add that"


def test_a_k_beyond_the_entrys_tolerance_is_a_drift(
    fleet: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml", 3800.0))
    [finding] = audited(capsys, flight)["findings"]
    assert (finding["rule"], finding["severity"]) == ("K drifted", "error")
    assert "px rms" in finding["message"]
    restate(fleet, GRADE, f"{GRADE}tolerance: 0.05\n")
    assert rules(audited(capsys, flight)) == rules(audited(capsys, flight), "note") == ["units differ"]


def test_a_wrong_tag_is_a_note_where_another_source_confirms_the_entry(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"))
    phantom(tmp_path / "flight" / "a.jpg", focal_35mm=35)
    [finding] = audited(capsys, tmp_path / "flight")["findings"]
    assert (finding["rule"], finding["severity"]) == ("tags disagree", "note")
    assert "it is not believed: the entry and EXIF FocalLength" in finding["message"]


def test_a_focal_length_of_another_lens_speaks_against_the_entry_and_is_heard(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"))
    phantom(tmp_path / "flight" / "a.jpg", focal_mm=(72, 10), dewarp=None)
    [finding] = audited(capsys, tmp_path / "flight")["findings"]
    assert (finding["rule"], finding["severity"]) == ("K drifted", "error")


def test_units_that_measure_otherwise_want_entries_of_their_own(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"))
    phantom(tmp_path / "flight" / "a.jpg", body_serial=UNIT)
    other = "2019-03-05;3640.5,3635.25,9.5,2.75,-0.268,0.112,0.0008,-0.0001,-0.034"
    phantom(tmp_path / "flight" / "b.jpg", body_serial="0c1d2e3f4a", dewarp=other)
    document = audited(capsys, tmp_path / "flight")
    assert rules(document) == ["units differ"]
    assert "centre" in document["findings"][0]["message"]


def test_units_that_measure_alike_are_one_camera(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"))
    phantom(tmp_path / "flight" / "a.jpg", body_serial=UNIT)
    phantom(tmp_path / "flight" / "b.jpg", body_serial="0c1d2e3f4a")
    assert rules(audited(capsys, tmp_path / "flight")) == []


def test_an_old_calibration_is_told_of_what_flies(
    fleet: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"), "--date", f"{date.today().year - 1}-01-01")
    assert rules(audited(capsys, flight)) == []
    assert rules(audited(capsys, flight, "--stale-after-months", "6"), "warning") == ["calibrated long ago"]


@pytest.mark.usefixtures("fleet")
def test_a_calibration_of_unknown_date_is_never_fresh(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "a.xml"), "--approve")
    document = audited(capsys, flight)
    assert rules(document, "note") == ["calibration date unknown"]
    phantom(tmp_path / "else" / "b.jpg", model="FC330", dewarp=None)
    assert "calibration date unknown" in rules(audited(capsys, tmp_path / "else"), "note")


def test_a_calibration_of_2019_is_of_2019_all_the_way(
    fleet: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "lab.yml"
    file.write_text(OPENCV_2019)
    today = date.today().isoformat()
    add(file, "--approve")
    shown = printed(capsys, "registry-show-1", "show", "fc6310r")
    assert shown["calibration"]["provenance"]["date"][:10] == "2019-03-05"
    assert (shown["recorded"]["date"][:10], shown["recorded"]["file"]) == (today, "lab.yml")
    assert (shown["recorded"]["by"], shown["recorded"]["commit"]) == ("Ada Keeper", commit_of(fleet))
    _, out, _ = run(capsys, "show", "fc6310r")
    text_ = {line.partition("  ")[0]: line for line in out.splitlines()}
    assert "2019-03-05" in text_["provenance.date"]
    assert f"{today} by Ada Keeper, from lab.yml, commit {commit_of(fleet)[:12]}" in " ".join(out.split())
    document = audited(capsys, flight, "--stale-after-months", "24")
    [stale] = [one for one in document["findings"] if one["rule"] == "calibrated long ago"]
    assert "2019-03-05" in stale["message"]
    assert stale["severity"] == "warning"


def test_an_entry_that_did_not_fly_is_a_note(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"))
    add(
        xml(tmp_path / "b.xml", 2900.0, (4000, 3000)),
        "--approve",
        "--date",
        TODAY,
        camera=("--make", "Example", "--model", "One"),
    )
    phantom(tmp_path / "flight" / "a.jpg")
    document = audited(capsys, tmp_path / "flight")
    assert (document["verdict"], rules(document)) == ("clean", ["not flown"])
