"""True positions of a board's points: pose, bend and stretch of the print."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calibration import Calibration
from calibrary.rotations import rotation_matrix

Vector: TypeAlias = tuple[float, float, float]

ROW_ROUNDS = 12
"""Iterations for a rolling shutter: a corner's row determines its time, which determines its row."""


class Pose(Struct, frozen=True, kw_only=True):
    """Pose of a board: x_camera = R x_board + t.

    Attributes:
        rotation: rotation vector of R, rad.
        translation_mm: t, the position of the board's first point, mm.
    """

    rotation: Vector
    translation_mm: Vector

    @property
    def matrix(self) -> FloatArray:
        """R, (3, 3)."""
        return rotation_matrix(np.array(self.rotation))

    def camera_points(self, points_mm: FloatArray) -> FloatArray:
        """Transform points, (N, 3) mm, from the board to the camera frame."""
        return np.asarray(points_mm @ self.matrix.T + np.array(self.translation_mm))


class Sheet(Struct, frozen=True, kw_only=True):
    """Deviation of a board from its plane and its nominal lengths.

    Attributes:
        warp_mm: z = a (1 − u²) + b (1 − v²) in mm, where u and v run from −1 to 1 over the points; positive is away
            from the viewer, and zero is the plane of the corners.
        stretch: scale of the print across and down; 1 if the printer was exact.
    """

    warp_mm: tuple[float, float] = (0.0, 0.0)
    stretch: tuple[float, float] = (1.0, 1.0)

    @classmethod
    def bowed(cls, board: Board, bow_mm: float, stretch: tuple[float, float] = (1.0, 1.0)) -> Sheet:
        """Make a paraboloid with its centre ``bow_mm`` behind the ends of the board's longer side."""
        across, down = board.extent
        longer = max(across, down)
        return cls(warp_mm=(bow_mm * (across / longer) ** 2, bow_mm * (down / longer) ** 2), stretch=stretch)

    def points(self, board: Board) -> FloatArray:
        """Return the true positions of the board's points, (N, 3) mm."""
        points = board.points * (*self.stretch, 1.0)
        points[:, 2] += self.height(board, points[:, 0], points[:, 1])
        return points

    def height(self, board: Board, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return the distance of the sheet behind its plane, mm."""
        (u0, du), (v0, dv) = self.unit_axes(board)
        a, b = self.warp_mm
        return np.asarray(a * (1 - ((x_mm - u0) / du) ** 2) + b * (1 - ((y_mm - v0) / dv) ** 2))

    def unit_axes(self, board: Board) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return (centre, half extent) of the printed points, across and down, mm."""
        (across, down), (sx, sy) = board.extent, self.stretch
        return (across * sx / 2, across * sx / 2), (down * sy / 2, down * sy / 2)


class Shutter(Struct, frozen=True, kw_only=True):
    """A rolling shutter that reads row by row while the camera rotates.

    Attributes:
        readout_s: time from the first row to the last, s.
        rate_deg_s: rotation rate about the camera's x, y and z axes, degrees/s. The pose is that of the middle row.
    """

    readout_s: float = 0.0
    rate_deg_s: Vector = (0.0, 0.0, 0.0)

    @property
    def is_rolling(self) -> bool:
        """Whether any row has a pose different from the middle one."""
        return self.readout_s != 0 and any(self.rate_deg_s)

    def turns(self, rows: FloatArray, height: int) -> FloatArray:
        """Return the rotations, (N, 3, 3), from the camera frame at each row, (N,) px, to that at the middle row."""
        seconds = (rows / height - 0.5) * self.readout_s
        return rotation_matrix(seconds[:, None] * np.radians(self.rate_deg_s))


def seen_corners(
    board: Board, calibration: Calibration, pose: Pose, sheet: Sheet, shutter: Shutter
) -> FloatArray:
    """Return the pixels of all board points, (N, 2) px in the canonical origin; NaN for points that are not visible.

    Args:
        board: nominal board.
        calibration: the true camera.
        pose: pose of the board, at the middle row.
        sheet: real shape of the board.
        shutter: shutter of the camera.
    """
    return seen_points(pose.camera_points(sheet.points(board)), calibration, shutter)


def seen_points(points_mm: FloatArray, calibration: Calibration, shutter: Shutter) -> FloatArray:
    """Return the same for points, (N, 3) mm, in the camera frame of the middle row."""
    pixels = calibration.project(points_mm)
    if not shutter.is_rolling:
        return pixels
    height = calibration.intrinsics.image_size[1]
    for _ in range(ROW_ROUNDS):
        turns = shutter.turns(pixels[:, 1], height)
        # The transpose rotates the point into the camera frame at the row that sees it.
        pixels = calibration.project(np.einsum("nji,nj->ni", turns, points_mm))
    return pixels
