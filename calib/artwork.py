"""Printed geometry of a board in mm from its first point: dark cells or dark discs on a white sheet."""

from __future__ import annotations

from functools import lru_cache
from typing import TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.board import Board, Pattern

Box: TypeAlias = tuple[float, float, float, float]
"""(left, top, right, bottom) in mm from the first point."""

RIM_POINTS = 40
"""Number of points along each side; the distortion between two of them deviates from a line by less than 1 px."""


class Cells(Struct, frozen=True, kw_only=True, eq=False):
    """Dark and white rectangles between lines that cross the whole board.

    Attributes:
        x, y: (m + 1,) and (n + 1,) mm, positions of the lines, ascending; the outer cells are white.
        dark: (n, m) which cells are printed.
        integral: (n + 1, m + 1) mm², dark area above and to the left of each crossing of lines.
    """

    x: FloatArray
    y: FloatArray
    dark: BoolArray
    integral: FloatArray

    @classmethod
    def of(cls, x: FloatArray, y: FloatArray, dark: BoolArray) -> Cells:
        """Make the cells with a white border on every side, and the integral of their areas."""
        dark = np.pad(dark, 1)
        x, y = (np.concatenate([[2 * v[0] - v[-1]], v, [2 * v[-1] - v[0]]]) for v in (x, y))
        area = dark * np.diff(y)[:, None] * np.diff(x)
        integral = np.pad(area.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
        return cls(x=x, y=y, dark=dark, integral=integral)

    @property
    def extent_mm(self) -> Box:
        """Bounds of the print."""
        return float(self.x[1]), float(self.y[1]), float(self.x[-2]), float(self.y[-2])

    def darkness(self, x: FloatArray, y: FloatArray, width: FloatArray, height: FloatArray) -> FloatArray:
        """Return the exact dark share, (N,), of axis-parallel boxes with centres and sides in mm.

        The integral is bilinear between the lines, so each box needs only its values at the four corners.
        """
        left, right = _fraction(self.x, x - width / 2), _fraction(self.x, x + width / 2)
        top, bottom = _fraction(self.y, y - height / 2), _fraction(self.y, y + height / 2)
        dark = self._above_left(right, bottom) - self._above_left(left, bottom)
        dark -= self._above_left(right, top) - self._above_left(left, top)
        return np.asarray(dark / (width * height))

    def tone(self, x: FloatArray, y: FloatArray, width: FloatArray, height: FloatArray) -> FloatArray:
        """Return the same for boxes inside one cell, and NaN for boxes that a line may cross."""
        steps = np.arange(float(len(self.x))), np.arange(float(len(self.y)))
        left, right = (np.interp(x + side * width / 2, self.x, steps[0]) for side in (-1, 1))
        top, bottom = (np.interp(y + side * height / 2, self.y, steps[1]) for side in (-1, 1))
        column, row = left.astype(np.intp), top.astype(np.intp)
        one = (column == right.astype(np.intp)) & (row == bottom.astype(np.intp))
        # A position beyond the last line falls into an extra cell, which is white like the last one.
        printed = np.pad(self.dark.astype(np.float64), ((0, 1), (0, 1)))[row, column]
        return np.where(one, printed, np.nan)

    def _above_left(self, column: _Fractions, row: _Fractions) -> FloatArray:
        (i, a), (j, b) = column, row
        stride = self.integral.shape[1]
        flat, at = self.integral.ravel(), j * stride + i
        upper, lower = flat[at], flat[at + stride]
        upper = upper + a * (flat[at + 1] - upper)
        lower = lower + a * (flat[at + stride + 1] - lower)
        return np.asarray(upper + b * (lower - upper))


class Discs(Struct, frozen=True, kw_only=True, eq=False):
    """Dark discs, one at every point.

    Attributes:
        columns, rows, pitch_mm: grid of the discs; the first is centred at (0, 0).
        radius_mm: radius of each disc.
        is_staggered: whether every second row is shifted by one pitch and the discs of a row are two pitches apart.
    """

    columns: int
    rows: int
    pitch_mm: float
    radius_mm: float
    is_staggered: bool = False

    @property
    def extent_mm(self) -> Box:
        """Bounds of the print."""
        r = self.radius_mm
        across = 2 * self.columns - 1 if self.is_staggered else self.columns - 1
        return -r, -r, across * self.pitch_mm + r, (self.rows - 1) * self.pitch_mm + r

    def darkness(self, x: FloatArray, y: FloatArray, width: FloatArray, height: FloatArray) -> FloatArray:
        """Return the dark share of axis-parallel boxes, for boxes much smaller than a disc."""
        row = np.clip(np.rint(y / self.pitch_mm), 0, self.rows - 1)
        step, first = (2, row % 2) if self.is_staggered else (1, 0 * row)
        column = np.clip(np.rint((x / self.pitch_mm - first) / step), 0, self.columns - 1)
        dx, dy = x - (step * column + first) * self.pitch_mm, y - row * self.pitch_mm
        distance = np.hypot(dx, dy)
        across = np.maximum(distance, 1e-9 * self.pitch_mm)
        # Width of a box seen along the normal of the rim, with the same second moment.
        span = np.hypot(width * dx, height * dy) / across + 1e-9 * self.pitch_mm
        return np.asarray(np.clip((self.radius_mm - distance) / span + 0.5, 0.0, 1.0))

    def tone(self, x: FloatArray, y: FloatArray, width: FloatArray, height: FloatArray) -> FloatArray:
        """Return the same for boxes that no rim crosses, and NaN for boxes that one may cross."""
        dark = self.darkness(x, y, width, height)
        return np.where((dark == 0) | (dark == 1), dark, np.nan)


Artwork: TypeAlias = Cells | Discs

_Fractions: TypeAlias = tuple[NDArray[np.intp], FloatArray]


def _fraction(lines: FloatArray, at: FloatArray) -> _Fractions:
    """Return the cell of a coordinate and the fraction within it; coordinates outside are moved to the edge."""
    position = np.interp(at, lines, np.arange(float(len(lines))))
    cell = np.minimum(position.astype(np.intp), len(lines) - 2)
    return cell, position - cell


@lru_cache(maxsize=8)
def artwork(board: Board) -> Artwork:
    """Return the printed geometry of a board."""
    if board.pattern in {Pattern.CIRCLES, Pattern.ASYMMETRIC_CIRCLES}:
        return Discs(
            is_staggered=board.pattern is Pattern.ASYMMETRIC_CIRCLES,
            columns=board.columns,
            rows=board.rows,
            pitch_mm=board.pitch,
            radius_mm=board.marker / 2,
        )
    if board.pattern is Pattern.APRILGRID:
        return _april_grid(board)
    return _squares(board)


def _squares(board: Board) -> Cells:
    """Return the squares around the inner corners, the first one dark; for a ChArUco board with its markers."""
    side = board.pitch
    columns, rows = board.columns + 1, board.rows + 1
    row, column = np.mgrid[:rows, :columns]
    dark = (row + column) % 2 == 0
    if board.pattern is Pattern.CHECKERBOARD:
        return Cells.of(side * np.arange(-1.0, columns), side * np.arange(-1.0, rows), dark)
    modules = _modules(board, border=1)
    n = modules.shape[1]
    edge = (side - board.marker) / 2
    steps = np.concatenate([[0.0], edge + board.marker * np.arange(n + 1) / n])
    tile = np.ones((rows, columns, n + 2, n + 2), dtype=np.bool_) & dark[..., None, None]
    white = np.flatnonzero(~dark)
    tile.reshape(-1, n + 2, n + 2)[white, 1:-1, 1:-1] = modules[: len(white)]
    return _tiled(tile, steps, side, -side)


def _april_grid(board: Board) -> Cells:
    """Return AprilTags as Kalibr's kalibr_create_target_pdf draws them.

    Their border is two modules wide, a dark square fills each crossing of the gaps, and the tags are rotated by 180°
    relative to OpenCV's drawing.
    """
    pitch = board.pitch
    modules = np.rot90(_modules(board, border=2), 2, axes=(1, 2))
    n = modules.shape[1]
    gap = pitch - board.marker
    steps = np.concatenate([[0.0], gap + board.marker * np.arange(n) / n])
    tile = np.zeros((board.rows + 1, board.columns + 1, n + 1, n + 1), dtype=np.bool_)
    tile[:, :, 0, 0] = True
    upwards = modules[: board.markers].reshape(board.rows, board.columns, n, n)
    tile[:-1, :-1, 1:, 1:] = upwards[::-1]
    whole = _tiled(tile, steps, pitch, -gap)
    # The last row and column of tiles contain only the squares in the outermost gaps.
    x, y = whole.x[1 : -1 - n], whole.y[1 : -1 - n]
    return Cells.of(x, y, whole.dark[1 : 1 + len(y) - 1, 1 : 1 + len(x) - 1])


def _tiled(tile: BoolArray, steps: FloatArray, pitch: float, first: float) -> Cells:
    """Return cells of (rows, columns, n, m) tiles, repeated every ``pitch`` mm from ``first``."""
    rows, columns, n, m = tile.shape
    x, y = (
        np.append((first + pitch * np.arange(count)[:, None] + steps).ravel(), first + pitch * count)
        for count in (columns, rows)
    )
    return Cells.of(x, y, tile.transpose(0, 2, 1, 3).reshape(rows * n, columns * m))


def _modules(board: Board, *, border: int) -> BoolArray:
    """Return which modules of each marker are dark, (markers, n, n), including the border."""
    import cv2

    name = f"DICT_{board.dictionary}".upper()
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    n = int(dictionary.markerSize) + 2 * border
    drawn = [
        cv2.aruco.generateImageMarker(dictionary, marker, n, borderBits=border)
        for marker in range(board.markers)
    ]
    return np.asarray(np.stack(drawn) < 128)


def paper(board: Board) -> Box:
    """Return the white sheet: the print with a margin of one square on every side."""
    left, top, right, bottom = artwork(board).extent_mm
    margin = board.pitch
    return left - margin, top - margin, right + margin, bottom + margin


def paper_rim(board: Board) -> FloatArray:
    """Return points along the edge of the sheet, (M, 3) mm, in its plane."""
    left, top, right, bottom = paper(board)
    t = np.linspace(0.0, 1.0, RIM_POINTS)
    x, y = left + (right - left) * t, top + (bottom - top) * t
    ends = np.ones_like(t)
    columns = np.concatenate([x, right * ends, x, left * ends])
    rows = np.concatenate([top * ends, y, bottom * ends, y])
    return np.column_stack([columns, rows, 0 * columns])
