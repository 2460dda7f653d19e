"""Grids of discs whose every second row is staggered, as OpenCV counts them."""

from __future__ import annotations

import re
from functools import cache

import cv2
import numpy as np
import pytest

from calibrary.arrays import FloatArray
from calibrary.calib.board import parse_board
from calibrary.calib.detection import detect
from calibrary.calib.estimation import estimate
from calibrary.calib.found import Found, NotFound
from calibrary.calib.printing import lay_out, to_pdf, to_svg
from calibrary.calib.synthesis import Settings, poses, render, seen_corners
from tests.calib.photographs import CAMERA, Gray, photograph
from tests.calib.solving import Session, camera, shoot
from tests.thorough import every

BOARD = parse_board("acircles:4x11", 20.0)


@cache
def frame(number: int) -> tuple[Gray, FloatArray]:
    pose = poses(BOARD, CAMERA, number + 1, 5, 30.0, (0.6, 0.9))[number]
    settings = Settings(noise=2.0)
    gray = render(BOARD, CAMERA, pose, settings, number).astype(np.uint8)
    return np.ascontiguousarray(gray), seen_corners(BOARD, CAMERA, pose, settings.sheet, settings.shutter)


def test_points_are_staggered_as_opencv_generates_them() -> None:
    # samples/cpp/tutorial_code/calib3d/camera_calibration: Point3f((2*j + i % 2)*squareSize, i*squareSize, 0)
    expected = [((2 * j + i % 2) * 20.0, i * 20.0, 0.0) for i in range(11) for j in range(4)]
    np.testing.assert_array_equal(BOARD.points, expected)
    assert BOARD.extent == (140.0, 200.0)


@pytest.mark.parametrize("number", every(3, [1, 2, 3]))
def test_centres_lie_nearer_to_the_truth_than_opencvs(number: int) -> None:
    gray, truth = frame(number)
    found = detect(gray, BOARD)
    assert isinstance(found, Found)
    assert found.ids.tolist() == list(range(44))
    own = np.hypot(*(found.points - truth).T)
    there, centres = cv2.findCirclesGrid(gray, (4, 11), flags=cv2.CALIB_CB_ASYMMETRIC_GRID)
    assert there
    theirs = np.hypot(*(np.reshape(centres, (-1, 2)) + 0.5 - truth).T)
    # OpenCV gives the middle of the ellipse, which is not where the disc's centre is seen.
    assert own.mean() < 0.7 * theirs.mean()
    assert own.max() < 0.5


def test_another_board_is_none() -> None:
    assert isinstance(detect(photograph()[0], BOARD), NotFound)
    assert isinstance(detect(photograph("circles:7x6")[0], BOARD), NotFound)


def test_a_camera_is_solved_from_them() -> None:
    board = parse_board("acircles:6x13", 25.0)
    result = estimate(shoot(how=Session(views=14), seed=2, board=board), "brown")
    assert abs(result.calibration.intrinsics.fx / camera().intrinsics.fx - 1) < 1e-3


def test_they_are_printed_where_they_are() -> None:
    page = lay_out(BOARD)
    svg = to_svg(BOARD, page).decode()
    centres = [(float(x), float(y)) for x, y in re.findall(r'<circle cx="([\d.]+)" cy="([\d.]+)" r="8"', svg)]
    x, y = page.origin_mm
    np.testing.assert_allclose(centres, BOARD.points[:, :2] + (x, y), atol=1e-3)
    assert b"acircles:4x11 --square-mm 20 --marker-mm 16" in to_pdf(BOARD, page)
