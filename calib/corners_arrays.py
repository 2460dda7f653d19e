"""Corners in arrays, as OpenCV's functions take and give them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import index
from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.board import Board
from calibrary.calib.observations import ControlPoints, View
from calibrary.calibration import ImageSize
from calibrary.errors import InputError

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
) -> tuple[Board | ControlPoints, ImageSize, tuple[View, ...]]:
    """Return the board, the image size in px and the views, in the pixel origin of the arrays.

    Object points on a regular flat grid are the corners of a board; others are points at known places.

    Args:
        corners: the arrays.
        board: of the points; None if ``corners`` has object points.
        square_mm: distance of neighbouring object points, if they are given in another unit.

    Raises:
        InputError: the arrays do not go together; the message names the view.
    """
    size, every = _size(corners.image_size), _listed(corners.image_points, "image_points")
    count = len(every)
    of_board, ids, names = (
        None if given is None else _listed(given, place, count)
        for given, place in (
            (corners.object_points, "object_points"),
            (corners.ids, "ids"),
            (corners.names, "names"),
        )
    )
    if (of_board is None) == (board is None):
        raise InputError("expected object_points, or a board whose points are numbered", place="corners")
    if of_board is not None and ids is not None:
        raise InputError("given beside object_points; expected one of the two", place="ids")
    names = [f"view {at}" for at in range(count)] if names is None else _distinct_names(names)
    seen: list[tuple[str, FloatArray, int]] = []
    for at, given in enumerate(every):
        if given is None:
            continue
        pixels = _pixels(given, size, f"image_points[{at}]")
        if len(pixels):
            seen.append((names[at], pixels, at))
    if not seen:
        raise InputError(f"no corner in any of {count} views", place="image_points")
    points: Board | ControlPoints
    if board is not None:
        points = board
        numbered = [
            _ids(ids[at] if ids else None, at, len(pixels), len(board.points)) for _, pixels, at in seen
        ]
    else:
        points, numbered = _numbered(
            [_object_points((of_board or ())[at], at, len(pixels)) for _, pixels, at in seen], square_mm
        )
    return (
        points,
        size,
        tuple(
            View(name=name, ids=numbers[order], image_points=pixels[order])
            for (name, pixels, _), numbers in zip(seen, numbered, strict=True)
            for order in [np.argsort(numbers, kind="stable")]
        ),
    )


def _listed(given: object, place: str, count: int | None = None) -> list[Any]:
    """Return what is given for each view."""
    try:
        if isinstance(given, str | bytes | Mapping):
            raise TypeError
        listed: list[Any] = list(given)  # type: ignore[call-overload]  # what cannot be listed is refused here
    except TypeError:
        raise InputError(
            f"a {type(given).__name__}; expected a list, one for each view", place=place
        ) from None
    if count is not None and len(listed) != count:
        raise InputError(f"{len(listed)} of {count} views; expected one for each", place=place)
    return listed


def _size(given: object) -> ImageSize:
    try:
        width, height = (index(side) for side in given)  # type: ignore[attr-defined]  # as above
    except (TypeError, ValueError):
        raise InputError(
            f"{given!r:.60}; expected (width, height) of the images in whole px", place="image_size"
        ) from None
    return width, height


def _distinct_names(given: Sequence[object]) -> list[str]:
    names: dict[str, int] = {}
    for at, name in enumerate(given):
        if not isinstance(name, str):
            raise InputError(f"{name!r:.60}; expected the name of a view, a str", place=f"names[{at}]")
        if name in names:
            raise InputError(
                f"{name:.60} as names[{names[name]}]; expected another for each view", place=f"names[{at}]"
            )
        names[name] = at
    return list(names)


def _array(given: object, place: str, wanted: str) -> NDArray[Any]:
    """Return an array of real numbers."""
    try:
        array = np.asarray(given)
    except (TypeError, ValueError):
        raise InputError(
            f"rows of different lengths, or no array at all; expected {wanted}", place=place
        ) from None
    if array.size and array.dtype.kind not in "iuf":
        raise InputError(f"an array of {array.dtype}; expected {wanted}", place=place)
    return array


def _pixels(given: object, size: ImageSize, place: str) -> FloatArray:
    wanted = "(N, 2) or (N, 1, 2) finite px"
    array = _array(given, place, wanted)
    if not array.size:
        return np.empty((0, 2))
    pixels = array.astype(np.float64)
    if pixels.ndim not in {2, 3} or pixels.shape[-1] != 2 or not np.isfinite(pixels).all():
        raise InputError(f"an array of shape {pixels.shape}; expected {wanted}", place=place)
    pixels = pixels.reshape(-1, 2)
    if (pixels < -1).any() or (pixels > np.add(size, 1)).any():
        x, y = pixels.max(axis=0)
        raise InputError(
            f"points up to ({x:.0f}, {y:.0f}) in images of {size[0]}×{size[1]} px; expected image_size as "
            "(width, height) of the images in which they were found",
            place=place,
        )
    return pixels


def _ids(given: object, at: int, count: int, points: int) -> IntArray:
    place = f"ids[{at}]"
    wanted = f"an id below {points} for each, each once"
    ids = np.arange(points) if given is None else _array(given, place, wanted).ravel()
    if len(ids) != count or len(np.unique(ids)) != count or ids.min() < 0 or ids.max() >= points:
        numbered = "without ids" if given is None else f"with {len(ids)} ids up to {ids.max(initial=0)}"
        raise InputError(f"{count} points {numbered}; the board has {points}; expected {wanted}", place=place)
    if (ids != (whole := ids.astype(np.intp))).any():
        raise InputError(f"ids that are no whole numbers; expected {wanted}", place=place)
    return whole


def _object_points(given: object, at: int, count: int) -> FloatArray:
    place, wanted = f"object_points[{at}]", "as many, (N, 3) finite"
    points = _array(given, place, wanted).astype(np.float64)
    if points.ndim not in {2, 3} or points.shape[-1] != 3:
        raise InputError(
            f"an array of shape {points.shape} for {count} image points; expected {wanted}", place=place
        )
    points = points.reshape(-1, 3)
    if len(points) != count or not np.isfinite(points).all():
        raise InputError(f"{len(points)} points for {count} image points; expected {wanted}", place=place)
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
