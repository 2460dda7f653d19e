"""Geometry of a grid of detected corners, without a camera model.

A lattice is an array (rows, columns, 2) of px with OpenCV's pixel origin (the centre of the top-left pixel). Cells are
the quadrilaterals between four neighbouring corners. On a checkerboard the square above and to the left of the first
corner is dark; so are the cell between the corners (0, 0) and (1, 1), and every second one.
"""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.frames import Gray

Lattice: TypeAlias = NDArray[np.float64]

SAMPLED: Final = np.linspace(0.25, 0.75, 5)
"""Positions where the level of a cell is sampled, as shares of its sides, away from the blurred edges."""

PLAIN = 0.35
"""Largest spread inside a square, relative to its contrast with the squares around it."""

LINES_EXTRAPOLATED_FROM = 3
BEYOND_CORNERS: Final = ((-0.45, 0.0), (-0.25, 0.0))
BEYOND_SQUARES: Final = (-1.45, -1.0)
"""Rows in which squares beyond the board are searched; the outermost squares are often cut narrower, to a third."""
HALF = 0.5
"""Relative to the board's own contrast."""
LEAST_STEP: Final = 0.25
"""Smallest assumed step between two squares, relative to that contrast, where glare reduces it."""

CUBIC_FROM, QUARTIC_FROM = 30, 45
"""Numbers of corners from which on the distortion is smoothed by polynomials of third and fourth order."""
SPARE_LINES, HIGHEST_ORDER = 3, 5
"""A strong bend needs a polynomial in each direction; its order depends on the number of spare lines of points."""


def smallest_spacing(lattice: Lattice) -> float:
    """Return the smallest distance between two neighbouring corners, px."""
    along, down = np.diff(lattice, axis=1), np.diff(lattice, axis=0)
    return float(min(np.nanmin(np.hypot(*along.T)), np.nanmin(np.hypot(*down.T))))


def _cell_areas(lattice: Lattice) -> FloatArray:
    """Return twice the signed areas of the triangles at the corners of each cell, (4, rows - 1, columns - 1)."""
    a, b = lattice[:-1, :-1], lattice[:-1, 1:]
    d, c = lattice[1:, :-1], lattice[1:, 1:]
    return np.stack([_cross(b - a, d - a), _cross(c - b, a - b), _cross(d - c, b - c), _cross(a - d, c - d)])


def _cross(p: FloatArray, q: FloatArray) -> FloatArray:
    return np.asarray(p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0])


def is_even(lattice: Lattice) -> bool:
    """Return whether all cells are convex and have the same orientation: none is folded, flipped or crossed."""
    areas = _cell_areas(lattice)
    return bool((areas > 0).all() or (areas < 0).all())


def mirrored(lattice: Lattice) -> bool:
    """Return whether the lattice is mirrored, as if the board were seen from behind."""
    return bool(np.nansum(_cell_areas(lattice)) < 0)


def cell_levels(gray: Gray, lattice: Lattice) -> FloatArray:
    """Return the mean gray level of each cell, (rows - 1, columns - 1); NaN if a cell is partly outside the image."""
    return np.asarray(_cell_samples(gray, lattice).mean(axis=2))


def _cell_samples(gray: Gray, lattice: Lattice) -> FloatArray:
    """Return gray levels inside each cell, (rows - 1, columns - 1, samples); NaN if it is partly outside the image."""
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
    """Return −1 for the dark cells and +1 for the light ones, if the first cell is dark."""
    rows, columns = np.indices(shape)
    return np.where((rows + columns) % 2 == 0, -1.0, 1.0)


def contrast(gray: Gray, lattice: Lattice) -> float:
    """Return the difference in gray levels between light and dark cells; negative if the first cell is light."""
    levels = cell_levels(gray, lattice)
    known, light = ~np.isnan(levels), _signs(levels.shape) > 0
    if not (known & light).any() or not (known & ~light).any():
        return 0.0
    return float(np.median(levels[known & light]) - np.median(levels[known & ~light]))


def squares_share(gray: Gray, lattice: Lattice) -> float:
    """Return the share of cells that look like squares: uniform, and darker or lighter than all neighbours.

    Detectors also find lattices that skip every second line, or lie partly on a tiled floor.
    """
    samples = _cell_samples(gray, lattice)
    levels, spread = samples.mean(axis=2), samples.std(axis=2)
    relief = levels * _signs(levels.shape) * np.sign(contrast(gray, lattice))
    framed = np.pad(relief, 1, constant_values=np.nan)
    around = np.stack([framed[2:, 1:-1], framed[:-2, 1:-1], framed[1:-1, 2:], framed[1:-1, :-2]])
    known = ~np.isnan(around)
    # The sign of a neighbour's contrast is opposite, so the sum is the difference between light and dark.
    step = relief + np.where(known, around, 0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    seen = ~np.isnan(relief) & known.any(axis=0)
    if not seen.any():
        return 0.0
    return float(np.mean((spread < PLAIN * step)[seen]))


def upright(lattice: Lattice, gray: Gray | None) -> Lattice:
    """Return the same corners, starting at the first corner of the board.

    Rows and columns run as on the board seen from its front, and the first square is dark. If this leaves several
    possibilities (columns + rows even: the board looks the same from two or four sides), the rows run as far to the
    right in the image as possible.

    Args:
        lattice: corners in any order that a detector may return.
        gray: the image; None if the board has no squares that distinguish its ends.
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
    """Return the direction ("columns" or "rows") in which squares continue beyond the corners; None if they do not.

    A detector that searches for 8×5 corners also finds them on a board of 9×6, at changing positions. Beyond the last
    corners of a complete board there is one more ring of squares and then paper. If the next ring still alternates
    like the board itself, the corners are a part of a larger board.
    """
    for name, side in _sides(lattice):
        if _relief_beyond(gray, side, BEYOND_SQUARES) > HALF:
            return name
    return None


def overhangs(gray: Gray, lattice: Lattice) -> str | None:
    """Return the direction ("columns" or "rows") in which corners lie beyond the board's end; None if none do.

    A detector that searches for 10×6 corners may invent the missing column at the edge of a board of 9×6. Inner
    corners have squares on every side, so the area just beyond the outermost ones must still alternate.
    """
    for name, side in _sides(lattice):
        if min(_relief_beyond(gray, side, rows) for rows in BEYOND_CORNERS) > -HALF:
            return name
    return None


def ends_on_paper(gray: Gray, lattice: Lattice) -> bool:
    """Return whether there is paper, without squares, beyond the square before the first row of corners.

    The result is also False if that area is outside the image.
    """
    relief = _relief_beyond(gray, lattice, BEYOND_SQUARES)
    if not relief < HALF:
        return False
    own, beyond_it = cell_levels(gray, lattice), cell_levels(gray, beyond(lattice, BEYOND_SQUARES))
    return bool(np.nanmedian(beyond_it) > (np.nanmin(own) + np.nanmax(own)) / 2)


def _sides(lattice: Lattice) -> tuple[tuple[str, Lattice], ...]:
    """Return the lattice with each of its sides at the top, and the direction in which squares continue there."""
    turned = lattice.transpose(1, 0, 2)
    return ("rows", lattice), ("rows", lattice[::-1]), ("columns", turned), ("columns", turned[::-1])


def _relief_beyond(gray: Gray, lattice: Lattice, rows: tuple[float, float]) -> float:
    """Return the alternation of a strip before the first row of corners: 1 like the first cells, −1 opposite.

    NaN if more than half of the strip is outside the image.
    """
    outer = beyond(lattice, rows)
    levels, inner = cell_levels(gray, outer)[0], cell_levels(gray, lattice[:2])[0]
    signs, span = _signs((1, len(levels)))[0], contrast(gray, lattice)
    # Differences of neighbouring cells: glare and vignetting vary slowly, and reduce both rows alike.
    out, known = (np.diff(row) * signs[1:] * np.sign(span) for row in (levels, inner))
    ratio = out / np.maximum(known, LEAST_STEP * abs(span))
    if 2 * np.isfinite(ratio).sum() < len(levels) or span == 0:
        return np.nan
    return float(np.nanmedian(ratio))


def beyond(lattice: Lattice, rows: tuple[float, ...]) -> Lattice:
    """Extrapolate rows of corners before the first one, at ``rows`` spacings from it.

    Each column is extrapolated from its first three corners: a wide lens bends it more than perspective does.
    """
    near = lattice[:LINES_EXTRAPOLATED_FROM]
    at = np.arange(len(near), dtype=np.float64)
    weights = np.empty((len(rows), len(at)))
    for row, t in enumerate(rows):
        for column, own in enumerate(at):
            others = at[at != own]
            weights[row, column] = np.prod((t - others) / (own - others))
    return np.asarray(np.einsum("tn,ncx->tcx", weights, near))


def homography(places: FloatArray, seen: FloatArray, *, robustly: bool = False) -> FloatArray | None:
    """Fit a homography, (3, 3), by least squares in the image; return None if the points do not determine one.

    Args:
        places: (N, 2) on the plane.
        seen: (N, 2) px.
        robustly: whether up to half of the points may be wrong.
    """
    import cv2

    # OpenCV's type stubs do not state that the result may be None.
    H: object = cv2.findHomography(places, seen, cv2.LMEDS if robustly else 0)[0]
    return None if H is None else np.asarray(H, dtype=np.float64)


def mapped(H: FloatArray, places: FloatArray) -> FloatArray:
    """Map places by a homography, (N, 2) px; NaN beyond the horizon."""
    x, y, w = (np.column_stack([places, np.ones(len(places))]) @ H.T).T
    w = np.where(w > 0, w, np.nan)
    return np.column_stack([x / w, y / w])


def smoothed(
    places: FloatArray, seen: FloatArray, trusted: BoolArray, *, strongly: bool = False
) -> FloatArray | None:
    """Return the expected image of each point of a plane, seen through a smoothly distorting lens.

    A homography models the perspective, a polynomial of the board coordinates the distortion; the difference from the
    measured points is noise, or an error.

    Args:
        places: (N, 2) on the board, any unit.
        seen: (N, 2) px.
        trusted: (N,) which points are used for the fit.
        strongly: whether the distortion is so strong that it needs a more flexible surface, which hides more errors.

    Returns:
        (N, 2) px; None if no plane explains the points.
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
