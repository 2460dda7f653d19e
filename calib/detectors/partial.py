"""Partly visible checkerboards: the position of a grown piece of lattice on the board.

The points of a plane grid may be numbered from any corner: another first corner is another pose of the same view. The
camera does not change, and neither does the warp, since its parabola is the same about any other point (see
tests/calib/test_partial_boards.py). So a piece with an ambiguous position is numbered from one of the possible
positions, with a remark. The position is determined by the ends of the board, where visible, by the colours of the
squares, and by the number of corners along each side.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from msgspec import Struct

from calibrary.calib.board import Board
from calibrary.calib.detectors.refinement import half_window, refined
from calibrary.calib.detectors.reliability import reliable
from calibrary.calib.found import Found, NotFound, Reason, Remark
from calibrary.calib.frames import Gray
from calibrary.calib.lattice import Lattice, contrast, ends_on_paper, smallest_spacing, squares_share
from calibrary.records import replace

FEWEST_CORNERS, LEAST_SHARE = 12, 0.2
"""Smallest number and share of corners; fewer say little, and floors and windows often form lattices of 3 by 4."""
FEWEST_LINES = 3
FEWEST_SQUARES = 0.8
SPARSE = 0.5
"""Share of a line's corners. In a lattice too large for the board, an outer line with fewer is the board's edge."""


class _Placement(Struct, frozen=True, kw_only=True, eq=False):
    """A possible position of a piece: its rotated lattice, and the row and column of its first corner."""

    lattice: Lattice
    row: int
    column: int


def find_partial(gray: Gray, board: Board, piece: Lattice | None) -> Found | NotFound | None:
    """Find the visible inner corners of a checkerboard that is not completely visible.

    Args:
        gray: (H, W).
        board: a checkerboard.
        piece: lattice grown by :func:`~calibrary.calib.detectors.growing.grown`.

    Returns:
        Points in px with OpenCV's pixel origin; None if there is no piece of a board.
    """
    if piece is None:
        return None
    piece = _trimmed(piece, board)
    shape, count = piece.shape[:2], int(np.isfinite(piece[..., 0]).sum())
    if count < max(FEWEST_CORNERS, LEAST_SHARE * len(board.points)) or min(shape) < FEWEST_LINES:
        return None
    spacing = smallest_spacing(piece)
    half = half_window(spacing)
    seen = np.isfinite(piece[..., 0])
    piece[seen] = refined(gray, piece[seen], half)
    if squares_share(gray, piece) < FEWEST_SQUARES:
        return None
    if not _fits(shape, board):
        text = (
            f"the board has more than {board.columns}×{board.rows} inner corners, {max(shape)}×{min(shape)} are seen; "
            "count them again"
        )
        return NotFound(reason=Reason.LARGER_BOARD, text=text)
    # On a heated board, or a negative, dark and light are exchanged.
    placements = [*_placements(gray, piece, board)] or [*_placements(gray, piece, board, negative=True)]
    if not placements:
        text = f"a board that ends all around after {max(shape)}×{min(shape)} inner corners; count them again"
        return NotFound(reason=Reason.NO_BOARD, text=text)
    chosen = max(placements, key=_rightwards)
    rows, columns = np.nonzero(np.isfinite(chosen.lattice[..., 0]))
    ids = (rows + chosen.row) * board.columns + columns + chosen.column
    found = reliable(
        gray,
        board,
        ids,
        chosen.lattice[rows, columns],
        half=half,
        spacing_px=spacing,
        measure=partial(refined, gray, half=half),
    )
    if isinstance(found, NotFound):
        return found
    at = {(one.row, one.column) for one in placements if one.lattice.shape == chosen.lattice.shape}
    where = "" if len(at) == 1 else ", where on the board is not known, which K does not depend on"
    if len(ids) == len(board.points):
        return found
    text = f"{len(ids)} of {len(board.points)} corners seen{where}"
    return replace(found, remarks=(Remark(reason=Reason.PARTIAL_BOARD, text=text), *found.remarks))


def _trimmed(piece: Lattice, board: Board) -> Lattice:
    """Remove sparse outer lines that make the piece larger than the board: false corners on the board's edge."""
    while not _fits(piece.shape[:2], board):
        # Rotate the side with the fewest corners to the top.
        turns = [np.rot90(piece, turn) for turn in range(4)]
        piece = min(turns, key=lambda lattice: float(np.isfinite(lattice[0, :, 0]).mean()))
        if np.isfinite(piece[0, :, 0]).mean() > SPARSE or len(piece) <= FEWEST_LINES:
            break
        piece = piece[1:]
    return piece.copy()


def _fits(shape: tuple[int, ...], board: Board) -> bool:
    return max(shape) <= max(board.columns, board.rows) and min(shape) <= min(board.columns, board.rows)


def _placements(gray: Gray, piece: Lattice, board: Board, *, negative: bool = False) -> Iterator[_Placement]:
    """Yield all possible positions, by the colours of the squares and by the visible ends of the board."""
    for turn in range(4):
        lattice = np.ascontiguousarray(np.rot90(piece, turn))
        rows, columns = board.rows - lattice.shape[0], board.columns - lattice.shape[1]
        if rows < 0 or columns < 0:
            continue
        dark_first = (contrast(gray, lattice) > 0) is not negative
        turned = lattice.transpose(1, 0, 2)
        first_row, last_row = ends_on_paper(gray, lattice), ends_on_paper(gray, lattice[::-1])
        first_column, last_column = ends_on_paper(gray, turned), ends_on_paper(gray, turned[::-1])
        for row in range(rows + 1):
            for column in range(columns + 1):
                if (
                    ((row + column) % 2 == 0) == dark_first
                    and (row == 0 or not first_row)
                    and (row == rows or not last_row)
                    and (column == 0 or not first_column)
                    and (column == columns or not last_column)
                ):
                    yield _Placement(lattice=lattice, row=row, column=column)


def _rightwards(placement: _Placement) -> tuple[float, int, int]:
    """Return the sort key: how far the rows run to the right; among equals, the place nearest to the first corner."""
    steps = np.diff(placement.lattice, axis=1).reshape(-1, 2)
    run = np.nanmean(steps, axis=0)
    return float(run[0] / np.hypot(*run)), -placement.row, -placement.column
