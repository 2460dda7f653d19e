"""Boards with markers that identify the points, so that a part of the board is enough: ChArUco and AprilGrid.

OpenCV detects and identifies the markers; each point is then measured as a saddle point, inside the free space between
a marker's code and its neighbours.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.board import Board
from calibrary.calib.detectors.refinement import DETECTION_SIDE, enlarged, half_window, reduced, refined
from calibrary.calib.detectors.reliability import FEWEST_POINTS, reliable
from calibrary.calib.found import Found, NotFound, Reason
from calibrary.calib.frames import Gray

SIDES: Final = (DETECTION_SIDE, 2 * DETECTION_SIDE)
"""Longer side in px of the copies searched for markers; the larger one if the smaller does not show all of them."""

LARGEST_SHIFT = 0.5

FREE_USED = 0.65
"""Used share of the free space around a point; on a tilted board it is narrower in one direction."""

TAG_BORDER = 2
"""Width in modules of the dark border of Kalibr's tags; OpenCV's own drawings have one."""


def find_charuco(gray: Gray, board: Board) -> Found | NotFound:
    """Find the inner corners of a ChArUco board that lie between two visible markers.

    Before 4.14, OpenCV's corners are off by half a pixel; so only corners measured here are returned.

    Args:
        gray: (H, W).
        board: a ChArUco board.

    Returns:
        Points in px with OpenCV's pixel origin.
    """
    dictionary = _dictionary(board)
    # With an even number of rows of squares, OpenCV before 4.6 drew a marker in the first square.
    layouts = (False, True) if board.rows % 2 else (False,)
    detectors = [_charuco_detector(board, dictionary, legacy=legacy) for legacy in layouts]

    def look(small: Gray) -> tuple[IntArray, FloatArray]:
        found: tuple[Any, ...] = detectors[0].detectBoard(small)
        if found[0] is None and found[3] is not None and len(detectors) > 1:
            found = detectors[1].detectBoard(small, None, None, *found[2:4])
        if found[0] is None or found[1] is None:
            return np.empty(0, np.intp), np.empty((0, 2))
        corners, ids = np.reshape(np.asarray(found[0]), (-1, 2)), np.ravel(np.asarray(found[1]))
        order = np.argsort(ids)
        return ids[order].astype(np.intp), corners[order].astype(np.float64)

    free = (board.pitch - board.marker) / 2 / board.pitch
    return _measured(gray, board, look, FREE_USED * free)


def _charuco_detector(board: Board, dictionary: Any, *, legacy: bool) -> Any:
    import cv2

    squares = board.columns + 1, board.rows + 1
    charuco = cv2.aruco.CharucoBoard(squares, board.pitch, board.marker, dictionary)
    charuco.setLegacyPattern(legacy)
    return cv2.aruco.CharucoDetector(charuco)


def find_aprilgrid(gray: Gray, board: Board) -> Found | NotFound:
    """Find the corners of an AprilGrid's visible tags, four per tag.

    Args:
        gray: (H, W).
        board: an AprilGrid as Kalibr prints it, with small dark squares at the tags' corners.

    Returns:
        Points in px with OpenCV's pixel origin.
    """
    import cv2

    dictionary = _dictionary(board)
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = TAG_BORDER
    parameters.perspectiveRemovePixelPerCell = 8
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)

    def look(small: Gray) -> tuple[IntArray, FloatArray]:
        corners, markers, _ = detector.detectMarkers(small)
        seen: dict[int, FloatArray] = {}
        # Without markers, ``markers`` is None and ``corners`` an empty tuple.
        for quad, marker in zip(corners, np.ravel(markers), strict=False):
            if marker < board.markers:
                seen.update(zip(board.tag_points(int(marker)), np.reshape(quad, (4, 2)), strict=True))
        ids = np.array(sorted(seen), dtype=np.intp)
        return ids, np.array([seen[i] for i in ids], dtype=np.float64).reshape(-1, 2)

    tag = board.marker
    # The free space ends at the code inside the dark border, and at the next tag beyond the gap.
    border = tag * TAG_BORDER / (dictionary.markerSize + 2 * TAG_BORDER)
    free = min(board.pitch - tag, border) / board.pitch
    return _measured(gray, board, look, FREE_USED * free)


def _dictionary(board: Board) -> Any:
    """Return OpenCV's dictionary of the board's markers."""
    import cv2

    name = f"DICT_{(board.dictionary or '').upper()}"
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def _measured(
    gray: Gray, board: Board, look: Callable[[Gray], tuple[IntArray, FloatArray]], free_share: float
) -> Found | NotFound:
    """Measure in the full image the points that ``look`` finds in a reduced copy.

    Args:
        gray: (H, W).
        board: board to search for.
        look: returns ascending indices into the board's points, and their positions in the copy.
        free_share: largest half-width of a window around a point, as a share of the square.
    """
    wanted = len(board.points)
    small, scale = reduced(gray, SIDES[0])
    ids, rough = look(small)
    if len(ids) < wanted and np.any(scale > 1):
        larger, its_scale = reduced(gray, SIDES[1])
        more, its_rough = look(larger)
        if len(more) > len(ids):
            small, scale, ids, rough = larger, its_scale, more, its_rough
    if len(ids) < FEWEST_POINTS:
        text = f"no {board}" if not len(ids) else f"{len(ids)} of {wanted} points of {board} seen"
        return NotFound(reason=Reason.FEW_POINTS if len(ids) else Reason.NO_BOARD, text=text)
    if np.any(scale > 1):
        half = half_window(_square_px(board, ids, rough)[1], free_share)
        rough = enlarged(refined(small, rough, half), scale)
    square = _square_px(board, ids, rough)[1]
    half = half_window(square, free_share)
    points = refined(gray, rough, half)
    steady = np.hypot(*(points - rough).T) < LARGEST_SHIFT * square
    ids, points = ids[steady], points[steady]
    measure = partial(refined, gray, half=half)
    spacing = _square_px(board, ids, points)[0]
    return reliable(gray, board, ids, points, half=half, spacing_px=spacing, measure=measure)


def _square_px(board: Board, ids: IntArray, points: FloatArray) -> tuple[float, float]:
    """Return the smallest neighbour distance and the smallest square's side, in px; 0 without neighbours."""
    columns, rows = board.lattice
    seen = np.full((rows * columns, 2), np.nan)
    seen[ids] = points
    image = seen.reshape(rows, columns, 2)
    print_mm = board.points[:, :2].reshape(rows, columns, 2)
    px, mm = (
        np.concatenate([np.hypot(*np.moveaxis(np.diff(grid, axis=axis), 2, 0)).ravel() for axis in (0, 1)])
        for grid in (image, print_mm)
    )
    known = ~np.isnan(px)
    if not known.any():
        return 0.0, 0.0
    return float(px[known].min()), float((px / mm)[known].min() * board.pitch)
