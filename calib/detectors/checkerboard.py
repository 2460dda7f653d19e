"""Checkerboards: detected in a reduced copy, measured in the full image."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.detectors.growing import grown
from calibrary.calib.detectors.partial import find_partial
from calibrary.calib.detectors.refinement import DETECTION_SIDE, enlarged, half_window, reduced, refined
from calibrary.calib.detectors.reliability import reliable
from calibrary.calib.found import Found, NotFound, Reason
from calibrary.calib.frames import Gray
from calibrary.calib.lattice import goes_on, is_even, overhangs, smallest_spacing, squares_share, upright

FEWEST_ALONG_A_SIDE = 3
"""OpenCV cannot detect smaller checkerboards."""

MOSTLY = 0.5
"""Share of the corners of a row or column from which it belongs to the board."""

NEARLY = 0.9
"""Share of the corners of a grown piece from which its number of rows and columns is that of the board."""

LARGEST_SHIFT = 0.5
"""Largest shift of a corner by the measurement, in spacings; a larger one means a jump to another corner."""

ADAPTIVE_SIDE = 800
"""Longer side in px of the copy in which adaptive thresholds are tried."""

FEWEST_SQUARES = 0.8
"""Smallest share of cells that look like squares; glare or a finger may hide some."""


def find_checkerboard(gray: Gray, board: Board) -> Found | NotFound:
    """Find the inner corners; if the board is partly outside the image or covered, those that are visible.

    Args:
        gray: (H, W).
        board: a checkerboard.

    Returns:
        Points in px with OpenCV's pixel origin.
    """
    small, _ = reduced(gray)
    size = (board.columns, board.rows)
    # Twice the board's size, so that a board with more squares than stated is seen to have them.
    grow = partial(grown, gray, small, 2 * max(size))
    rough = _quick(small, size)
    piece = None
    if rough is None:
        # If no piece of a board can be grown, the slow detectors find no whole board either; growing is faster.
        piece = grow()
        if piece is None:
            return _missing(board)
        rough = _slow(small, size)
    whole = _measured(gray, board, small, rough)
    if isinstance(whole, Found) or whole.reason is Reason.LARGER_BOARD:
        return whole
    part = find_partial(gray, board, piece if piece is not None else grow())
    # The reason from the search for a whole board is more informative than "no piece found".
    return whole if part is None else part


def grown_board(gray: Gray, largest: int) -> tuple[tuple[int, int] | None, Found | NotFound]:
    """Grow the largest piece of a checkerboard, of any size.

    Args:
        gray: (H, W).
        largest: largest number of corners along a side.

    Returns:
        (columns, rows) of the piece with columns ≥ rows, None without one; and its points if it is a whole board, or
        the reason why it is none.
    """
    small, scale = reduced(gray)
    lattice = grown(gray, small, largest)
    lattice = _without_strays(lattice) if lattice is not None else None
    if lattice is None:
        return None, NotFound(reason=Reason.NO_BOARD, text="no piece of a checkerboard")
    if lattice.shape[0] > lattice.shape[1]:
        lattice = np.rot90(lattice)
    rows, columns = lattice.shape[:2]
    board = Board(columns=columns, rows=rows, square_mm=None)
    known = np.isfinite(lattice[..., 0])
    if known.all():
        found = _measured(gray, board, small, (lattice + 0.5) / scale - 0.5)
    elif known.mean() >= NEARLY:
        found = find_checkerboard(gray, board)
    else:
        text = f"{known.sum()} of {columns}×{rows} corners seen"
        found = NotFound(reason=Reason.FEW_POINTS, text=text)
    return (columns, rows), found


def _without_strays(lattice: FloatArray) -> FloatArray | None:
    """Leave out rows and columns at the edge that are mostly empty: growth goes astray beside the board."""
    while min(lattice.shape[:2]) >= FEWEST_ALONG_A_SIDE:
        known = np.isfinite(lattice[..., 0])
        shares = (known[0].mean(), known[-1].mean(), known[:, 0].mean(), known[:, -1].mean())
        at = int(np.argmin(shares))
        if shares[at] >= MOSTLY:
            return lattice
        lattice = (lattice[1:], lattice[:-1], lattice[:, 1:], lattice[:, :-1])[at]
    return None


def _missing(board: Board) -> NotFound:
    return NotFound(
        reason=Reason.NO_BOARD, text=f"no checkerboard of {board.columns}×{board.rows} inner corners"
    )


def _measured(gray: Gray, board: Board, small: Gray, rough: FloatArray | None) -> Found | NotFound:
    """Measure all inner corners from those in the reduced copy, except displaced ones and those at the image border."""
    if rough is None:
        return _missing(board)
    scale = np.array(gray.shape[::-1]) / small.shape[::-1]
    if not is_even(rough):
        return NotFound(reason=Reason.UNEVEN, text="what looks like the board is folded or torn")
    if np.any(scale > 1):
        # The error in the full image is then below one pixel of the copy, whatever the image size.
        rough = enlarged(refined(small, rough, half_window(smallest_spacing(rough))), scale)
    spacing = smallest_spacing(rough)
    half = half_window(spacing)
    lattice = refined(gray, rough, half)
    shift = float(np.hypot(*(lattice - rough).reshape(-1, 2).T).max())
    if shift > LARGEST_SHIFT * spacing or not is_even(lattice):
        return NotFound(
            reason=Reason.UNEVEN,
            text=f"measuring moved a corner by {shift:.1f} px of a spacing of {spacing:.1f} px: not a regular board",
        )
    lattice = upright(lattice, gray)
    if squares_share(gray, lattice) < FEWEST_SQUARES:
        return NotFound(
            reason=Reason.UNEVEN, text="what looks like the board has no alternating dark and light squares"
        )
    direction = goes_on(gray, lattice)
    if direction is not None:
        return NotFound(
            reason=Reason.LARGER_BOARD,
            text=f"the board has more {direction} than {board.columns}×{board.rows} inner corners; count them again",
        )
    direction = overhangs(gray, lattice)
    if direction is not None:
        return NotFound(
            reason=Reason.NO_BOARD,
            text=f"the board has fewer {direction} than {board.columns}×{board.rows} inner corners; count them again",
        )
    ids = np.arange(board.columns * board.rows)
    measure = partial(refined, gray, half=half)
    return reliable(
        gray,
        board,
        ids,
        lattice.reshape(-1, 2),
        half=half,
        spacing_px=smallest_spacing(lattice),
        measure=measure,
    )


def _quick(small: Gray, size: tuple[int, int]) -> FloatArray | None:
    """Return corners accurate to about 1 px, (rows, columns, 2), by a fast detector that finds most boards.

    This is OpenCV's older detector without adaptive thresholds.
    """
    import cv2

    flags = cv2.CALIB_CB_NORMALIZE_IMAGE
    if max(small.shape) >= DETECTION_SIDE:
        # In large images the texture of a scene without a board takes longer than everything else.
        flags |= cv2.CALIB_CB_FAST_CHECK
    return _as_lattice(*cv2.findChessboardCorners(small, size, flags=flags), size)


def _slow(small: Gray, size: tuple[int, int]) -> FloatArray | None:
    """Return the same by slower detectors, which find further boards."""
    lattice = _sector_based(small, size)
    return lattice if lattice is not None else _adaptive(small, size)


def _sector_based(small: Gray, size: tuple[int, int]) -> FloatArray | None:
    """Use findChessboardCornersSB; its corners are biased, so they serve only as approximate positions."""
    import cv2

    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    return _as_lattice(*cv2.findChessboardCornersSB(small, size, flags=flags), size)


def _adaptive(small: Gray, size: tuple[int, int]) -> FloatArray | None:
    """Use adaptive thresholds, slow on textures, so in a smaller copy and only if something looks like squares."""
    import cv2

    smaller, scale = reduced(small, ADAPTIVE_SIDE)
    if not cv2.checkChessboard(smaller, size):
        return None
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    lattice = _as_lattice(*cv2.findChessboardCorners(smaller, size, flags=flags), size)
    return enlarged(lattice, scale) if lattice is not None else None


def _as_lattice(found: bool, corners: Any, size: tuple[int, int]) -> FloatArray | None:  # noqa: FBT001 - OpenCV's pair
    return None if not found else np.asarray(corners, dtype=np.float64).reshape(size[1], size[0], 2)
