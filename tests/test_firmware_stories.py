"""What a firmware update does to a camera, story by story, and whether it raises an alarm."""

from __future__ import annotations

from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from calibrary import parsers
from calibrary.calib.estimation import estimate
from calibrary.calibration import Calibration
from calibrary.cli.main import main
from calibrary.jobs.diff.comparison import ChangeVerdict, compare
from calibrary.jobs.diff.verdicts import Kind
from calibrary.records import replace
from calibrary.registry.init import init
from calibrary.registry.registry import Registry
from tests.calib.solving import Session, camera, shoot
from tests.cli.registry.fleets import add, commit_of, xml
from tests.imagery import XmpDescription, XmpPacket, elements, write_jpeg
from tests.imagery.cameras import Band, Shot, rededge_m
from tests.imagery.xmp import PIX4D_1
from tests.jobs.extract.fleet import DEWARP, P4R, gate, only, picture
from tests.registry.git.repositories import nobodys_git

__all__ = ["nobodys_git"]

TWENTY = Session(views=20)
TRUE = camera()


@cache
def calibrated(stretch: float, seed: int) -> Calibration:
    """A calibration from corners of a board, its covariance with it, of a lens so much longer than the true one."""
    K = TRUE.intrinsics
    lens = replace(TRUE, intrinsics=replace(K, fx=K.fx * stretch, fy=K.fy * stretch))
    return estimate(shoot(lens, TWENTY, seed)).calibration


def read(path: Path) -> Calibration:
    """What an image's metadata yields."""
    [found] = parsers.read(path)
    return found


def test_an_update_that_changes_the_focal_length_by_a_thousandth_raises_the_alarm() -> None:
    found = compare(calibrated(1.0, 1), calibrated(1.001, 3))
    assert (found.verdict, found.alarm) == (ChangeVerdict.DRIFT, True)
    assert found.numbers is not None
    assert found.numbers.focal_change == pytest.approx(0.001, rel=0.25)
    assert found.detail is not None
    assert found.detail.spread_a.covariance is not None


def test_calibrating_once_more_raises_none() -> None:
    found = compare(calibrated(1.0, 1), calibrated(1.0, 2))
    assert (found.verdict, found.alarm) == (ChangeVerdict.NOISE, False)


def flagged(flag: str) -> dict[str, Any]:
    """A Phantom 4 RTK's tags, and whether it has undistorted the frame itself."""
    return {**P4R, "dewarp": DEWARP, "drone_dji:DewarpFlag": flag}


def test_dewarp_switched_on_in_the_camera_is_a_change_of_kind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = picture(tmp_path / "old.jpg", **flagged("0"))
    new = picture(tmp_path / "new.jpg", **flagged("1"))
    found = compare(read(old), read(new))
    assert [one.kind for one in found.structural] == [Kind.DEWARP_ON]
    assert main(["diff", str(old), str(new)]) == 1
    assert "dewarp switched on" in capsys.readouterr().out


def test_a_16_9_mode_is_a_crop(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old = picture(tmp_path / "old.jpg", **P4R, dewarp=DEWARP)
    new = picture(tmp_path / "new.jpg", (5472, 3078), **P4R, dewarp=DEWARP)
    found = compare(read(old), read(new))
    assert (found.verdict, found.alarm) == (ChangeVerdict.STRUCTURAL, True)
    assert [one.kind for one in found.structural] == [Kind.CROP]
    assert main(["diff", str(old), str(new)]) == 1
    assert "crop" in capsys.readouterr().out


BLUE = Band(
    name="Blue",
    index=0,
    wavelength_nm=475,
    width_nm=20,
    focal_mm=5.4416,
    principal_point_mm=(2.40852, 1.80961),
    distortion=(-0.098214, 0.143107, -0.027352, 0.000261, 0.000518),
)
PX_PER_MM = 266.666667


def test_millimetres_where_pixels_stood_are_the_same_camera(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shot = Shot(
        taken=datetime(2024, 5, 17, 9, 30), latitude_deg=1.0, longitude_deg=2.0, altitude_m=80.0, yaw_deg=0.0
    )
    head = rededge_m(shot, BLUE)
    # Firmware 2 wrote the focal length in pixels, and no unit; the principal point was in millimetres all along.
    in_pixels = elements(
        PIX4D_1,
        BandName=BLUE.name,
        ModelType="perspective",
        PrincipalPoint="{:.5f},{:.5f}".format(*BLUE.principal_point_mm),
        PerspectiveFocalLength=f"{BLUE.focal_mm * PX_PER_MM:.10f}",
        PerspectiveDistortion=tuple(f"{value:.12f}" for value in BLUE.distortion),
        RigCameraIndex="0",
    )
    assert head.exif is not None
    firmware_2 = XmpPacket(descriptions=(XmpDescription(items=in_pixels),))
    old = write_jpeg(
        tmp_path / "old.jpg", (1280, 960), exif=replace(head.exif, software="v2.1.2"), xmp=firmware_2
    )
    new = write_jpeg(tmp_path / "new.jpg", (1280, 960), exif=head.exif, xmp=head.xmp)
    found = compare(read(old), read(new))
    assert not found.alarm
    assert found.structural == ()
    assert found.numbers is not None
    assert abs(found.numbers.focal_change) < 1e-6
    assert main(["diff", str(old), str(new)]) == 0
    capsys.readouterr()


THERMAL: dict[str, Any] = {"make": "DJI", "model": "ZH20N", "drone_dji:ImageSource": "InfraredCamera"}
RIGHT: dict[str, Any] = {**THERMAL, "focal_mm": (12, 1), "focal_35mm": 52, "software": "07.00.01.05"}
WRONG: dict[str, Any] = {**THERMAL, "focal_mm": (6, 1), "focal_35mm": 29, "software": "04.00.00.80"}
"""The starlight camera's focal length, which one firmware writes into the thermal camera's images."""
FRAME = (640, 512)
NAMED = ("--make", "DJI", "--model", "ZH20N", "--sub-camera", "thermal")


@pytest.fixture
def fleet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A registry whose entry of the thermal camera, 1004 px, was measured."""
    init(tmp_path / "fleet")
    monkeypatch.setenv("CALIBRARY_REGISTRY", str(tmp_path / "fleet"))
    monkeypatch.chdir(tmp_path)
    add(xml(tmp_path / "lab.xml", 1004.0, FRAME, 2.0), "--approve", camera=NAMED)
    return tmp_path / "fleet"


def thermal(folder: Path, tags: dict[str, Any]) -> Path:
    """A flight of the thermal camera."""
    folder.mkdir()
    picture(folder / "DJI_0001_T.JPG", FRAME, **tags)
    return folder


def test_another_lens_in_exif_is_no_k_at_the_gate(tmp_path: Path) -> None:
    assert only(gate(thermal(tmp_path / "right", RIGHT))).verdict.value == "valid"
    wrong = only(gate(thermal(tmp_path / "wrong", WRONG)))
    assert wrong.verdict.value != "valid"


def test_another_lens_in_exif_is_caught_by_the_audit_and_the_entry_stays(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = commit_of(fleet)
    assert main(["registry", "audit", str(thermal(tmp_path / "right", RIGHT))]) == 0
    capsys.readouterr()
    assert main(["registry", "audit", str(thermal(tmp_path / "wrong", WRONG))]) == 1
    assert "FocalLengthIn35mmFilm states fx = 549.3 px, -45.3%" in capsys.readouterr().out
    assert commit_of(fleet) == before


def test_another_lens_in_exif_is_refused_on_board_and_the_entry_stays(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = commit_of(fleet)
    assert main(["onboard", str(thermal(tmp_path / "wrong", WRONG)), "--yes"]) == 1
    assert "refused" in capsys.readouterr().out
    assert commit_of(fleet) == before
    assert [one.entry.calibration.intrinsics.fx for one in Registry.open(fleet).snapshot().entries()] == [
        1004.0
    ]


def test_a_measurement_and_the_registry_outvote_another_lens_in_exif(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    payload = thermal(tmp_path / "wrong", WRONG)
    measured_anew = xml(payload / "new.xml", 1002.0, FRAME, 2.3)
    measured_anew.write_text(measured_anew.read_text().replace("-0.1<", "-0.102<").replace("7.25", "7.0"))
    assert main(["onboard", str(payload), "--yes"]) == 0
    assert "not believed" in capsys.readouterr().out
    [proposed] = [
        one.entry.calibration for one in Registry.open(fleet).snapshot("onboard/dji-zh20n").proposals()
    ]
    # What nobody believes is no part of the key by which the camera will be found either.
    assert (proposed.intrinsics.fx, proposed.camera.focal_mm) == (1002.0, None)
