"""Boards whose points are identified by markers, so that a part of the board is enough: ChArUco and AprilGrid.

OpenCV says which marker is where; each point is then measured as the saddle point that it is, inside the free space
between a marker's code and its neighbours.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.board import Board
from calibrary.calib.detectors.refinement import DETECTION_SIDE, half_window, reduced, refined
from calibrary.calib.detectors.reliability import FEWEST_POINTS, reliable
from calibrary.calib.found import Found, NotFound, Reason
from calibrary.calib.frames import Gray

__all__ = ["find_aprilgrid", "find_charuco"]


SIDES: Final = (DETECTION_SIDE, 2 * DETECTION_SIDE)
"""px of the copies in which markers are looked for, the larger one where the smaller shows not all of them."""

LARGEST_SHIFT = 0.5

FREE_USED = 0.65
"""Of the free space around a point; a tilted board's is narrower across than along."""

TAG_BORDER = 2
"""Modules of the dark border around a tag of Kalibr's; OpenCV's own drawings have one."""


def find_charuco(gray: Gray, board: Board) -> Found | NotFound:
    """The inner corners of a ChArUco board, as many as are seen between two markers.

    Before 4.14 OpenCV's own corners are half a pixel off; only those measured here are given.

    Args:
        gray: (H, W).
        board: a ChArUco board.

    Returns:
        Points in px as OpenCV counts them.
    """
    import cv2

    dictionary = _dictionary(board)
    sides = board.pitch, board.marker
    charuco = cv2.aruco.CharucoBoard((board.columns + 1, board.rows + 1), *sides, dictionary)
    detector = cv2.aruco.CharucoDetector(charuco)

    def look(small: Gray) -> tuple[IntArray, FloatArray]:
        found: tuple[object, ...] = detector.detectBoard(small)
        # OpenCV's own types do not say that both may be None.
        if found[0] is None or found[1] is None:
            return np.empty(0, np.intp), np.empty((0, 2))
        corners, ids = np.reshape(np.asarray(found[0]), (-1, 2)), np.ravel(np.asarray(found[1]))
        order = np.argsort(ids)
        return ids[order].astype(np.intp), corners[order].astype(np.float64)

    free = (board.pitch - board.marker) / 2 / board.pitch
    return _measured(gray, board, look, FREE_USED * free)


def find_aprilgrid(gray: Gray, board: Board) -> Found | NotFound:
    """The corners of an AprilGrid's tags, four for each that is seen.

    Args:
        gray: (H, W).
        board: an AprilGrid as Kalibr prints it, with small dark squares between the tags' corners.

    Returns:
        Points in px as OpenCV counts them.
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
        # Where there is no marker, markers are None and corners an empty tuple.
        for quad, marker in zip(corners, np.ravel(markers), strict=False):
            if marker < board.markers:
                seen.update(zip(board.tag_points(int(marker)), np.reshape(quad, (4, 2)), strict=True))
        ids = np.array(sorted(seen), dtype=np.intp)
        return ids, np.array([seen[i] for i in ids], dtype=np.float64).reshape(-1, 2)

    tag = board.marker
    # The code begins behind the dark border, the next tag behind the gap.
    border = tag * TAG_BORDER / (dictionary.markerSize + 2 * TAG_BORDER)
    free = min(board.pitch - tag, border) / board.pitch
    return _measured(gray, board, look, FREE_USED * free)


def _dictionary(board: Board) -> Any:
    """OpenCV's record of the board's markers."""
    import cv2

    name = f"DICT_{(board.dictionary or '').upper()}"
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def _measured(
    gray: Gray, board: Board, look: Callable[[Gray], tuple[IntArray, FloatArray]], free_share: float
) -> Found | NotFound:
    """Points that ``look`` finds in a small copy, measured in the image itself.

    Args:
        gray: (H, W).
        board: what is looked for.
        look: gives ascending indices into the board's points, and where they are in the copy.
        free_share: of the square, that a window may reach to each side of a point.
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
        rough = (
            refined(small, rough, half_window(_square_px(board, ids, rough)[1], free_share)) + 0.5
        ) * scale - 0.5
    square = _square_px(board, ids, rough)[1]
    half = half_window(square, free_share)
    points = refined(gray, rough, half)
    steady = np.hypot(*(points - rough).T) < LARGEST_SHIFT * square
    ids, points = ids[steady], points[steady]
    measure = partial(refined, gray, half=half)
    spacing = _square_px(board, ids, points)[0]
    return reliable(gray, board, ids, points, half=half, spacing_px=spacing, measure=measure)


def _square_px(board: Board, ids: IntArray, points: FloatArray) -> tuple[float, float]:
    """Px between the closest neighbours, and px of the smallest square; 0 where no two neighbours are seen."""
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
