"""What enters the solve: every true board up to the frame's edge, by strong lenses too; what is no board does not."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.detection import detect
from calibrary.calib.detectors.reliability import reliable
from calibrary.calib.estimation import estimate
from calibrary.calib.found import Found, NotFound, Reason
from calibrary.calib.lattice import beyond, smoothed
from calibrary.calib.lens_models import Solvable
from calibrary.calib.synthesis import Settings, poses, render, seen_corners
from calibrary.calibration import Calibration
from calibrary.distortion import KannalaBrandt
from calibrary.records import replace
from calibrary.validation import Use
from tests.thorough import every

from .observing import observe
from .photographs import Gray
from .solving import BOARD, camera

SMALL = Board(columns=9, rows=6, square_mm=40.0)
PLACES: FloatArray = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
"""The column and the row of each corner of SMALL, row by row."""
SIZE = (640, 480)


def _fisheye(degrees: float, radius_px: float, size: tuple[int, int] = SIZE) -> Calibration:
    """A lens that shows half of its field at that distance from the middle."""
    lens = KannalaBrandt(k1=0.01, k2=-0.004, k3=0.0005, k4=0.0)
    half = np.radians(degrees / 2)
    f = radius_px / (half * (1 + 0.01 * half**2 - 0.004 * half**4 + 0.0005 * half**6))
    return camera(size, fx=f, fy=f, distortion=lens)


@cache
def _photographs(degrees: int, *, circular: bool) -> tuple[tuple[Gray, FloatArray], ...]:
    by = _fisheye(degrees, 0.485 * SIZE[1] if circular else SIZE[0] / 2)
    taken = []
    for number, pose in enumerate(poses(SMALL, by, 10, 3, 35.0, (0.5, 1.1), roll_deg=180.0)):
        frame = render(SMALL, by, pose, Settings(), number)
        taken.append(
            (frame.astype(np.uint8), seen_corners(SMALL, by, pose, Settings().sheet, Settings().shutter))
        )
    return tuple(taken)


@pytest.mark.parametrize(("degrees", "circular"), every(3, [(180, True), (150, False), (190, False)]))
def test_boards_before_a_fisheye_are_found_up_to_the_edge(degrees: int, circular: bool) -> None:
    right = 0
    for frame, truth in _photographs(degrees, circular=circular):
        found = detect(frame, SMALL)
        if isinstance(found, NotFound):
            continue
        # A board of odd and even sides looks the same turned by half only where colours do not tell.
        off = min(
            float(np.median(np.hypot(*(found.points - at[found.ids]).T))) for at in (truth, truth[::-1])
        )
        right += off < 0.15
    assert right >= 9


def test_rows_go_on_as_they_bend() -> None:
    x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
    bent = np.stack([30 * x + 0.8 * y**2, 30 * y + 0.5 * (x - 3) ** 2 - 1.2 * y**2], axis=-1)
    outer = beyond(bent, (-1.0, 0.0))
    np.testing.assert_allclose(outer[0, :, 1], -30 + 0.5 * (x[0] - 3) ** 2 - 1.2, atol=1e-9)
    np.testing.assert_allclose(outer[1], bent[0], atol=1e-9)


def test_a_strong_bend_is_smooth() -> None:
    at = (PLACES - (4.0, 2.5)) * 60
    r2 = (at**2).sum(axis=1, keepdims=True) / 300**2
    seen = at * (1 - 0.3 * r2 + 0.05 * r2**2) + (320, 240)
    fitted = smoothed(PLACES, seen, np.ones(54, dtype=np.bool_), strongly=True)
    assert fitted is not None
    assert np.abs(fitted - seen).max() < 0.3


def _judged(by_px: FloatArray) -> Found | NotFound:
    points = PLACES * 40.0 + (160, 140) + by_px
    gray = np.full((480, 640), 128, dtype=np.uint8)
    return reliable(gray, SMALL, np.arange(54), points, half=5, spacing_px=40.0)


def test_a_doubtful_view_enters_whole_and_says_so() -> None:
    rng = np.random.default_rng(1)
    by = rng.normal(0, 0.05, (54, 2))
    by[rng.permutation(54)[:14]] += rng.normal(0, 12.0, (14, 2))
    found = _judged(by)
    assert isinstance(found, Found)
    assert len(found.ids) == 54
    assert [(remark.reason, remark.rejects) for remark in found.remarks] == [(Reason.UNEVEN, False)]


def test_a_few_displaced_points_are_left_out_one_by_one() -> None:
    by = np.random.default_rng(1).normal(0, 0.05, (54, 2))
    by[[7, 40]] += (4.0, -3.0)
    found = _judged(by)
    assert isinstance(found, Found)
    assert sorted(set(range(54)) - set(found.ids.tolist())) == [7, 40]


def test_points_at_random_are_no_board() -> None:
    found = _judged(np.random.default_rng(1).normal(0, 30.0, (54, 2)))
    assert isinstance(found, NotFound)
    assert found.reason is Reason.UNEVEN


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_circular_fisheye_is_solved_as_one(seed: int) -> None:
    size = (1280, 960)
    truth = _fisheye(180, 466.0, size)
    seen = observe(BOARD, truth, poses(BOARD, truth, 18, seed, 35.0, (0.25, 0.8), roll_deg=180.0), 0.05, seed)
    middle = (truth.intrinsics.cx, truth.intrinsics.cy)
    views = []
    for view in seen.views:
        inside = np.hypot(*(view.image_points - middle).T) < 452
        views.append(replace(view, ids=view.ids[inside], image_points=view.image_points[inside]))
    result = estimate(replace(seen, views=tuple(views)))
    assert result.model is Solvable.FISHEYE
    assert result.verdict is not Use.NONE
    assert result.calibration.intrinsics.fx == pytest.approx(truth.intrinsics.fx, rel=5e-4)
