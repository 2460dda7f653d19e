"""Corners in arrays, as OpenCV's functions take and give them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.board import Board
from calibrary.calib.observations import ControlPoints, View
from calibrary.calibration import ImageSize
from calibrary.errors import InputError

__all__ = ["Corners", "views_of"]

OFF_THE_GRID = 1e-3
"""Largest deviation of an object point from a regular grid, in squares; float32 has a ten-thousandth of it."""


class Corners(Struct, frozen=True, kw_only=True, eq=False):
    """Corners of one camera that another program found, one array for each view.

    Attributes:
        image_points: (N, 2) or (N, 1, 2) px for each view; None or an empty array where the board was not seen.
        image_size: (width, height) px.
        object_points: (N, 3) for each view, in any unit, as ``cv2.calibrateCamera`` takes them; or None where ``ids``
            or all points of the board are given.
        ids: (N,) or (N, 1) numbers of the points on the board, row by row from 0, as ``cv2.aruco`` gives them.
        names: of the views; by default their numbers. Those of a rig belong to one shot if they are equal.

    >>> import numpy as np
    >>> board = np.array([(30.0 * x, 30.0 * y, 0.0) for y in range(6) for x in range(8)], np.float32)
    >>> seen = [board[:, :2] * 2 + (400, 300), board[:, :2] * 3 + (90, 500)]  # as cv2.findChessboardCorners gives them
    >>> corners = calibrary.Corners(object_points=[board] * 2, image_points=seen, image_size=(1920, 1440))
    >>> len(corners.image_points)  # calibrary.calibrate(corners=corners) wants ten of them and more, tilted
    2
    """

    image_points: Sequence[ArrayLike | None]
    image_size: ImageSize
    object_points: Sequence[ArrayLike] | None = None
    ids: Sequence[ArrayLike | None] | None = None
    names: Sequence[str] | None = None


def views_of(
    corners: Corners, board: Board | None, square_mm: float | None = None
) -> tuple[Board | ControlPoints, tuple[View, ...]]:
    """Return the board and the views, in the pixel origin of the arrays.

    Object points on a regular flat grid are the corners of a board; others are points at known places.

    Args:
        corners: the arrays.
        board: of the points; None if ``corners`` has object points.
        square_mm: distance of neighbouring object points, if they are given in another unit.

    Raises:
        InputError: the arrays do not go together; the message names the view.
    """
    count = len(corners.image_points)
    for name in ("object_points", "ids", "names"):
        given = getattr(corners, name)
        if given is not None and len(given) != count:
            raise InputError(f"{len(given)} of {count} views; expected one for each", place=name)
    if (corners.object_points is None) == (board is None):
        raise InputError("expected object_points, or a board whose points are numbered", place="corners")
    seen: list[tuple[str, FloatArray, int]] = []
    for at, given in enumerate(corners.image_points):
        if given is None or np.size(given) == 0:
            continue
        name = corners.names[at] if corners.names is not None else f"view {at}"
        seen.append((name, _pixels(given, corners.image_size, f"image_points[{at}]"), at))
    if not seen:
        raise InputError(f"no corner in any of {count} views", place="image_points")
    points: Board | ControlPoints
    if board is not None:
        points, ids = board, [_ids(corners, at, len(pixels), len(board.points)) for _, pixels, at in seen]
    else:
        points, ids = _numbered(
            [_object_points(corners.object_points or (), at, len(pixels)) for _, pixels, at in seen],
            square_mm,
        )
    return points, tuple(
        View(name=name, ids=numbers[order], image_points=pixels[order])
        for (name, pixels, _), numbers in zip(seen, ids, strict=True)
        for order in [np.argsort(numbers, kind="stable")]
    )


def _pixels(given: ArrayLike, size: ImageSize, place: str) -> FloatArray:
    pixels = np.array(given, dtype=np.float64)
    if pixels.ndim not in {2, 3} or pixels.shape[-1] != 2 or not np.isfinite(pixels).all():
        raise InputError(
            f"an array of shape {pixels.shape}; expected (N, 2) or (N, 1, 2) finite px", place=place
        )
    pixels = pixels.reshape(-1, 2)
    if (pixels < -1).any() or (pixels > np.add(size, 1)).any():
        x, y = pixels.max(axis=0)
        raise InputError(
            f"points up to ({x:.0f}, {y:.0f}) in images of {size[0]}×{size[1]} px; expected image_size as "
            "(width, height) of the images in which they were found",
            place=place,
        )
    return pixels


def _ids(corners: Corners, at: int, count: int, points: int) -> IntArray:
    given = corners.ids[at] if corners.ids is not None else None
    ids = np.arange(points) if given is None else np.array(given, dtype=np.intp).ravel()
    if len(ids) != count or len(np.unique(ids)) != count or ids.min() < 0 or ids.max() >= points:
        numbered = "without ids" if given is None else f"with {len(ids)} ids up to {ids.max(initial=0)}"
        raise InputError(
            f"{count} points {numbered}; the board has {points}; expected an id below {points} for each, each once",
            place=f"ids[{at}]",
        )
    return ids.astype(np.intp)


def _object_points(given: Sequence[ArrayLike], at: int, count: int) -> FloatArray:
    points = np.array(given[at], dtype=np.float64).reshape(-1, 3)
    if len(points) != count or not np.isfinite(points).all():
        raise InputError(
            f"{len(points)} points for {count} image points; expected as many, (N, 3) finite",
            place=f"object_points[{at}]",
        )
    return points


def _numbered(
    seen: Sequence[FloatArray], square_mm: float | None
) -> tuple[Board | ControlPoints, list[IntArray]]:
    """Return the board that the object points lie on, or the points themselves, and each view's numbers of them."""
    every, inverse = np.unique(np.concatenate(seen), axis=0, return_inverse=True)
    ends = np.cumsum([len(one) for one in seen])[:-1]
    step = max((float(np.diff(np.unique(axis)).max(initial=0.0)) for axis in every.T[:2]), default=0.0)
    if step > 0 and np.ptp(every[:, 2]) < OFF_THE_GRID * step:
        places = (every[:, :2] - every[:, :2].min(axis=0)) / step
        whole = np.rint(places).astype(np.intp)
        columns, rows = (whole.max(axis=0) + 1).tolist()
        if np.abs(places - whole).max() < OFF_THE_GRID and len(np.unique(whole, axis=0)) == columns * rows:
            numbers = whole[:, 1] * columns + whole[:, 0]
            board = Board(columns=columns, rows=rows, square_mm=square_mm)
            return board, [one.astype(np.intp) for one in np.split(numbers[inverse.ravel()], ends)]
    return (
        ControlPoints(points=every, name="object points", unit="units"),
        [one.astype(np.intp) for one in np.split(inverse.ravel(), ends)],
    )
