"""calibrary.calibrate: frames of a board in; a verdict, its findings, what was skipped, and progress out."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path
from typing import Any

import pytest

import calibrary
from calibrary.arguments import Stated
from calibrary.errors import CalibrationError, InputError
from calibrary.records import encoded
from calibrary.schemas import require
from calibrary.validation import Use

BOARD = "checkerboard:9x6"


@pytest.fixture(scope="module")
def steps() -> list[tuple[int, int, str]]:
    return []


@pytest.fixture(scope="module")
def result(furnished: Path, steps: list[tuple[int, int, str]]) -> calibrary.CalibrateReport:
    return calibrary.calibrate(
        furnished / "frames",
        board=BOARD,
        square_mm=40,
        lens_model="k1k2",
        stated=Stated(date=date(2024, 5, 6), operator="A. Surveyor"),
        camera=calibrary.CameraKey(model="Board Two"),
        progress=lambda done, total, what: steps.append((done, total, what)),
    )


def test_it_says_how_far_to_trust_the_camera_and_why(result: calibrary.CalibrateReport) -> None:
    assert result.verdict is Use.FIXED
    assert result.is_good
    assert "few-views" in {finding.rule for finding in result.findings}
    assert all(finding.message for finding in result.findings)
    assert result.skipped == ()


def test_what_is_stated_is_in_the_calibration(result: calibrary.CalibrateReport) -> None:
    own = result.calibration
    assert (own.camera.make, own.camera.model) == ("Example", "Board Two")
    assert (own.provenance.date, own.provenance.operator) == ("2024-05-06", "A. Surveyor")
    assert own.distortion is not None
    assert own.quality is not None
    assert own.quality.covariance is not None


@pytest.mark.usefixtures("result")
def test_progress_is_told_as_so_many_of_so_many(steps: list[tuple[int, int, str]]) -> None:
    assert steps[0] == (0, 10, "frames")
    assert steps[-1] == (10, 10, "frames")
    assert [done for done, _, _ in steps] == sorted(done for done, _, _ in steps)


def test_it_is_plain_data_by_the_commands_schema(result: calibrary.CalibrateReport) -> None:
    require(json.loads(encoded(result)), "calibration-result-3", source="record")


def test_a_model_that_is_not_there_is_refused_before_any_frame_is_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no lens model 'pinhole'; expected auto, k1k2"):
        calibrary.calibrate(tmp_path / "nowhere", square_mm=40, lens_model="pinhole")  # type: ignore[arg-type]


def test_frames_without_the_board_are_no_calibration(furnished: Path) -> None:
    frames = sorted((furnished / "frames").glob("*.jpg"))[:2]
    with pytest.raises(CalibrationError):
        calibrary.calibrate(frames, board="checkerboard:5x4", square_mm=40)


def test_saved_corners_are_solved_as_their_frames_were(
    result: calibrary.CalibrateReport, furnished: Path, tmp_path: Path
) -> None:
    path = tmp_path / "corners.json"
    first = calibrary.calibrate(
        furnished / "frames", board=BOARD, square_mm=40, lens_model="k1k2", keep_corners=path
    )
    assert first.calibration.intrinsics == result.calibration.intrinsics
    again = calibrary.calibrate(corners=path, lens_model="k1k2", stated=Stated(date=date(2024, 5, 6)))
    assert again.calibration.intrinsics == result.calibration.intrinsics
    assert again.calibration.distortion == result.calibration.distortion
    assert again.calibration.provenance.source == "corners.json"


@pytest.mark.parametrize("given", [{}, {"frames": "a", "corners": "b"}, {"corners": "a", "points": "b"}])
def test_frames_corners_and_points_exclude_one_another(given: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="one of them only"):
        calibrary.calibrate(**given)


def test_what_frames_and_points_need_is_named(tmp_path: Path) -> None:
    (tmp_path / "corners.csv").write_text("image,x,y")
    with pytest.raises(InputError, match="--board"):
        calibrary.calibrate(corners=tmp_path / "corners.csv")
    with pytest.raises(InputError, match="--image-size"):
        calibrary.calibrate(points=tmp_path / "gcp.csv")


def test_make_and_model_are_asked_for_before_frames_are_searched(furnished: Path) -> None:
    with pytest.raises(InputError, match="make"):
        calibrary.calibrate(
            furnished / "frames",
            square_mm=40,
            camera=lambda _: calibrary.CameraKey(),
            registry=furnished / "fleet",
        )
