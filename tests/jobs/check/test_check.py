"""Whether the K that is about to be used is right, case by case, in the formats that people have lying around."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import calibrary
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.cli.main import main
from calibrary.distortion import BrownConrady
from calibrary.records import replace
from calibrary.schemas import require
from tests.jobs.extract.fleet import NOBODY, P4R, entry, gate, matrix, picture

DEWARP = "2019-03-05;3669.2,3669.2,-4.5,22.75,-0.268,0.112,0.0008,-0.0001,-0.034"
UNIT = Calibration(
    camera=CameraKey(image_size=(5472, 3648)),
    intrinsics=Intrinsics(fx=3669.2, fy=3669.2, cx=2731.5, cy=1846.75, image_size=(5472, 3648)),
    distortion=BrownConrady(k1=-0.268, k2=0.112, p1=0.0008, p2=-0.0001, k3=-0.034),
    grade=Grade.CALIBRATED,
    provenance=Provenance(kind="test"),
)
"""What DEWARP says of this unit."""


def as_xml(calibration: Calibration) -> Callable[[Path], Path]:
    return lambda folder: written(calibration, folder / "lens.xml", "agisoft_xml")


def as_yaml(calibration: Calibration) -> Callable[[Path], Path]:
    return lambda folder: written(calibration, folder / "camera.yml", "opencv_storage")


def as_k(fx: float, cx: float = 2731.5, cy: float = 1846.75) -> Callable[[Path], Path]:
    return lambda folder: matrix(folder / "K.npy", fx, cx, cy)


def as_odm(focal: float) -> Callable[[Path], Path]:
    """ODM's cameras.json: focal length and centre in units of the longer side."""

    def write(folder: Path) -> Path:
        lens = {"k1": -0.268, "k2": 0.112, "p1": 0.0008, "p2": -0.0001, "k3": -0.034}
        size = {"projection_type": "brown", "width": 5472, "height": 3648}
        centre = {"c_x": -4.5 / 5472, "c_y": 22.75 / 5472}
        camera = size | {"focal_x": focal, "focal_y": focal, "focal": focal} | centre | lens
        path = folder / "cameras.json"
        path.write_text(json.dumps({"dji fc6310r 5472 3648 brown 0.6666": camera}))
        return path

    return write


def written(calibration: Calibration, path: Path, form: str) -> Path:
    calibrary.write(calibration, path, format=form)
    return path


def with_k(**numbers: float) -> Calibration:
    return replace(UNIT, intrinsics=replace(UNIT.intrinsics, **numbers))


HALF = UNIT.scaled((2736, 1824))
OTHER_SHAPE = replace(
    UNIT,
    camera=CameraKey(image_size=(4000, 3000)),
    intrinsics=Intrinsics(fx=2290.0, fy=2290.0, cx=2000.0, cy=1500.0, image_size=(4000, 3000)),
)

CALIBRATED: list[tuple[str, Callable[[Path], Path], str, str]] = [
    ("the unit's own, as XML", as_xml(UNIT), "right", "right to 0.00 %"),
    ("the unit's own, as YAML", as_yaml(UNIT), "right", "right to 0.00 %"),
    ("the unit's own, of half-size images", as_xml(HALF), "right", "right to 0.00 %"),
    ("its own, of a size that ODM rounds", as_xml(UNIT.scaled((2048, 1365))), "right", "right to 0.0"),
    ("the unit's own, as a bare K", as_k(3669.2), "right", "does not state the distortion"),
    ("a typed f", as_k(3648.0), "off", "off by 0.58 %, 58 cm of height at 100 m"),
    ("a typed f in XML", as_xml(with_k(fx=3648.0, fy=3648.0)), "off", "off by 0.58 %, 58 cm of height"),
    ("a typed f and a typed centre", as_k(3648.0, 2736.0, 1824.0), "off", "off by 0.58 %"),
    ("ODM's, of this unit", as_odm(3669.2 / 5472), "right", "right to 0.00 %"),
    ("ODM's, of a flight over flat ground", as_odm(0.66), "off", "off by 1.57 %"),
    ("its centre moved", as_xml(with_k(cx=2781.5)), "off", "at most over the frame"),
    ("a 35 mm equivalent", as_k(24.0 / 36.0 * 5472 * 2), "off", "off by 98.84 %"),
    ("of another sensor shape", as_xml(OTHER_SHAPE), "off", "for images of 4000×3000"),
    ("of another camera by name", lambda folder: entry(folder, model="FC330"), "off", "of FC330"),
]
"""Against the calibration that the images carry."""

DERIVED: list[tuple[str, Callable[[Path], Path], str, str]] = [
    ("a calibration of this unit", as_xml(UNIT), "right", "they state it to ±3%"),
    ("a bare K within what is known", as_k(3648.0), "right", "they state it to ±3%"),
    ("a calibration with the pixel's centre as origin", as_k(3666.67, 2735.5, 1823.5), "right", "±3%"),
    ("another lens", as_k(4648.0), "off", "off by 26.77 %"),
    ("a centre that no lens has", as_k(3666.67, 2736.0 + 400), "off", "at most over the frame"),
]
"""Against focal length ÷ pitch, which is known to a few per cent."""


def flight(folder: Path, dewarp: str | None) -> Path:
    for number in range(3):
        picture(folder / "flight" / f"DJI_{number:04}.JPG", **P4R, dewarp=dewarp)
    return folder / "flight"


def checked(images: Path, file: Path, verdict: str, said: str) -> None:
    result = calibrary.check(images, file)
    [one] = result.files
    assert (one.verdict.value, result.is_right) == (verdict, verdict == "right")
    assert said in one.message


@pytest.mark.parametrize(("_name", "write", "verdict", "said"), CALIBRATED, ids=[c[0] for c in CALIBRATED])
def test_against_the_images_own_calibration(
    tmp_path: Path, _name: str, write: Callable[[Path], Path], verdict: str, said: str
) -> None:
    checked(flight(tmp_path, DEWARP), write(tmp_path), verdict, said)


@pytest.mark.parametrize(("_name", "write", "verdict", "said"), DERIVED, ids=[c[0] for c in DERIVED])
def test_against_a_derived_k(
    tmp_path: Path, _name: str, write: Callable[[Path], Path], verdict: str, said: str
) -> None:
    checked(flight(tmp_path, None), write(tmp_path), verdict, said)


def test_a_profile_of_a_kind_of_lens_is_never_right(tmp_path: Path) -> None:
    rows = "".join(f'<distortion model="poly3" focal="{mm}" k1="-0.01"/>' for mm in (8.7, 8.8, 35))
    path = tmp_path / "mil-dji.xml"
    path.write_text(
        "<lensdatabase><lens><maker>DJI</maker><model>8.8 mm</model><cropfactor>2.727</cropfactor>"
        f"<aspect-ratio>3:2</aspect-ratio><calibration>{rows}</calibration></lens></lensdatabase>"
    )
    checked(
        flight(tmp_path, DEWARP), path, "unknown", "a start only, of grade prior, the nearest of 2 that fit"
    )


def test_images_without_a_valid_k_decide_nothing(tmp_path: Path) -> None:
    picture(tmp_path / "flight" / "a.jpg", **NOBODY)
    checked(
        tmp_path / "flight",
        as_k(5472.0)(tmp_path),
        "unknown",
        "nothing in the images states a K",
    )


def test_a_calibration_without_images_decides_nothing(tmp_path: Path) -> None:
    [one] = calibrary.check(as_xml(UNIT)(tmp_path)).files
    assert (one.verdict.value, one.message) == ("unknown", "there are no images here to compare it with")


def test_one_k_for_two_cameras_is_right_for_one(tmp_path: Path) -> None:
    images = flight(tmp_path, DEWARP)
    picture(images / "wide.jpg", (5472, 3648), make="DJI", model="FC6520", focal_mm=(150, 10), focal_35mm=30)
    verdicts = [one.verdict.value for one in calibrary.check(images, as_k(3669.2)(tmp_path)).files]
    assert verdicts.count("right") == 1
    assert len(verdicts) == 2


class TestTheCommand:
    def test_its_exit_code_and_its_last_line_are_the_answer(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        images = flight(tmp_path, DEWARP)
        assert main(["check", str(images), str(as_k(3648.0)(tmp_path))]) == 1
        printed = " ".join(capsys.readouterr().out.split())
        assert "the K you are about to use is off by 0.58 %, 58 cm of height at 100 m" in printed
        assert main(["check", str(images), str(as_xml(UNIT)(tmp_path))]) == 0
        assert "the K you are about to use is right" in capsys.readouterr().out

    def test_a_height_of_its_own(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        images = flight(tmp_path, DEWARP)
        assert main(["check", str(images), str(as_k(3648.0)(tmp_path)), "--altitude-m", "50"]) == 1
        assert "29 cm of height at 50 m" in " ".join(capsys.readouterr().out.split())

    def test_its_json_is_of_its_schema(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        images = flight(tmp_path, DEWARP)
        assert main(["check", str(images), str(as_k(3648.0)(tmp_path)), "--json"]) == 1
        report = json.loads(capsys.readouterr().out)
        require(report, "check-1")
        assert report["exit_code"] == 1
        assert report["files"][0]["height_cm"] == pytest.approx(-57.8, abs=0.1)

    def test_without_a_file_it_takes_what_lies_with_the_images(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        images = flight(tmp_path, DEWARP)
        assert main(["check", str(images)]) == 3
        assert "name the one that is to be used" in capsys.readouterr().err
        as_odm(0.66)(images)
        assert main(["check", str(images)]) == 1

    def test_a_file_that_is_none_is_an_error(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert main(["check", str(flight(tmp_path, DEWARP)), str(tmp_path / "nowhere.xml")]) == 3
        assert "nowhere.xml" in capsys.readouterr().err


class TestBesideTheImages:
    """extract says what is about to be used and is wrong; it changes neither K nor the exit code."""

    @pytest.mark.parametrize("write", [as_k(3648.0), as_odm(0.66), as_xml(with_k(fx=3648.0, fy=3648.0))])
    def test_a_file_that_contradicts_the_images_is_told(
        self, tmp_path: Path, write: Callable[[Path], Path]
    ) -> None:
        images = flight(tmp_path, DEWARP)
        name = write(images).name
        outcome = gate(images)
        [warning] = outcome.warnings
        assert warning.startswith(f"beside the images, but not used: {name}: off by ")
        assert "px at most over the frame" in warning
        assert "of height at 100 m" in warning
        assert outcome.exit_code == 0
        calibration = outcome.cameras[0].calibration
        assert calibration is not None
        assert calibration.intrinsics.fx == 3669.2

    def test_one_that_agrees_is_not(self, tmp_path: Path) -> None:
        images = flight(tmp_path, DEWARP)
        as_xml(UNIT)(images)
        np.save(images / "K_matrix_seed.npy", np.diag([4000.0, 4000.0, 1.0]))
        assert gate(images).warnings == ()
