"""Which of the points that were found can be relied on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibrary.arrays import BoolArray, FloatArray, IntArray
from calibrary.calib.board import Board
from calibrary.calib.found import Found, NotFound, Reason, Remark
from calibrary.calib.frames import Gray
from calibrary.calib.lattice import smoothed

__all__ = ["FEWEST_POINTS", "reliable"]


FEWEST_POINTS = 6
"""Four give a plane's pose; below six nothing is left to see an error by."""

JOLT_SIGMAS, SMALLEST_JOLT_PX, SMALLEST_JOLT_SHARE = 8.0, 0.35, 0.005
DOUBTFUL_NOISE, MOST_NOISE = 0.05, 0.25
"""Of the spacing, that the typical point may lie beside a smoothly bent plane before that is remarked, and beyond which
the points are no board's."""
MOST_DISPLACED = 0.1
"""Share of points that are left out one by one. Where more lie beside the plane, the lens may bend it more than was
allowed for: the view is kept whole, and the camera decides by its residuals."""


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
    """The points but for those that lie beside the others or whose window is cut by the frame's border.

    Args:
        gray: (H, W).
        board: what was looked for.
        ids: (N,) indices into the board's points, ascending.
        points: (N, 2) px as OpenCV counts them.
        half: of the side of the window they were measured in, px.
        spacing_px: smallest distance between neighbours.
        measure: measures points again that begin elsewhere.
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
        # A start far off, by a marker's frayed edge, may have led elsewhere: begin where the others say.
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
    """How far each point lies beside the others, how far a typical one, which are too far, and where they should be.

    The worst point is removed and the plane fitted again until no outlier is left: one bad point bends the whole fit.
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
