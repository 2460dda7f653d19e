"""Quick check for a calibration board in an image, for folders with board and flight images.

It uses a reduced copy and takes 0.1 s per image. The result is not a measurement:
:func:`calibrary.calib.collect.collect` detects the board again at full resolution, and states the reason if it cannot.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from calibrary.calib.board import LARGEST, Board
from calibrary.calib.detect import detect
from calibrary.calib.detectors.refinement import DETECTION_SIDE, reduced
from calibrary.calib.found import Found
from calibrary.calib.frames import Gray, frame_size, read_frame
from calibrary.calib.opencv_state import one_thread, quiet

__all__ = ["shows_board"]

SIDE: Final = 640
"""px of the copy; a board of eleven squares across a third of it still has squares of twenty pixels."""

FEWEST: Final = (4, 6)
"""Corners along the shorter and the longer side; fields, roofs and windows often form lattices of four by four."""

REDUCTIONS: Final = (8, 4, 2)


def shows_board(path: Path, board: Board | None = None) -> bool:
    """Return whether an image shows a board, completely or in part.

    Args:
        path: image file.
        board: board to search for; by default any checkerboard. Boards with markers are detected only if given.

    Raises:
        InputError: the file cannot be read, or contains no camera image.
    """
    import cv2

    with quiet(), one_thread():
        gray = _small(path, DETECTION_SIDE if board is not None and board.has_markers else SIDE)
        if board is not None and board.has_markers:
            small, _ = reduced(gray, DETECTION_SIDE)
            return isinstance(detect(small, board), Found)
        small, _ = reduced(gray, SIDE)
        found, _, lattice = cv2.findChessboardCornersSBWithMeta(small, (3, 3), cv2.CALIB_CB_LARGER)
    shape = np.shape(lattice)[:2]
    return bool(found) and len(shape) == 2 and _is_large(min(shape), max(shape), board)


def _is_large(shorter: int, longer: int, board: Board | None) -> bool:
    """Return whether a lattice is too large to be a chance match; a smaller known board needs only its own size."""
    known = (min(board.lattice), max(board.lattice)) if board is not None else FEWEST
    return shorter >= min(FEWEST[0], known[0]) and min(FEWEST[1], known[1]) <= longer <= LARGEST


def _small(path: Path, side: int) -> Gray:
    """Return the image reduced to at least ``side`` px; a JPEG decoder does this itself in a tenth of the time."""
    import cv2

    size = frame_size(path)
    factor = next((factor for factor in REDUCTIONS if max(size) >= side * factor), 1)
    if factor > 1 and path.suffix.lower() in {".jpg", ".jpeg"}:
        flag = getattr(cv2, f"IMREAD_REDUCED_GRAYSCALE_{factor}") | cv2.IMREAD_IGNORE_ORIENTATION
        gray = cv2.imread(str(path), flag)
        if gray is not None:
            return np.asarray(gray, dtype=np.uint8)
    return read_frame(path).gray
