"""Whether an image shows a calibration board: a look at a small copy, for folders in which boards and flights mix.

It costs a tenth of a second an image. What it says is no measurement; :func:`calibrary.calib.collect.collect` finds
the board again, at full resolution, and says why where it does not.
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
"""px of the copy; eleven squares across a third of it are still twenty pixels each."""

FEWEST: Final = (4, 6)
"""Corners along the shorter and the longer side: fields, roofs and windows happen to make lattices of four by four."""

REDUCTIONS: Final = (8, 4, 2)


def shows_board(path: Path, board: Board | None = None) -> bool:
    """Whether there is a board in an image, whole or in part.

    Args:
        path: of the image.
        board: which one, where that is known; else any checkerboard. Boards with markers are only seen by name.

    Raises:
        InputError: it cannot be read, or holds no camera's frame.
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
    """Large enough to be no accident; a board that is known to be smaller need not be larger than it is."""
    known = (min(board.lattice), max(board.lattice)) if board is not None else FEWEST
    return shorter >= min(FEWEST[0], known[0]) and min(FEWEST[1], known[1]) <= longer <= LARGEST


def _small(path: Path, side: int) -> Gray:
    """The image at no less than ``side`` px; a JPEG's decoder makes it small by itself, at a tenth of the time."""
    import cv2

    size = frame_size(path)
    factor = next((factor for factor in REDUCTIONS if max(size) >= side * factor), 1)
    if factor > 1 and path.suffix.lower() in {".jpg", ".jpeg"}:
        flag = getattr(cv2, f"IMREAD_REDUCED_GRAYSCALE_{factor}") | cv2.IMREAD_IGNORE_ORIENTATION
        gray = cv2.imread(str(path), flag)
        if gray is not None:
            return np.asarray(gray, dtype=np.uint8)
    return read_frame(path).gray
