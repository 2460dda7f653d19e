"""Geometry of the views: tilt, depth, coverage of the image, where corners prove a calibration, and duplicate poses.

The residuals say nothing of a lens where no corner was seen. The standard deviation there is an extrapolation of the
model, with what a longer series might do; it may be stated, but nothing confirms it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.adjustment import Adjusted
from calibrary.calib.network import linearise
from calibrary.calib.projection_difference import Uncertainty
from calibrary.calibration import ImageSize
from calibrary.quality import ImageCircle, Proven
from calibrary.records import Record, replace

CELLS: Final = (8, 6)
"""Number of columns and rows of cells in the image."""
BORDER: Final = 0.1
"""Width of the border ring, as a fraction of the image's sides."""
BORDER_PARTS: Final = 24
ALMOST_ALL_PAIRS: Final = 90.0
"""Percentile; a single outlying view does not increase the spread."""
NEAREST: Final = 1e-9
"""A smaller distance counts as this one, so that the ratio of depths stays finite."""
SAME_PLACE: Final = 1e-3
"""Two views show the same pose if their corners differ on average by less than this share of the width, or 1 px."""

NEAR: Final = 1 / 24
"""A corner proves its surroundings up to this share of the image's longer side: 80 px of 1920. In simulated sets the
error over σ rises beyond it."""
BINS: Final = 4
"""Corners are counted in cells of this part of that distance: thousands of them cost no more than a few."""
MOST_GAPS: Final = (2, 0.05)
"""Places within the proven radius that may be unproven: a number, and a share of all."""


class Coverage(Record):
    """Coverage of the image by corners.

    Attributes:
        cells: row by row, whether each of 8 × 6 cells of the image contains a corner.
        fraction: fraction of the cells that contain a corner.
        border: fraction of the parts of a ring along the image's edge, a tenth of its sides wide, that contain one.
        reach: distance of the corners from the image centre, 1 at the image's corners; mean of the four quadrants.
    """

    cells: tuple[tuple[bool, ...], ...]
    fraction: float
    border: float
    reach: float


class Geometry(Record):
    """Geometry of the board's poses.

    Attributes:
        tilt_spread_deg: angle between board normals in degrees, exceeded by one tenth of the pairs of views.
        roll_spread_deg: largest angle between the rows of two boards, seen along the axis, at most 90°.
        depth_ratio: distance of the farthest corner divided by that of the nearest.
        distance: median distance of the boards, in the board's unit.
        coverage: coverage of the image.
    """

    tilt_spread_deg: float
    roll_spread_deg: float
    depth_ratio: float
    distance: float
    coverage: Coverage


def geometry(adjusted: Adjusted, image_size: ImageSize) -> Geometry:
    """Measure the geometry of a solution's views; rejected views are ignored."""
    network, state = adjusted.network, adjusted.state
    used = network.used
    turns, places = state.rotations[used], state.translations[used]
    inside = network.points[used] @ turns.transpose(0, 2, 1) + places[:, None, :]
    distance = np.linalg.norm(inside, axis=-1)[network.seen[used]]
    return Geometry(
        tilt_spread_deg=_tilt_spread(turns[:, :, 2]),
        roll_spread_deg=_roll_spread(turns[:, :, 0]),
        depth_ratio=float(distance.max() / max(distance.min(), NEAREST)),
        distance=float(np.median(np.linalg.norm(places, axis=1))),
        coverage=coverage(network.pixels[network.seen], image_size),
    )


def coverage(pixels: FloatArray, image_size: ImageSize) -> Coverage:
    """Return the coverage of an image by corners, (N, 2) px."""
    columns, rows = CELLS
    share = pixels / np.array(image_size)
    share = share[((share >= 0) & (share < 1)).all(axis=1)]
    cells = np.zeros((rows, columns), dtype=np.bool_)
    cells[(share[:, 1] * rows).astype(np.intp), (share[:, 0] * columns).astype(np.intp)] = True

    away = share - 0.5
    ring = np.abs(away).max(axis=1) > 0.5 - BORDER
    part = ((np.arctan2(away[ring, 1], away[ring, 0]) / (2 * math.pi) + 0.5) * BORDER_PARTS).astype(np.intp)
    border = len(np.unique(part % BORDER_PARTS)) / BORDER_PARTS

    offset = away * np.array(image_size)
    radius = np.linalg.norm(offset, axis=1) / (0.5 * math.hypot(*image_size))
    quarter = 2 * (away[:, 1] >= 0) + (away[:, 0] >= 0)
    reach = float(np.mean([radius[quarter == q].max(initial=0.0) for q in range(4)]))
    return Coverage(
        cells=tuple(map(tuple, cells.tolist())), fraction=float(cells.mean()), border=border, reach=reach
    )


def duplicates(adjusted: Adjusted, image_size: ImageSize) -> tuple[tuple[int, int], ...]:
    """Return (view, earlier view with the same pose) for every view except the first of each pose.

    Poses are compared by the projections of the same board points. So a burst from a tripod is recognised whatever the
    noise, and whichever corners were detected in each image.
    """
    rows = np.flatnonzero(adjusted.network.used)
    places = _corner_places(adjusted)[rows]
    nearest = max(1.0, SAME_PLACE * image_size[0])
    found: list[tuple[int, int]] = []
    kept: list[int] = []
    for at in range(len(rows)):
        gaps = np.sqrt(((places[kept] - places[at]) ** 2).sum(axis=-1).mean(axis=-1)) if kept else np.empty(0)
        same = np.flatnonzero(gaps < nearest)
        if len(same):
            found.append((int(rows[at]), int(rows[kept[same[0]]])))
        else:
            kept.append(at)
    return tuple(found)


def _corner_places(adjusted: Adjusted) -> FloatArray:
    """Return the projections of four board points in each pose, (V, 4, 2) px, whether they were detected or not."""
    network = adjusted.network
    all_points = network.points[network.seen]
    low, high = all_points.min(axis=0), all_points.max(axis=0)
    four = np.array([[x, y, (low[2] + high[2]) / 2] for x in (low[0], high[0]) for y in (low[1], high[1])])
    views = len(network.seen)
    board = replace(
        network,
        points=np.broadcast_to(four, (views, 4, 3)).copy(),
        pixels=np.zeros((views, 4, 2)),
        seen=np.ones((views, 4), dtype=np.bool_),
        warp_shape=np.zeros((views, 4, 2)),
    )
    linear = linearise(board, adjusted.state)
    if linear is None:
        return np.full((views, 4, 2), np.nan)
    return -linear.residuals.reshape(views, 4, 2)


def _tilt_spread(normals: FloatArray) -> float:
    cosines = np.clip(normals @ normals.T, -1.0, 1.0)[np.triu_indices(len(normals), 1)]
    return float(np.degrees(np.percentile(np.arccos(cosines), ALMOST_ALL_PAIRS))) if len(cosines) else 0.0


def _roll_spread(rows: FloatArray) -> float:
    angle = np.arctan2(rows[:, 1], rows[:, 0])
    gaps = np.abs(angle[:, None] - angle) % math.pi
    return float(np.degrees(np.minimum(gaps, math.pi - gaps).max(initial=0.0)))


def proven(
    uncertainty: Uncertainty,
    corners: FloatArray,
    image_size: ImageSize,
    *,
    limit_px: float,
    circle: ImageCircle | None = None,
) -> Proven | None:
    """Return where corners prove a calibration; None if no σ is known.

    Args:
        uncertainty: standard deviation over the image, with the variance factor.
        corners: (N, 2) px, the observations that were used.
        image_size: (width, height) px.
        limit_px: largest standard deviation of a projection that is of use.
        circle: circle outside which the image shows nothing.
    """
    pixels, std = uncertainty.pixels.reshape(-1, 2), uncertainty.std_px.ravel()
    shown = inside_circle(pixels, circle)
    known = shown & np.isfinite(std)
    if not known.any():
        return None
    where = known & near_corners(pixels, corners, image_size)
    where &= np.nan_to_num(std, nan=np.inf) <= limit_px
    middle = np.array((circle.x, circle.y) if circle is not None else image_size) / (1 if circle else 2)
    away = np.linalg.norm(pixels - middle, axis=1)[shown]
    order = np.argsort(away)
    gaps = np.cumsum(~where[shown][order]) > MOST_GAPS[0] + MOST_GAPS[1] * np.arange(1, len(order) + 1)
    radius = float(away[order][np.argmax(gaps)]) if gaps.any() else float(away.max())
    return Proven(
        radius_px=radius,
        share=float(where.sum() / shown.sum()),
        sigma_px=float(std[where].max()) if where.any() else None,
        edge_px=float(std[known].max()),
        circle_px=circle.radius if circle is not None else None,
    )


def inside_circle(pixels: FloatArray, circle: ImageCircle | None) -> BoolArray:
    """Return which pixels, (N, 2), show an image."""
    if circle is None:
        return np.ones(len(pixels), dtype=np.bool_)
    return np.asarray(np.hypot(pixels[:, 0] - circle.x, pixels[:, 1] - circle.y) <= circle.radius)


def near_corners(pixels: FloatArray, corners: FloatArray, image_size: ImageSize) -> BoolArray:
    """Return which pixels, (N, 2), have a corner, (M, 2), near enough to prove them."""
    reach = NEAR * max(image_size)
    size = reach / BINS
    if not len(pixels):
        return np.zeros(0, dtype=np.bool_)
    # Which cells have a corner, in a frame that is wide enough for the surroundings of all pixels.
    own = np.floor(pixels / size).astype(np.intp)
    first = own.min(axis=0) - BINS - 1
    shape = own.max(axis=0) + BINS + 2 - first
    cells = np.floor(corners / size) - first
    cells = cells[((cells >= 0) & (cells < shape)).all(axis=1)].astype(np.intp)
    taken = np.zeros(shape, dtype=np.bool_)
    taken[cells[:, 0], cells[:, 1]] = True
    around = np.arange(-BINS - 1, BINS + 2)
    column, row = (own[:, axis, None] + around for axis in (0, 1))
    apart = [(pixels[:, axis, None] / size - (at + 0.5)) ** 2 for axis, at in enumerate((column, row))]
    within = apart[0][:, :, None] + apart[1][:, None, :] <= BINS**2
    return np.asarray(
        (taken[column[:, :, None] - first[0], row[:, None, :] - first[1]] & within).any(axis=(1, 2))
    )
