"""Which sensor size counts: the one that was stated for one camera, the catalogue's, or an assumption."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.errors import UsageError
from calibrary.evidence.context import Source
from calibrary.jobs.extract.extraction import JudgedCamera
from calibrary.policy import SOURCE
from calibrary.validation import Verdict
from tests.jobs.extract.fleet import NOBODY, P4R, gate, only, picture


def focal_px(camera: JudgedCamera) -> tuple[float, float]:
    assert camera.calibration is not None
    return camera.calibration.intrinsics.fx, camera.calibration.intrinsics.fy


def source_of(camera: JudgedCamera) -> Source:
    assert camera.camera.evidence.chosen is not None
    return camera.camera.evidence.chosen.source


def test_a_stated_sensor_decides_for_one_camera(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", **NOBODY)
    camera = only(gate(tmp_path, sensor_mm=(13.0, 8.7)))
    assert focal_px(camera) == ((13.2 / 13.0) * 5472, (13.2 / 8.7) * 3648)
    assert source_of(camera) is Source.GIVEN_SENSOR


def test_a_stated_sensor_wins_over_the_catalogue(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", **P4R)
    camera = only(gate(tmp_path, sensor_mm=(13.2, 8.8)))
    assert focal_px(camera)[0] == (8.8 / 13.2) * 5472
    assert source_of(camera) is Source.GIVEN_SENSOR


@pytest.mark.parametrize("sensor_mm", [(13.2, None), (None, 8.8)])
def test_one_stated_side_means_square_pixels(
    tmp_path: Path, sensor_mm: tuple[float | None, float | None]
) -> None:
    picture(tmp_path / "a.jpg", (4000, 3000), **NOBODY)
    fx, fy = focal_px(only(gate(tmp_path, sensor_mm=sensor_mm)))
    stated = 13.2 / 13.2 * 4000 if sensor_mm[0] is not None else 13.2 / 8.8 * 3000
    assert fx == pytest.approx(stated, rel=1e-15)
    assert fy == pytest.approx(stated, rel=1e-15)


def test_a_stated_sensor_is_refused_for_several_cameras(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", **P4R)
    picture(tmp_path / "b.jpg", **NOBODY)
    with pytest.raises(UsageError, match=r"DJI FC6310R.*Example One.*--sensor CAMERA=WxH"):
        gate(tmp_path, sensor_mm=(6.3, 4.7))


def test_each_camera_of_a_run_has_a_sensor_of_its_own(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", **NOBODY)
    picture(tmp_path / "b.jpg", **{**NOBODY, "model": "Two"})
    outcome = gate(tmp_path, sensors={"one": "13.2x8.8", "Example Two": "17.3×11.53"})
    assert {camera.camera.key.model: source_of(camera) for camera in outcome.judged} == dict.fromkeys(
        ("One", "Two"), Source.GIVEN_SENSOR
    )
    focal = {camera.camera.key.model: focal_px(camera) for camera in outcome.judged}
    assert focal["One"] == pytest.approx((5472.0, 5472.0))
    assert focal["Two"] == pytest.approx((13.2 / 17.3 * 5472, 13.2 / 11.53 * 3648))


@pytest.mark.parametrize(
    "sensors", [{"Three": "13.2x8.8"}, {"One": "13.2"}, {"One": "wide"}, {"One": "0x8.8"}]
)
def test_a_sensor_of_no_camera_or_of_no_size_ends_the_run(tmp_path: Path, sensors: dict[str, str]) -> None:
    picture(tmp_path / "a.jpg", **NOBODY)
    with pytest.raises(UsageError, match="--sensor"):
        gate(tmp_path, sensors=sensors)


def test_one_camera_in_many_states_is_still_one_camera(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", **NOBODY, software="1")
    picture(tmp_path / "b.jpg", **NOBODY, software="2")
    outcome = gate(tmp_path, sensor_mm=(13.2, 8.8))
    assert outcome.warnings == ()
    assert source_of(only(outcome)) is Source.GIVEN_SENSOR


def test_an_assumed_sensor_is_unproven_under_fleet_and_both_ways_out_are_told(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", **NOBODY)
    outcome = gate(tmp_path)
    camera = only(outcome)
    assert (camera.verdict, outcome.exit_code) == (Verdict.UNPROVEN, 1)
    assert focal_px(camera) == ((13.2 / 13.2) * 5472, (13.2 / 8.8) * 3648)
    assert camera.calibration is not None
    assert camera.calibration.provenance.assumptions == ("the sensor is 13.2 × 8.8 mm",)
    assert camera.advice is not None
    assert "--sensor One=WxH" in camera.advice
    assert "register the camera" in camera.advice


def test_under_source_an_assumed_sensor_is_judged_by_the_numbers_alone(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", **NOBODY)
    outcome = gate(tmp_path, policy=SOURCE)
    assert (only(outcome).verdict, outcome.exit_code) == (Verdict.VALID, 0)
    picture(tmp_path / "a.jpg", **(NOBODY | {"focal_mm": (88, 10)}))
    outcome = gate(tmp_path, policy=SOURCE)
    assert (only(outcome).verdict, outcome.exit_code) == (Verdict.REJECTED, 1)


def test_a_known_camera_never_gets_the_default_sensor(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", (4000, 3000), make="DJI", model="FC330", focal_mm=(361, 100))
    camera = only(gate(tmp_path, policy=SOURCE))
    assert all(w.source is not Source.ASSUMED_SENSOR for w in camera.camera.evidence.estimates)


def test_no_sensor_makes_a_k_without_a_focal_length(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", make="Example", model="One")
    with pytest.raises(UsageError, match="--focal-mm"):
        gate(tmp_path, sensor_mm=(13.2, 8.8))


def test_a_sensor_that_was_given_is_not_asked_for_again(tmp_path: Path) -> None:
    """A 19 mm lens over 7.68 mm is 2.47 W, where a sensor that is given does not prove K alone."""
    picture(tmp_path / "a.jpg", (640, 512), make="Example", model="One", focal_mm=(19, 1))
    camera = only(gate(tmp_path, sensor_mm=(7.68, 6.144)))
    assert camera.verdict is Verdict.UNPROVEN
    assert camera.advice is not None
    assert "--sensor" not in camera.advice
    assert "--verify" in camera.advice
