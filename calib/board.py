"""The boards that are photographed: which points they have, where on the board, and how they are named."""

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

__all__ = ["DICTIONARIES", "Board", "Pattern", "parse_board"]


LARGEST = 200
"""Largest number of corners along a side; printed boards have fewer, and a typing error must not ask for a million."""
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
"""How many markers there are in each of OpenCV's dictionaries."""

_MARKER_SHARE = {"charuco": 0.75, "aprilgrid": 1 / 1.3, "circles": 0.5, "acircles": 0.8}
"""Of the square, that a marker or a disc takes up: Kalibr's grid has gaps of 0.3 tags, OpenCV's staggered discs are 0.8
of the distance of their rows."""


class Pattern(StrEnum):
    """What is printed on the board."""

    CHECKERBOARD = "checkerboard"
    CHARUCO = "charuco"
    APRILGRID = "aprilgrid"
    CIRCLES = "circles"
    ASYMMETRIC_CIRCLES = "acircles"


class Board(Record):
    """A flat pattern of points at known distances.

    Attributes:
        pattern: what is printed.
        columns, rows: points along each side; of a checkerboard or ChArUco board its inner corners; of an
            AprilGrid its tags, each of which has a point on every corner; of asymmetric circles as OpenCV counts
            them, the discs of a row and the staggered rows: 4×11.
        square_mm: distance between neighbouring points; of an AprilGrid from one tag to the next, of asymmetric
            circles from one row to the next, half of that between the discs of a row. None where it
            is not known: every length is then counted in squares.
        dictionary: of the markers, for patterns that have them, by OpenCV's name: "4x4_50". None takes the
            smallest 4x4 that has enough, or for AprilGrid apriltag_36h11.
        marker_mm: side of a marker, diameter of a disc. None takes 3/4 of a ChArUco square, Kalibr's 1/1.3 of
            an AprilGrid's, half of the distance between discs; it stays None where the square is not known.

    Raises:
        InputError: a side has fewer than 2 or more than 200 points, a length is not positive or a marker
            larger than its square, or the dictionary is unknown, too small, or not this pattern's.
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
        """What lengths on the board are counted in."""
        return "mm" if self.square_mm is not None else "squares"

    @property
    def pitch(self) -> float:
        """:attr:`square_mm`, or 1 where lengths are counted in squares."""
        return self.square_mm if self.square_mm is not None else 1.0

    @property
    def marker(self) -> float:
        """Side of a marker or diameter of a disc, in :attr:`unit`; 0 for a pattern that has none."""
        return (
            self.marker_mm
            if self.marker_mm is not None
            else self.pitch * _MARKER_SHARE.get(self.pattern, 0.0)
        )

    @property
    def described(self) -> str:
        """Name and size of its squares."""
        size = f"{self.square_mm:g} mm" if self.square_mm is not None else "squares of unknown size"
        return f"{self} of {size}"

    def scale_mm(self, purpose: str) -> float:
        """Side of a square, for what cannot do without.

        Raises:
            InputError: it is not known.
        """
        if self.square_mm is None:
            raise InputError(f"{purpose} needs the board's scale: say --square-mm MM, the side of a square")
        return self.square_mm

    @property
    def has_markers(self) -> bool:
        """Whether markers identify its points."""
        return self.pattern in {Pattern.CHARUCO, Pattern.APRILGRID}

    @property
    def lattice(self) -> tuple[int, int]:
        """Points (along a row, along a column)."""
        if self.pattern is Pattern.APRILGRID:
            return 2 * self.columns, 2 * self.rows
        return self.columns, self.rows

    @property
    def points(self) -> FloatArray:
        """(N, 3) in :attr:`unit`, row by row from the first point; the board lies in z = 0, z away from the viewer."""
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
        """How many there are."""
        if self.pattern is Pattern.CHARUCO:
            # The white squares; a black one is in the upper left corner.
            return (self.columns + 1) * (self.rows + 1) // 2
        return self.columns * self.rows if self.pattern is Pattern.APRILGRID else 0

    def tag_points(self, marker: int) -> tuple[int, int, int, int]:
        """Indices into :attr:`points` of an AprilGrid's tag, in the order in which OpenCV reports its corners.

        Tags are counted as Kalibr counts them, from the lower left, row by row upwards. They stand on the
        grid as Kalibr prints them, which is upside down to OpenCV: its first corner is the lower right one.
        """
        up, column = divmod(marker, self.columns)
        along = 2 * self.columns
        first = 2 * (self.rows - 1 - up) * along + 2 * column
        return first + along + 1, first + along, first, first + 1

    def _dictionary(self) -> str | None:
        """By its canonical name."""
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
    """A board by its name on the command line: "checkerboard:11x8" (inner corners), "charuco:8x6:5x5_100".

    Raises:
        InputError: the name is none.
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
