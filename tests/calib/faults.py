"""Sessions with a fault in them: of the camera, of the board, of how it was held."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.observations import Observations, View
from calibrary.calib.synthesis import Pose, Shutter, poses
from calibrary.calibration import Calibration
from calibrary.records import replace

from .observing import observe
from .solving import BOARD, SIZE, Session, camera, shoot

VIEWS = 20
SIGMA_PX = 0.05


def rolling(seed: int = 4, rate_deg_s: float = 3.0) -> Observations:
    """A shutter that reads row after row while the camera turns, in each view in another way."""
    rng, views = np.random.default_rng(seed), []
    for index, pose in enumerate(_held(seed)):
        a, b, c = rng.normal(0, rate_deg_s, 3)
        shutter = Shutter(readout_s=0.03, rate_deg_s=(a, b, c))
        seen = observe(BOARD, camera(), [pose], SIGMA_PX, index, shutter=shutter)
        views.append(replace(seen.views[0], name=f"{index}.jpg"))
    return replace(seen, views=tuple(views))


def refocusing(seed: int = 4, spread: float = 0.002) -> Observations:
    """An autofocus that settles at another focal length in each view."""
    rng = np.random.default_rng(seed)
    return _each_by(seed, [_zoomed(1 + spread * rng.normal()) for _ in range(VIEWS)])


def two_zooms(seed: int = 4, ratio: float = 1.01) -> Observations:
    """Every other view through a lens that stands at another zoom."""
    return _each_by(seed, [_zoomed(ratio if index % 2 else 1.0) for index in range(VIEWS)])


def stabilised(seed: int = 4, shift_px: float = 12.0) -> Observations:
    """Electronic stabilisation: the frame is another part of the sensor each time."""
    rng = np.random.default_rng(seed)
    return _each_by(seed, [_shifted(*rng.normal(0, shift_px, 2)) for _ in range(VIEWS)])


def twisted(seed: int = 4, lift_mm: float = 1.0) -> Observations:
    """A board twisted like a propeller: two opposite corners stand forward, the others back."""
    u, v = _unit()
    return _lifted(seed, lift_mm * u * v)


def bumped(seed: int = 4, lift_mm: float = 0.5) -> Observations:
    """A local bump in a board that is flat otherwise."""
    u, v = _unit()
    return _lifted(seed, lift_mm * np.exp(-(((u - 0.4) / 0.3) ** 2 + ((v + 0.2) / 0.4) ** 2)))


def s_curved(seed: int = 4, lift_mm: float = 0.5) -> Observations:
    """A board that bends one way on its left and the other way on its right."""
    return _lifted(seed, lift_mm * np.sin(np.pi * _unit()[0]))


def flexing(seed: int = 4, lift_mm: float = 0.6) -> Observations:
    """A sheet that bends in another way in each view, as one does that is held in the hand."""
    rng = np.random.default_rng(seed)
    u, v = _unit()
    lifts = [
        lift_mm * (a * (1 - u**2) + b * (1 - v**2) + c * u * v) for a, b, c in rng.normal(0, 1, (VIEWS, 3))
    ]
    return _seen(seed, [camera()] * VIEWS, lifts)


def blurred(seed: int = 4, share: float = 0.5, along_px: float = 0.5) -> Observations:
    """A camera that moves while its shutter is open: corners of some views uncertain along one direction."""
    sharp, rng = shoot(how=Session(views=VIEWS), seed=seed), np.random.default_rng([seed, 5])
    views = []
    for view in sharp.views:
        angle, drawn = rng.uniform(0, np.pi), rng.random() < share
        along = rng.normal(0, along_px * rng.uniform(0.5, 1.5) * drawn, len(view.ids))
        moved_by = along[:, None] * (np.cos(angle), np.sin(angle))
        views.append(replace(view, image_points=view.image_points + moved_by))
    return replace(sharp, views=tuple(views))


def miscounted(seed: int = 4, columns: int = 10) -> Observations:
    """Corners numbered row by row over 11 columns, said to be of a board that has another number of them."""
    seen = shoot(how=Session(views=VIEWS), seed=seed)
    said = Board(columns=columns, rows=BOARD.rows, square_mm=BOARD.square_mm)
    views = []
    for view in seen.views:
        known = view.ids < len(said.points)
        views.append(replace(view, ids=view.ids[known], image_points=view.image_points[known]))
    return replace(seen, board=said, views=tuple(views))


def two_boards() -> Observations:
    """Views of two boards taken for one: every other view is of squares a fiftieth longer down than across."""
    a, b = (shoot(seed=1, how=Session(views=10, stretch=(1.0, longer))) for longer in (1.0, 1.02))
    return replace(a, views=tuple(view for pair in zip(a.views, b.views, strict=True) for view in pair))


SESSIONS: dict[str, Callable[[int], Observations]] = {
    "rolling-shutter": rolling,
    "focus-changes": refocusing,
    "two-cameras": two_zooms,
    "stabilised": stabilised,
    "board-shape": twisted,
    "board-flexes": flexing,
    "motion-blur": blurred,
}
"""By the cause that is to be named."""


def _held(seed: int, views: int = VIEWS) -> tuple[Pose, ...]:
    return poses(BOARD, camera(), views, seed, roll_deg=180.0)


def _unit() -> tuple[FloatArray, FloatArray]:
    """U and v from −1 to 1 over the board's points."""
    x, y = BOARD.points[:, :2].T
    return 2 * x / x.max() - 1, 2 * y / y.max() - 1


def _zoomed(factor: float) -> Calibration:
    truth = camera()
    K = truth.intrinsics
    return replace(truth, intrinsics=replace(K, fx=K.fx * factor, fy=K.fy * factor))


def _shifted(dx: float, dy: float) -> Calibration:
    truth = camera()
    K = truth.intrinsics
    return replace(truth, intrinsics=replace(K, cx=K.cx + dx, cy=K.cy + dy))


def _each_by(seed: int, cameras: Sequence[Calibration]) -> Observations:
    return _seen(seed, cameras, [np.zeros(len(BOARD.points))] * len(cameras))


def _lifted(seed: int, lift_mm: FloatArray) -> Observations:
    return _seen(seed, [camera()] * VIEWS, [lift_mm] * VIEWS)


def _seen(seed: int, cameras: Sequence[Calibration], lifts_mm: Sequence[FloatArray]) -> Observations:
    """Each view by its own camera, of a board whose points are lifted off its plane."""
    rng, views = np.random.default_rng([seed, 3]), []
    for index, (by, pose, lift) in enumerate(zip(cameras, _held(seed, len(cameras)), lifts_mm, strict=True)):
        points = BOARD.points + np.column_stack([np.zeros((len(lift), 2)), lift])
        pixels = by.project(pose.camera_points(points)) + rng.normal(0, SIGMA_PX, (len(lift), 2))
        ids = np.flatnonzero(((pixels > 0) & (pixels < SIZE)).all(axis=1))
        views.append(View(name=f"{index}.jpg", ids=ids, image_points=pixels[ids]))
    return Observations(
        board=BOARD, image_size=SIZE, views=tuple(views), camera=replace(camera().camera, image_size=SIZE)
    )
