"""Where a board's points really are: how it lies before the camera, how it is bent, how its print is stretched."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calibration import Calibration
from calibrary.rotations import rotation_matrix

__all__ = ["Pose", "Sheet", "Shutter", "seen_corners", "seen_points"]

Vector: TypeAlias = tuple[float, float, float]

ROW_ROUNDS = 12
"""A corner's row decides when it is exposed, and when it is exposed decides its row; each round gains two digits."""


class Pose(Struct, frozen=True, kw_only=True):
    """How a board lies before the camera: x_camera = R x_board + t.

    Attributes:
        rotation: R as axis times angle, rad.
        translation_mm: t, where the board's first point is.
    """

    rotation: Vector
    translation_mm: Vector

    @property
    def matrix(self) -> FloatArray:
        """R, (3, 3)."""
        return rotation_matrix(np.array(self.rotation))

    def camera_points(self, points_mm: FloatArray) -> FloatArray:
        """(N, 3) mm on the board to (N, 3) mm before the camera."""
        return np.asarray(points_mm @ self.matrix.T + np.array(self.translation_mm))


class Sheet(Struct, frozen=True, kw_only=True):
    """How a board departs from the plane and the lengths that it is taken for.

    Attributes:
        warp_mm: z = a (1 − u²) + b (1 − v²), where u and v run from −1 to 1 over the points; positive is away
            from the viewer, zero is in the corners' plane.
        stretch: what a length across and a length down came out as on paper, 1 where the printer was true.
    """

    warp_mm: tuple[float, float] = (0.0, 0.0)
    stretch: tuple[float, float] = (1.0, 1.0)

    @classmethod
    def bowed(cls, board: Board, bow_mm: float, stretch: tuple[float, float] = (1.0, 1.0)) -> Sheet:
        """A paraboloid whose middle stands ``bow_mm`` behind the ends of the board's longer side."""
        across, down = board.extent
        longer = max(across, down)
        return cls(warp_mm=(bow_mm * (across / longer) ** 2, bow_mm * (down / longer) ** 2), stretch=stretch)

    def points(self, board: Board) -> FloatArray:
        """(N, 3) mm: the board's points where they really are."""
        points = board.points * (*self.stretch, 1.0)
        points[:, 2] += self.height(board, points[:, 0], points[:, 1])
        return points

    def height(self, board: Board, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """How far the sheet stands behind its plane there, mm."""
        (u0, du), (v0, dv) = self.unit_axes(board)
        a, b = self.warp_mm
        return np.asarray(a * (1 - ((x_mm - u0) / du) ** 2) + b * (1 - ((y_mm - v0) / dv) ** 2))

    def unit_axes(self, board: Board) -> tuple[tuple[float, float], tuple[float, float]]:
        """(middle, half extent) of the printed points, across and down, mm."""
        (across, down), (sx, sy) = board.extent, self.stretch
        return (across * sx / 2, across * sx / 2), (down * sy / 2, down * sy / 2)


class Shutter(Struct, frozen=True, kw_only=True):
    """A shutter that reads row after row while the camera turns.

    Attributes:
        readout_s: from the first row to the last.
        rate_deg_s: how fast the camera turns about its own x, y and z axes. The pose is that of the middle row.
    """

    readout_s: float = 0.0
    rate_deg_s: Vector = (0.0, 0.0, 0.0)

    @property
    def is_rolling(self) -> bool:
        """Whether any row sees another pose than the middle one."""
        return self.readout_s != 0 and any(self.rate_deg_s)

    def turns(self, rows: FloatArray, height: int) -> FloatArray:
        """(N,) rows in px to (N, 3, 3): directions in the camera of that row to those in the middle row's."""
        seconds = (rows / height - 0.5) * self.readout_s
        return rotation_matrix(seconds[:, None] * np.radians(self.rate_deg_s))


def seen_corners(
    board: Board, calibration: Calibration, pose: Pose, sheet: Sheet, shutter: Shutter
) -> FloatArray:
    """(N, 2) px in the canonical origin: where each of the board's points is seen, NaN where it is not.

    Args:
        board: nominally.
        calibration: the true camera.
        pose: of the board, at the middle row.
        sheet: the board as it really is.
        shutter: of the camera.
    """
    return seen_points(pose.camera_points(sheet.points(board)), calibration, shutter)


def seen_points(points_mm: FloatArray, calibration: Calibration, shutter: Shutter) -> FloatArray:
    """The same of (N, 3) points before the camera of the middle row."""
    pixels = calibration.project(points_mm)
    if not shutter.is_rolling:
        return pixels
    height = calibration.intrinsics.image_size[1]
    for _ in range(ROW_ROUNDS):
        turns = shutter.turns(pixels[:, 1], height)
        # The transpose turns the point into the camera of the row that sees it.
        pixels = calibration.project(np.einsum("nji,nj->ni", turns, points_mm))
    return pixels
