"""What was seen of a board: corners by view, enough to solve the calibration again without the frames."""

from __future__ import annotations

from datetime import date
from typing import TypeAlias

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.board import Board
from calibrary.calibration import CameraKey, ImageSize
from calibrary.errors import InputError
from calibrary.provenance import SourceFile
from calibrary.records import force_setattr

__all__ = ["ControlPoints", "Days", "Observations", "View"]

Days: TypeAlias = tuple[date, date]
"""The first and the last of several days."""


class ControlPoints(Struct, frozen=True, kw_only=True, eq=False):
    """Points whose place in space is known: surveyed ground control, or the cloud of a reconstruction.

    Attributes:
        points: (N, 3) in any right-handed frame; they need not lie in a plane.
        name: what they are.
        unit: that they are counted in.

    Raises:
        InputError: another shape, or a coordinate that is not finite.
    """

    points: FloatArray
    name: str = "control points"
    unit: str = "mm"

    def __post_init__(self) -> None:
        points = np.array(self.points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise InputError(
                f"control points of shape {points.shape}: expected (N, 3) finite coordinates in mm"
            )
        force_setattr(self, "points", points)

    def __str__(self) -> str:
        return f"{len(self.points)} {self.name}"


class View(Struct, frozen=True, kw_only=True, eq=False):
    """The board in one frame.

    Attributes:
        name: the frame's file name, without its folder.
        sha256: of the frame's bytes, None where there is no frame.
        ids: (N,) which of the board's points were seen, indices into :attr:`Board.points`.
        image_points: (N, 2) px in the canonical origin, where they were seen.
        sharpness_px: width of the edges around the corners, as ``cv2.estimateChessboardSharpness`` measures.
        spacing_px: smallest distance between neighbouring corners.
    """

    name: str
    sha256: str | None = None
    ids: IntArray
    image_points: FloatArray
    sharpness_px: float | None = None
    spacing_px: float | None = None


class Observations(Struct, frozen=True, kw_only=True, eq=False):
    """All views of one board by one camera at one focus.

    Attributes:
        board: which board, or the control points that took its place.
        image_size: (width, height) px of every frame.
        views: in the order of the frames.
        camera: which camera, as its frames say.
        focus: how the lens was focused, in words, where the frames say it.
        firmware: as the frames say it.
        taken: the first and the last day of the frames, by the camera's clock, where they state one.
        source: the file that the corners were read from, where they were not found in frames here.
    """

    board: Board | ControlPoints
    image_size: ImageSize
    views: tuple[View, ...]
    camera: CameraKey
    focus: str | None = None
    firmware: str | None = None
    taken: Days | None = None
    source: SourceFile | None = None

    def object_points(self, view: View) -> FloatArray:
        """(N, 3) mm on the board, for a view's image points."""
        return self.board.points[view.ids]
