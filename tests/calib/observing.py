"""Corners that a perfect or noisy detector would report, without rendering, of boards and shutters with faults."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrary.calib.board import Board
from calibrary.calib.observations import Observations, View
from calibrary.calib.synthesis import Pose, Sheet, Shutter, seen_corners
from calibrary.calibration import Calibration
from calibrary.records import replace


def observe(
    board: Board,
    calibration: Calibration,
    poses: Sequence[Pose],
    sigma_px: float,
    seed: int,
    *,
    bow_mm: float = 0.0,
    stretch: tuple[float, float] = (1.0, 1.0),
    shutter: Shutter | None = None,
) -> Observations:
    """Return synthetic corners with normally distributed noise.

    Args:
        board: nominal board.
        calibration: the true camera.
        poses: pose of the board in each view.
        sigma_px: standard deviation of each corner's x and y, px.
        seed: seed of the noise.
        bow_mm: distance of the sheet's centre behind the ends of its longer side, mm.
        stretch: scale of the print across and down.
        shutter: shutter of the camera; None for a global shutter.

    Returns:
        A view for each pose; points outside the image or the field of view are omitted.
    """
    random = np.random.default_rng([seed, 11])
    sheet = Sheet.bowed(board, bow_mm, stretch)
    size = calibration.intrinsics.image_size
    views = []
    for number, pose in enumerate(poses):
        exact = seen_corners(board, calibration, pose, sheet, shutter or Shutter())
        seen = exact + random.normal(0.0, 1.0, exact.shape) * sigma_px
        ids = np.flatnonzero(((seen > 0) & (seen < size)).all(axis=1))
        views.append(View(name=f"view-{number:03}", ids=ids, image_points=seen[ids]))
    camera = replace(calibration.camera, image_size=size)
    return Observations(board=board, image_size=size, views=tuple(views), camera=camera)
