"""Selection of the reliable points among those found."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibrary.arrays import BoolArray, FloatArray, IntArray
from calibrary.calib.board import Board
from calibrary.calib.found import Found, NotFound, Reason, Remark
from calibrary.calib.frames import Gray
from calibrary.calib.lattice import smoothed

FEWEST_POINTS = 6
"""Four points determine the pose of a plane; with fewer than six, no redundancy is left to reveal an error."""

JOLT_SIGMAS, SMALLEST_JOLT_PX, SMALLEST_JOLT_SHARE = 8.0, 0.35, 0.005
DOUBTFUL_NOISE, MOST_NOISE = 0.05, 0.25
"""Median distance of the points from a smoothly bent plane, in spacings: above the first a remark is made, above the
second the points are not a board's."""
MOST_DISPLACED = 0.1
"""Largest share of points that are removed individually. If more deviate, the distortion may be stronger than the
surface allows: the view is kept complete, and the residuals of the camera decide."""


def reliable(
    gray: Gray,
    board: Board,
    ids: IntArray,
    points: FloatArray,
    *,
    half: int,
    spacing_px: float,
    measure: Callable[[FloatArray], FloatArray] | None = None,
) -> Found | NotFound:
    """Keep the points that agree with the others and have a window inside the image.

    Args:
        gray: (H, W).
        board: board that was searched for.
        ids: (N,) indices into the board's points, ascending.
        points: (N, 2) px with OpenCV's pixel origin.
        half: half the side of the measuring window, px.
        spacing_px: smallest distance between neighbours, px.
        measure: repeats the measurement of points from other start positions.
    """
    places = board.points[ids, :2]
    total = len(board.points)
    if len(ids) < FEWEST_POINTS or np.linalg.matrix_rank(places - places.mean(axis=0)) < 2:
        return NotFound(
            reason=Reason.FEW_POINTS,
            text=f"{len(ids)} of {total} points seen; expected at least {FEWEST_POINTS}, not all on a line",
        )
    off, noise, displaced, smooth = _displaced(places, points, spacing_px)
    strongly = not displaced.mean() <= MOST_DISPLACED
    if strongly:
        off, noise, displaced, smooth = _displaced(places, points, spacing_px, strongly=True)
    if measure is not None and displaced.any() and displaced.mean() <= MOST_DISPLACED and smooth is not None:
        # A bad start position, such as a frayed marker edge, may have led elsewhere: start where the others predict.
        points = points.copy()
        points[displaced] = measure(smooth[displaced])
        off, noise, displaced, _ = _displaced(places, points, spacing_px, strongly=strongly)
    beside = (
        f"points lie up to {off.max():.1f} px beside a regular board, at a spacing of {spacing_px:.1f} px"
    )
    if not noise <= MOST_NOISE * spacing_px:
        return NotFound(reason=Reason.UNEVEN, text=beside)
    doubtful = displaced.mean() > MOST_DISPLACED or noise > DOUBTFUL_NOISE * spacing_px
    if doubtful:
        displaced = np.zeros_like(displaced)
    height, width = gray.shape
    cut = np.minimum(points, (width - 1, height - 1) - points).min(axis=1) < half + 1
    remarks = []
    if doubtful:
        remarks.append(Remark(reason=Reason.UNEVEN, text=f"{beside}; kept for the camera to decide"))
    if displaced.any():
        text = f"{displaced.sum()} of {len(ids)} points left out, up to {off.max():.1f} px beside the others"
        remarks.append(Remark(reason=Reason.DISPLACED_CORNERS, text=text))
    if cut.any():
        text = f"{cut.sum()} of {len(ids)} points left out, within {half + 1} px of the frame's border"
        remarks.append(Remark(reason=Reason.AT_BORDER, text=text))
    kept = ~(displaced | cut)
    if kept.sum() < FEWEST_POINTS:
        text = f"{kept.sum()} of {total} points inside the frame; expected at least {FEWEST_POINTS}"
        return NotFound(reason=Reason.FEW_POINTS, text=text)
    columns, rows = board.lattice
    return Found(
        ids=ids[kept],
        points=points[kept],
        spacing_px=spacing_px,
        lattice=points.reshape(rows, columns, 2) if len(ids) == total else None,
        remarks=tuple(remarks),
    )


def _displaced(
    places: FloatArray, points: FloatArray, spacing_px: float, *, strongly: bool = False
) -> tuple[FloatArray, float, BoolArray, FloatArray | None]:
    """Return the deviation of each point, that of a typical one, which are too large, and the expected positions.

    The worst point is removed and the surface fitted again until no outlier is left, since one bad point distorts the
    fit.
    """
    trusted = np.ones(len(points), dtype=np.bool_)
    while True:
        smooth = smoothed(places, points, trusted, strongly=strongly)
        if smooth is None:
            return np.full(len(points), np.inf), np.inf, ~np.zeros_like(trusted), None
        off = np.hypot(*(points - smooth).T)
        noise = 1.4826 * float(np.median(off[trusted]))
        displaced = off > max(JOLT_SIGMAS * noise, SMALLEST_JOLT_PX, SMALLEST_JOLT_SHARE * spacing_px)
        worst = int(np.argmax(np.where(trusted, off, -1.0)))
        if not displaced[worst] or displaced.mean() > MOST_DISPLACED:
            return off, noise, displaced, smooth
        trusted[worst] = False
