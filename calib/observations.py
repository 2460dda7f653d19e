"""Observations of a board: corners by view, sufficient to repeat a calibration without the images."""

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
from calibrary.quality import ImageCircle
from calibrary.records import force_setattr

Days: TypeAlias = tuple[date, date]
"""First and last day."""


class ControlPoints(Struct, frozen=True, kw_only=True, eq=False):
    """Points with known positions: surveyed ground control, or the point cloud of a reconstruction.

    Attributes:
        points: (N, 3) in any right-handed frame; they need not be planar.
        name: kind of points.
        unit: unit of the coordinates.

    Raises:
        InputError: the array has another shape, or a coordinate is not finite.
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
    """The board in one image.

    Attributes:
        name: file name of the image, without its folder.
        sha256: SHA-256 of the image file; None if there is no image.
        ids: (N,) indices into :attr:`Board.points` of the points that were seen.
        image_points: (N, 2) px in the canonical pixel origin.
        sharpness_px: width of the edges at the corners in px, as ``cv2.estimateChessboardSharpness`` measures it.
        spacing_px: smallest distance between neighbouring corners, px.
    """

    name: str
    sha256: str | None = None
    ids: IntArray
    image_points: FloatArray
    sharpness_px: float | None = None
    spacing_px: float | None = None


class Observations(Struct, frozen=True, kw_only=True, eq=False):
    """All views of one board by one camera at one focus setting.

    Attributes:
        board: the board, or control points instead.
        image_size: (width, height) px of every image.
        views: views in the order of the images.
        camera: camera, as the images state it.
        focus: focus setting of the lens, in words, if the images state it.
        firmware: firmware, as the images state it.
        taken: first and last day of the images by the camera's clock, if they state one.
        source: file that the corners were read from, if they were not detected here.
        circle: circle outside which the images are black; None if they fill the frame, or were not looked at.
    """

    board: Board | ControlPoints
    image_size: ImageSize
    views: tuple[View, ...]
    camera: CameraKey
    focus: str | None = None
    firmware: str | None = None
    taken: Days | None = None
    source: SourceFile | None = None
    circle: ImageCircle | None = None

    def object_points(self, view: View) -> FloatArray:
        """Return the board points of a view's image points, (N, 3) mm."""
        return self.board.points[view.ids]
