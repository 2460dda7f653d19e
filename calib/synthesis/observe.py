"""What a perfect or a noisy detector would report, without drawing a pixel."""

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

__all__ = ["Truth", "observe"]


class Truth(Struct, frozen=True, kw_only=True, eq=False):
    """What lies behind a set of frames.

    Attributes:
        board: nominally.
        calibration: the camera.
        poses: of the board, by frame.
        settings: what the frames were taken with.
    """

    board: Board
    calibration: Calibration
    poses: tuple[Pose, ...]
    settings: Settings = field(default_factory=Settings)

    def corners(self, frame: int) -> FloatArray:
        """(N, 2) px in the canonical origin, in the order of :attr:`Board.points`."""
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
    """Corners with normal noise.

    Args:
        board: nominally.
        calibration: the true camera.
        poses: of the board, one a view.
        sigma_px: standard deviation of each corner's x and y.
        seed: of the noise.
        bow_mm: how far the middle of the sheet stands behind the ends of its longer side.
        stretch: of the print, across and down.
        shutter: of the camera; None for one that exposes all rows at once.

    Returns:
        A view for every pose; points that the camera cannot see, or outside the frame, are left out.
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
