"""Detection of a wrong number of columns, when no camera explains the corners.

Corners are numbered row by row, so a wrong number of columns shifts every row relative to the next. Apart from
distortion, the image of a plane is a homography of it; the right number is the one for which every view nearly is.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.board import Board, Pattern
from calibrary.calib.observations import Observations, View

__all__ = ["other_columns"]

COUNTS: Final = range(3, 61)
FITS: Final = 0.15
"""Largest RMS deviation, in corner spacings, due to strong distortion; a wrong count deviates by whole squares."""
MISFITS: Final = 0.3
MOST_VIEWS: Final = 8
FEWEST_CORNERS: Final = 12


def other_columns(observations: Observations) -> int | None:
    """Return the number of columns for which the corners fit a plane, if the stated number does not; else None."""
    board = observations.board
    if not isinstance(board, Board) or board.pattern is not Pattern.CHECKERBOARD:
        return None
    views = [view for view in observations.views if len(view.ids) >= FEWEST_CORNERS][:MOST_VIEWS]
    if not views or _misfit(views, board.columns) < MISFITS:
        return None
    found = {count: _misfit(views, count) for count in COUNTS if count != board.columns}
    best = min(found, key=lambda count: found[count])
    return best if found[best] < FITS else None


def _misfit(views: list[View], columns: int) -> float:
    """Return the median over the views of the RMS distance from the best homography, in corner spacings."""
    return float(np.median([_off_plane(view.ids, view.image_points, columns) for view in views]))


def _off_plane(ids: IntArray, pixels: FloatArray, columns: int) -> float:
    plane = np.stack([ids % columns, ids // columns], axis=1).astype(np.float64)
    if not (np.ptp(plane, axis=0) > 0).all():
        return np.inf
    source, target = _unit(plane), _unit(pixels)
    rows = np.zeros((2 * len(ids), 9))
    homogeneous = np.column_stack([source, np.ones(len(ids))])
    rows[::2, :3] = rows[1::2, 3:6] = homogeneous
    rows[::2, 6:], rows[1::2, 6:] = -target[:, :1] * homogeneous, -target[:, 1:] * homogeneous
    H = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 3)
    seen = homogeneous @ H.T
    with np.errstate(all="ignore"):
        apart = seen[:, :2] / seen[:, 2:] - target
    beside = np.diff(ids) == 1
    spacing = (
        float(np.median(np.linalg.norm(np.diff(target, axis=0)[beside], axis=1))) if beside.any() else 0.0
    )
    rms = float(np.sqrt((apart**2).sum(axis=1).mean()))
    return rms / spacing if spacing > 0 and np.isfinite(rms) else np.inf


def _unit(points: FloatArray) -> FloatArray:
    """Centre the points and scale them to unit size, for the conditioning of the equations.

    Source: R. I. Hartley, "In defence of the 8-point algorithm", 1995.
    """
    middle = points - points.mean(axis=0)
    return np.asarray(middle / np.sqrt((middle**2).sum(axis=1).mean()))
