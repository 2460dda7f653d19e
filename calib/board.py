"""Calibration boards: their points, the positions of these on the board, and their names."""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import Annotated, TypeAlias

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.errors import InputError
from calibrary.records import Meta, Record, force_setattr

LARGEST = 200
"""Largest number of corners along a side: more than any printed board has; it catches typing errors."""
Side: TypeAlias = Annotated[int, Meta(ge=2, le=LARGEST)]
Length: TypeAlias = Annotated[float, Meta(gt=0)]


DICTIONARIES: Mapping[str, int] = MappingProxyType(
    {
        **{f"{bits}x{bits}_{count}": count for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
        "apriltag_16h5": 30,
        "apriltag_25h9": 35,
        "apriltag_36h10": 2320,
        "apriltag_36h11": 587,
    }
)
"""Number of markers in each of OpenCV's dictionaries."""

_MARKER_SHARE = {"charuco": 0.75, "aprilgrid": 1 / 1.3, "circles": 0.5, "acircles": 0.8}
"""Size of a marker or disc as a share of the pitch. Kalibr's grid has gaps of 0.3 tags; OpenCV's staggered discs are
0.8 of the row distance."""


class Pattern(StrEnum):
    """Printed pattern of the board."""

    CHECKERBOARD = "checkerboard"
    CHARUCO = "charuco"
    APRILGRID = "aprilgrid"
    CIRCLES = "circles"
    ASYMMETRIC_CIRCLES = "acircles"


class Board(Record):
    """A flat pattern of points at known distances.

    Attributes:
        pattern: printed pattern.
        columns, rows: number of points along each side: inner corners of a checkerboard or ChArUco board, tags of an
            AprilGrid (each has a point at every corner), discs per row and staggered rows of asymmetric circles as
            OpenCV counts them (4×11).
        square_mm: distance between neighbouring points in mm; from tag to tag of an AprilGrid, from row to row of
            asymmetric circles (half the distance of the discs in a row). None if unknown: all lengths are then in
            squares.
        dictionary: OpenCV's name of the marker dictionary, "4x4_50". None selects the smallest 4x4 dictionary with
            enough markers, or apriltag_36h11 for an AprilGrid.
        marker_mm: side of a marker or diameter of a disc in mm. None selects 3/4 of a ChArUco square, Kalibr's 1/1.3
            of an AprilGrid's pitch, or half the distance of the discs; it stays None if the square is unknown.

    Raises:
        InputError: a side has fewer than 2 or more than 200 points, a length is not positive, a marker is larger than
            its square, or the dictionary is unknown, too small, or not one of this pattern.
    """

    pattern: Pattern = Pattern.CHECKERBOARD
    columns: Side
    rows: Side
    square_mm: Length | None
    dictionary: Annotated[str, Meta(max_length=100)] | None = None
    marker_mm: Length | None = None

    def __post_init__(self) -> None:
        if not (2 <= self.columns <= LARGEST and 2 <= self.rows <= LARGEST):
            raise InputError(
                f"a board of {self.columns}×{self.rows} points: expected 2 to {LARGEST} along each side"
            )
        if self.square_mm is not None and not (0 < self.square_mm < float("inf")):
            raise InputError(f"squares of {self.square_mm:g} mm: expected a positive length")
        force_setattr(self, "dictionary", self._dictionary())
        share = _MARKER_SHARE.get(self.pattern)
        if self.square_mm is None:
            if self.marker_mm is not None:
                raise InputError(
                    f"{self}: a marker of {self.marker_mm:g} mm on squares of unknown size; say --square-mm MM too"
                )
        elif self.marker_mm is None:
            force_setattr(self, "marker_mm", self.square_mm * share if share is not None else None)
        elif share is None or not (0 < self.marker_mm < self.square_mm):
            raise InputError(
                f"{self}: a marker of {self.marker_mm:g} mm on squares of {self.square_mm:g} mm: expected "
                + ("none" if share is None else "a smaller one")
            )

    def __str__(self) -> str:
        return f"{self.pattern.value}:{self.columns}x{self.rows}"

    @property
    def unit(self) -> str:
        """Unit of lengths on the board."""
        return "mm" if self.square_mm is not None else "squares"

    @property
    def pitch(self) -> float:
        """:attr:`square_mm`, or 1 if lengths are in squares."""
        return self.square_mm if self.square_mm is not None else 1.0

    @property
    def marker(self) -> float:
        """Side of a marker or diameter of a disc, in :attr:`unit`; 0 for a pattern without either."""
        return (
            self.marker_mm
            if self.marker_mm is not None
            else self.pitch * _MARKER_SHARE.get(self.pattern, 0.0)
        )

    @property
    def described(self) -> str:
        """Name of the board and size of its squares."""
        size = f"{self.square_mm:g} mm" if self.square_mm is not None else "squares of unknown size"
        return f"{self} of {size}"

    def scale_mm(self, purpose: str) -> float:
        """Return the side of a square in mm, for a purpose that requires it.

        Raises:
            InputError: the side is unknown.
        """
        if self.square_mm is None:
            raise InputError(f"{purpose} needs the board's scale: say --square-mm MM, the side of a square")
        return self.square_mm

    @property
    def has_markers(self) -> bool:
        """Whether markers identify the points."""
        return self.pattern in {Pattern.CHARUCO, Pattern.APRILGRID}

    @property
    def lattice(self) -> tuple[int, int]:
        """Number of points (along a row, along a column)."""
        if self.pattern is Pattern.APRILGRID:
            return 2 * self.columns, 2 * self.rows
        return self.columns, self.rows

    @property
    def points(self) -> FloatArray:
        """Points, (N, 3) in :attr:`unit`, row by row; the board lies in z = 0, and z points away from the viewer."""
        columns, rows = self.lattice
        y, x = np.mgrid[:rows, :columns]
        flat = np.zeros(x.size)
        if self.pattern is Pattern.ASYMMETRIC_CIRCLES:
            return np.column_stack([(2 * x + y % 2).ravel(), y.ravel(), flat]) * self.pitch
        if self.pattern is not Pattern.APRILGRID:
            return np.column_stack([x.ravel(), y.ravel(), flat]) * self.pitch
        across, down = ((at // 2) * self.pitch + (at % 2) * self.marker for at in (x, y))
        return np.column_stack([across.ravel(), down.ravel(), flat])

    @property
    def extent(self) -> tuple[float, float]:
        """Distance between the outermost points, (across, down), in :attr:`unit`."""
        across, down, _ = self.points.max(axis=0)
        return float(across), float(down)

    @property
    def markers(self) -> int:
        """Number of markers."""
        if self.pattern is Pattern.CHARUCO:
            # The white squares; the upper left one is black.
            return (self.columns + 1) * (self.rows + 1) // 2
        return self.columns * self.rows if self.pattern is Pattern.APRILGRID else 0

    def tag_points(self, marker: int) -> tuple[int, int, int, int]:
        """Return the indices into :attr:`points` of an AprilGrid tag's corners, in OpenCV's order of corners.

        Kalibr numbers tags from the lower left, row by row upwards, and prints them rotated by 180° relative to
        OpenCV: OpenCV's first corner is the lower right one.
        """
        up, column = divmod(marker, self.columns)
        along = 2 * self.columns
        first = 2 * (self.rows - 1 - up) * along + 2 * column
        return first + along + 1, first + along, first, first + 1

    def _dictionary(self) -> str | None:
        """Return the canonical name of the dictionary; None for a pattern without markers."""
        if not self.has_markers:
            if self.dictionary is not None:
                raise InputError(
                    f"{self} has no markers; expected no dictionary, got {self.dictionary!r:.40}"
                )
            return None
        if self.dictionary is None and self.pattern is Pattern.APRILGRID:
            name = "apriltag_36h11"
        elif self.dictionary is None:
            sizes = (50, 100, 250, 1000)
            name = f"4x4_{next((size for size in sizes if size >= self.markers), sizes[-1])}"
        else:
            name = self.dictionary.lower().removeprefix("dict_")
        if self.pattern is Pattern.APRILGRID and not name.startswith("apriltag"):
            raise InputError(
                f"{self} of {name!r:.40}: expected a dictionary of AprilTags, such as apriltag_36h11"
            )
        held = DICTIONARIES.get(name)
        if held is None or held < self.markers:
            raise InputError(
                f"{self} has {self.markers} markers, "
                + (
                    f"{name} only {held}"
                    if held is not None
                    else f"and {name!r:.40} is not a known dictionary"
                )
                + f"; expected one of {', '.join(DICTIONARIES)} that has enough"
            )
        return name


def parse_board(text: str, square_mm: float | None, marker_mm: float | None = None) -> Board:
    """Make a board from its name on the command line: "checkerboard:11x8" (inner corners), "charuco:8x6:5x5_100".

    Raises:
        InputError: the name is not valid.
    """
    match = re.fullmatch(r"([a-z]+):(\d{1,4})[x×](\d{1,4})(?::([a-z0-9_]{1,20}))?", text.strip().lower())
    if match is None or match[1] not in set(Pattern):
        raise InputError(
            f"board {text!r:.60}: expected PATTERN:COLUMNSxROWS, such as checkerboard:11x8 for 11×8 inner corners "
            f"(12×9 squares), and for markers :DICTIONARY; patterns are {', '.join(Pattern)}"
        )
    return Board(
        pattern=Pattern(match[1]),
        columns=int(match[2]),
        rows=int(match[3]),
        square_mm=square_mm,
        dictionary=match[4],
        marker_mm=marker_mm,
    )
