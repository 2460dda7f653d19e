"""The boards that are photographed: which points they have, where on the board, and how they are named."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibrary.errors import InputError

__all__ = ["Board", "Pattern", "parse_board"]

FloatArray: TypeAlias = NDArray[np.float64]

LARGEST = 200
"""Corners along a side; nobody prints more, and a typing error must not ask for a million."""


class Pattern(StrEnum):
    """What is printed on the board."""

    CHECKERBOARD = "checkerboard"
    CHARUCO = "charuco"
    APRILGRID = "aprilgrid"
    CIRCLES = "circles"


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A flat pattern of points at known distances.

    Attributes:
        pattern: what is printed.
        columns, rows: points along each side; of a checkerboard its inner corners.
        square_mm: distance between neighbouring points.
        dictionary: of the markers, for patterns that have them, by OpenCV's name: "4x4_50".
        marker_mm: side of a marker, for patterns that have them.

    Raises:
        InputError: a side has fewer than 2 or more than 200 points, or a length is not positive.
    """

    pattern: Pattern = Pattern.CHECKERBOARD
    columns: int
    rows: int
    square_mm: float
    dictionary: str | None = None
    marker_mm: float | None = None

    def __post_init__(self) -> None:
        if not (2 <= self.columns <= LARGEST and 2 <= self.rows <= LARGEST):
            raise InputError(
                f"a board of {self.columns}×{self.rows} points: wanted 2 to {LARGEST} along each side"
            )
        if not (0 < self.square_mm < float("inf")):
            raise InputError(f"squares of {self.square_mm:g} mm: wanted a positive length")

    def __str__(self) -> str:
        return f"{self.pattern.value}:{self.columns}x{self.rows}"

    @property
    def points(self) -> FloatArray:
        """(rows · columns, 3) mm, row by row from the first point; the board lies in z = 0, z away from the viewer."""
        y, x = np.mgrid[: self.rows, : self.columns]
        return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]) * self.square_mm

    @property
    def extent_mm(self) -> tuple[float, float]:
        """Distance between the outermost points, (across, down)."""
        return (self.columns - 1) * self.square_mm, (self.rows - 1) * self.square_mm


def parse_board(text: str, square_mm: float) -> Board:
    """A board by its name on the command line: "checkerboard:11x8" (inner corners), "charuco:8x6".

    Raises:
        InputError: the name is none.
    """
    match = re.fullmatch(r"([a-z]+):(\d{1,4})[x×](\d{1,4})", text.strip().lower())
    if match is None or match[1] not in set(Pattern):
        raise InputError(
            f"board {text!r}: wanted PATTERN:COLUMNSxROWS, such as checkerboard:11x8 for 11×8 inner corners "
            f"(12×9 squares); patterns are {', '.join(Pattern)}"
        )
    return Board(pattern=Pattern(match[1]), columns=int(match[2]), rows=int(match[3]), square_mm=square_mm)
