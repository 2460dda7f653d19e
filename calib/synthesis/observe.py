"""Corners that a perfect or noisy detector would report, without rendering."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct, field

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.observations import Observations, View
from calibrary.calib.synthesis.settings import Settings
from calibrary.calib.synthesis.sheet import Pose, Sheet, Shutter, seen_corners
from calibrary.calibration import Calibration
from calibrary.records import replace


class Truth(Struct, frozen=True, kw_only=True, eq=False):
    """True values of a set of synthetic images.

    Attributes:
        board: nominal board.
        calibration: the camera.
        poses: pose of the board in each image.
        settings: settings of the images.
    """

    board: Board
    calibration: Calibration
    poses: tuple[Pose, ...]
    settings: Settings = field(default_factory=Settings)

    def corners(self, frame: int) -> FloatArray:
        """Return the corners in an image, (N, 2) px in the canonical origin, ordered as :attr:`Board.points`."""
        return seen_corners(
            self.board, self.calibration, self.poses[frame], self.settings.sheet, self.settings.shutter
        )


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
