"""Detection of a board's points in an image, for all patterns."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from calibrary.calib.board import Board, Pattern
from calibrary.calib.detectors.checkerboard import find_checkerboard
from calibrary.calib.detectors.circles import find_circles
from calibrary.calib.detectors.markers import find_aprilgrid, find_charuco
from calibrary.calib.found import Found, NotFound
from calibrary.calib.frames import Gray
from calibrary.conventions import Origin, canonical_from_file
from calibrary.errors import InputError
from calibrary.records import replace

__all__ = ["check_detectable", "detect"]

DETECTORS: Final[Mapping[Pattern, Callable[[Gray, Board], Found | NotFound]]] = {
    Pattern.CHECKERBOARD: find_checkerboard,
    Pattern.CHARUCO: find_charuco,
    Pattern.APRILGRID: find_aprilgrid,
    Pattern.CIRCLES: find_circles,
    Pattern.ASYMMETRIC_CIRCLES: find_circles,
}

FEWEST_ALONG_A_SIDE = 3
"""OpenCV cannot detect smaller checkerboards."""


def check_detectable(board: Board) -> None:
    """Check that a board is large enough to be detected.

    Raises:
        InputError: the board is too small.
    """
    if not board.has_markers and min(board.columns, board.rows) < FEWEST_ALONG_A_SIDE:
        raise InputError(
            f"a {board.pattern.value} of {board.columns}×{board.rows}: expected at least {FEWEST_ALONG_A_SIDE} points "
            "along each side, better 8"
        )


def detect(gray: Gray, board: Board) -> Found | NotFound:
    """Detect a board's points in an image.

    The board is searched for in a reduced copy and measured in the full image; see :mod:`calibrary.calib.detectors`.
    If the colours of a checkerboard distinguish its ends, all images start at the same square.

    Args:
        gray: (H, W), as stored.
        board: board to search for.

    Returns:
        Points in the canonical pixel origin, or the reason why there are none.

    Raises:
        InputError: the board is too small; see :func:`check_detectable`.
    """
    check_detectable(board)
    found = DETECTORS[board.pattern](gray, board)
    if isinstance(found, NotFound):
        return found
    height, width = gray.shape
    offset = canonical_from_file((0.0, 0.0), Origin.PIXEL_CENTRE, (width, height))
    return replace(found, points=found.points + offset)
