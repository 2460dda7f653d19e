"""Geometry of a grid of seen corners, before any camera is known.

A lattice is an array (rows, columns, 2) of px as OpenCV counts them, from the centre of the top-left pixel. Cells
are the quadrilaterals between four neighbouring corners. On a checkerboard the square up and to the left of
the first corner is dark; so is then the cell between the corners (0, 0) and (1, 1), and every second one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.frames import Gray

__all__ = [
    "Lattice",
    "beyond",
    "cell_levels",
    "contrast",
    "ends_on_paper",
    "goes_on",
    "homography",
    "is_even",
    "mapped",
    "mirrored",
    "overhangs",
    "smallest_spacing",
    "smoothed",
    "squares_share",
    "upright",
]

Lattice: TypeAlias = NDArray[np.float64]

SAMPLED: Final = np.linspace(0.25, 0.75, 5)
"""Where a cell's level is sampled, as shares of its sides: away from its blurred edges."""

PLAIN = 0.35
"""Largest spread inside a square, as a share of its step to the squares around it."""

LINES_EXTRAPOLATED_FROM = 3
BEYOND_CORNERS: Final = (-0.45, 0.0)
BEYOND_SQUARES: Final = (-1.45, -1.0)
"""Rows between which it is looked whether a board goes on: its outermost squares are often cut narrower."""
HALF = 0.5
"""Of the board's own contrast."""
LEAST_STEP: Final = 0.25
"""Of that contrast, that is taken for the step between two squares where glare leaves less."""

CUBIC_FROM, QUARTIC_FROM = 30, 45
"""Corners from which on a lens's bending of the lattice is smoothed by polynomials of that order."""
SPARE_LINES, HIGHEST_ORDER = 3, 5
"""A strong bend takes a polynomial in each direction, of as many orders as there are lines of points to spare."""


def smallest_spacing(lattice: Lattice) -> float:
    """Px between the two neighbouring corners that are closest."""
    along, down = np.diff(lattice, axis=1), np.diff(lattice, axis=0)
    return float(min(np.nanmin(np.hypot(*along.T)), np.nanmin(np.hypot(*down.T))))


def _cell_areas(lattice: Lattice) -> FloatArray:
    """Twice the signed areas of the triangles at each cell's four corners, (4, rows - 1, columns - 1)."""
    a, b = lattice[:-1, :-1], lattice[:-1, 1:]
    d, c = lattice[1:, :-1], lattice[1:, 1:]
    return np.stack([_cross(b - a, d - a), _cross(c - b, a - b), _cross(d - c, b - c), _cross(a - d, c - d)])


def _cross(p: FloatArray, q: FloatArray) -> FloatArray:
    return np.asarray(p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0])


def is_even(lattice: Lattice) -> bool:
    """Whether no cell is folded, turned over or crossed by its neighbours: all are convex and alike in sense."""
    areas = _cell_areas(lattice)
    return bool((areas > 0).all() or (areas < 0).all())


def mirrored(lattice: Lattice) -> bool:
    """Whether rows run against the sense of image rows, as seen from behind the board."""
    return bool(np.nansum(_cell_areas(lattice)) < 0)


def cell_levels(gray: Gray, lattice: Lattice) -> FloatArray:
    """(rows - 1, columns - 1) mean gray level inside each cell; NaN where a cell leaves the image."""
    return np.asarray(_cell_samples(gray, lattice).mean(axis=2))


def _cell_samples(gray: Gray, lattice: Lattice) -> FloatArray:
    """(rows - 1, columns - 1, samples) gray levels inside each cell; NaN where a cell leaves the image."""
    s, t = np.meshgrid(SAMPLED, SAMPLED)
    s, t = s.ravel()[:, None], t.ravel()[:, None]
    a, b = lattice[:-1, :-1, None], lattice[:-1, 1:, None]
    d, c = lattice[1:, :-1, None], lattice[1:, 1:, None]
    at = (a * (1 - s) + b * s) * (1 - t) + (d * (1 - s) + c * s) * t
    height, width = gray.shape
    inside = np.all((at > -0.5) & (at < (width - 0.5, height - 0.5)), axis=(2, 3), keepdims=True)[..., 0, 0]
    x, y = np.rint(np.where(inside[..., None, None], at, 0.0)).astype(np.intp).transpose(3, 0, 1, 2)
    samples = gray[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
    return np.where(inside[..., None], samples, np.nan)


def _signs(shape: tuple[int, ...]) -> FloatArray:
    """-1 for the cells that are dark and +1 for those that are light where the first cell is dark."""
    rows, columns = np.indices(shape)
    return np.where((rows + columns) % 2 == 0, -1.0, 1.0)


def contrast(gray: Gray, lattice: Lattice) -> float:
    """Gray levels between the light and the dark cells; negative where the first cell is light."""
    levels = cell_levels(gray, lattice)
    known, light = ~np.isnan(levels), _signs(levels.shape) > 0
    if not (known & light).any() or not (known & ~light).any():
        return 0.0
    return float(np.median(levels[known & light]) - np.median(levels[known & ~light]))


def squares_share(gray: Gray, lattice: Lattice) -> float:
    """Share of the cells that look like squares of the board: of one level, darker or lighter than all around.

    Detectors also find lattices that skip every second line, or that lie half on a floor of tiles.
    """
    samples = _cell_samples(gray, lattice)
    levels, spread = samples.mean(axis=2), samples.std(axis=2)
    relief = levels * _signs(levels.shape) * np.sign(contrast(gray, lattice))
    framed = np.pad(relief, 1, constant_values=np.nan)
    around = np.stack([framed[2:, 1:-1], framed[:-2, 1:-1], framed[1:-1, 2:], framed[1:-1, :-2]])
    known = ~np.isnan(around)
    # A neighbour's relief is turned over, so the sum of the two is what the light one is lighter by.
    step = relief + np.where(known, around, 0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    seen = ~np.isnan(relief) & known.any(axis=0)
    if not seen.any():
        return 0.0
    return float(np.mean((spread < PLAIN * step)[seen]))


def upright(lattice: Lattice, gray: Gray | None) -> Lattice:
    """The same corners, begun at the one where the board begins.

    Rows and columns run as the board's do seen from its front, and the first square is dark. Where that leaves
    several beginnings (columns + rows even: the board looks alike from two or four sides) the one is taken whose
    rows run most to the right in the image.

    Args:
        lattice: corners in any order a detector gives them.
        gray: the image; None where the board has no squares to distinguish its ends.
    """
    if mirrored(lattice):
        lattice = lattice[:, ::-1]
    turns = [0, 1, 2, 3] if lattice.shape[0] == lattice.shape[1] else [0, 2]
    views = [np.rot90(lattice, turn) for turn in turns]
    dark_first = [view for view in views if gray is not None and contrast(gray, view) > 0]

    def rightwards(view: Lattice) -> float:
        run = (view[:, -1] - view[:, 0]).sum(axis=0)
        return float(run[0] / np.hypot(*run))

    return np.ascontiguousarray(max(dark_first or views, key=rightwards))


def goes_on(gray: Gray, lattice: Lattice) -> str | None:
    """In which direction squares continue beyond those the corners bound, if they do: "columns" or "rows".

    A detector asked for 8×5 corners finds them on a board of 9×6 as well, each time elsewhere. Beyond the last
    corners of a whole board lies one more ring of squares and then paper; where the next ring still
    alternates like the board itself, the corners are a part of a larger board.
    """
    return _first_side(lattice, lambda side: _relief_beyond(gray, side, BEYOND_SQUARES) > HALF)


def overhangs(gray: Gray, lattice: Lattice) -> str | None:
    """In which direction the corners reach over the board's end, if they do: "columns" or "rows".

    Asked for 10×6 corners, a detector may make up the missing column on the rim of a board of 9×6: inner
    corners have squares on every side, so what lies just beyond the outermost must alternate still.
    """
    return _first_side(lattice, lambda side: _relief_beyond(gray, side, BEYOND_CORNERS) > -HALF)


def ends_on_paper(gray: Gray, lattice: Lattice) -> bool:
    """Whether there is paper, and no more squares, beyond the square before the first row of corners.

    False as well where that lies outside the image.
    """
    relief = _relief_beyond(gray, lattice, BEYOND_SQUARES)
    if not relief < HALF:
        return False
    own, beyond_it = cell_levels(gray, lattice), cell_levels(gray, beyond(lattice, BEYOND_SQUARES))
    return bool(np.nanmedian(beyond_it) > (np.nanmin(own) + np.nanmax(own)) / 2)


def _first_side(lattice: Lattice, holds: Callable[[Lattice], bool]) -> str | None:
    """The first of the four sides, turned to the top, of which something holds: "rows" or "columns"."""
    for name, view in (("rows", lattice), ("columns", lattice.transpose(1, 0, 2))):
        if any(holds(side) for side in (view, view[::-1])):
            return name
    return None


def _relief_beyond(gray: Gray, lattice: Lattice, rows: tuple[float, float]) -> float:
    """How a strip before the first row of corners alternates: 1 as the first cells do, -1 the other way round.

    NaN where more than half of the strip lies outside the image.
    """
    outer = beyond(lattice, rows)
    levels, inner = cell_levels(gray, outer)[0], cell_levels(gray, lattice[:2])[0]
    signs, span = _signs((1, len(levels)))[0], contrast(gray, lattice)
    # From each cell to the next: glare and vignetting change slowly, and take as much from the row that is known.
    out, known = (np.diff(row) * signs[1:] * np.sign(span) for row in (levels, inner))
    ratio = out / np.maximum(known, LEAST_STEP * abs(span))
    if 2 * np.isfinite(ratio).sum() < len(levels) or span == 0:
        return np.nan
    return float(np.nanmedian(ratio))


def beyond(lattice: Lattice, rows: tuple[float, ...]) -> Lattice:
    """Rows of corners before the first, at ``rows`` spacings from it, were the board to go on.

    Each column goes on as it bends in its first three corners: a wide lens bends them more than any perspective does.
    """
    near = lattice[:LINES_EXTRAPOLATED_FROM]
    at = np.arange(len(near), dtype=np.float64)
    weights = np.array(
        [[np.prod((t - others) / (own - others)) for own in at for others in [at[at != own]]] for t in rows]
    )
    return np.asarray(np.einsum("tn,ncx->tcx", weights, near))


def homography(places: FloatArray, seen: FloatArray) -> FloatArray | None:
    """The plane's perspective, (3, 3), by least squares in the image; None where the points give none."""
    import cv2

    # OpenCV's own types do not say that it may find none.
    H: object = cv2.findHomography(places, seen)[0]
    return None if H is None else np.asarray(H, dtype=np.float64)


def mapped(H: FloatArray, places: FloatArray) -> FloatArray:
    """(N, 2) px of places under a homography; NaN beyond the horizon."""
    x, y, w = (np.column_stack([places, np.ones(len(places))]) @ H.T).T
    w = np.where(w > 0, w, np.nan)
    return np.column_stack([x / w, y / w])


def smoothed(
    places: FloatArray, seen: FloatArray, trusted: BoolArray, *, strongly: bool = False
) -> FloatArray | None:
    """Where a plane behind a smoothly bending lens would show each point.

    A homography takes up the perspective, a polynomial of the board's coordinates the bending; what differs from it is
    noise, or was measured elsewhere.

    Args:
        places: (N, 2) on the board, any unit.
        seen: (N, 2) px.
        trusted: (N,) which of them say where the plane is.
        strongly: whether the lens bends the plane so much that it takes a pliant surface, which hides more.

    Returns:
        (N, 2) px; None where no plane explains the points at all.
    """
    H = homography(places[trusted], seen[trusted])
    if H is None or np.isnan(flat := mapped(H, places)).any():
        return None
    low, high = places.min(axis=0), places.max(axis=0)
    u, v = (2 * (places - low) / (high - low) - 1).T
    count = int(trusted.sum())
    order = 2 + (count >= CUBIC_FROM) + (count >= QUARTIC_FROM)
    orders = [(i, j) for i in range(order + 1) for j in range(order + 1 - i)]
    if strongly:
        across, down = (
            int(np.clip(len(np.unique(np.round(places[trusted, axis], 6))) - SPARE_LINES, 1, HIGHEST_ORDER))
            for axis in (0, 1)
        )
        both = [(i, j) for i in range(across + 1) for j in range(down + 1)]
        orders = both if 2 * len(both) <= count else orders
    terms = np.column_stack([u**i * v**j for i, j in orders])
    bending = np.linalg.lstsq(terms[trusted], (seen - flat)[trusted], rcond=None)[0]
    return np.asarray(flat + terms @ bending)
