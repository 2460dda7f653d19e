"""Grids of dark discs.

The image of a disc is an ellipse with a centre that is not the image of the disc's centre: the nearer half looks
larger. The offset is computed from the perspective of the grid and subtracted; distortion within a disc is ignored.
"""

from __future__ import annotations

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board, Pattern
from calibrary.calib.detectors.refinement import enlarged, reduced
from calibrary.calib.detectors.reliability import reliable
from calibrary.calib.found import Found, NotFound, Reason, Remark
from calibrary.calib.frames import Gray
from calibrary.calib.lattice import Lattice, beyond, homography, is_even, mapped, smallest_spacing, upright
from calibrary.records import replace

WINDOW_SHARE = 0.48
"""Half-width of the window around a disc, in spacings: almost up to the middle between two discs."""
RIM_POINTS = 64
NAMED_BIAS_PX = 0.02


def find_circles(gray: Gray, board: Board) -> Found | NotFound:
    """Find the centres of all discs of a grid.

    Args:
        gray: (H, W).
        board: a grid of discs in rows and columns, or with every second row staggered.

    Returns:
        Points in px with OpenCV's pixel origin.
    """
    import cv2

    missing = NotFound(reason=Reason.NO_BOARD, text=f"no grid of {board.columns}×{board.rows} discs")
    small, scale = reduced(gray)
    staggered = board.pattern is Pattern.ASYMMETRIC_CIRCLES
    grid = cv2.CALIB_CB_ASYMMETRIC_GRID if staggered else cv2.CALIB_CB_SYMMETRIC_GRID
    # Clustering finds grids under stronger perspective, but clutter around the board misleads it (OpenCV's reference).
    for flags in (grid, grid | cv2.CALIB_CB_CLUSTERING):
        found, centres = cv2.findCirclesGrid(small, (board.columns, board.rows), flags=flags)
        if found and centres is not None:
            break
    else:
        return missing
    rough = enlarged(np.reshape(centres, (board.rows, board.columns, 2)).astype(np.float64), scale)
    if not is_even(rough):
        return NotFound(reason=Reason.UNEVEN, text="what looks like the grid is folded or torn")
    spacing = smallest_spacing(rough)
    lattice = _centroids(gray, rough, WINDOW_SHARE * spacing)
    if not staggered:
        # A staggered grid has a unique first disc, which OpenCV has found.
        lattice = upright(lattice, None)
    if not np.isfinite(lattice).all() or not is_even(lattice):
        return missing
    if not staggered and (direction := _goes_on(gray, lattice)):
        text = f"the grid has more {direction} than {board.columns}×{board.rows} discs; count them again"
        return NotFound(reason=Reason.LARGER_BOARD, text=text)
    bias = _perspective_bias(board, lattice)
    points = lattice.reshape(-1, 2) - bias
    radius = board.marker / 2 / board.pitch * smallest_spacing(lattice)
    ids = np.arange(len(points))
    found_points = reliable(
        gray, board, ids, points, half=int(np.ceil(radius)), spacing_px=smallest_spacing(lattice)
    )
    largest = float(np.hypot(*bias.T).max())
    if isinstance(found_points, NotFound) or largest < NAMED_BIAS_PX:
        return found_points
    text = f"tilted discs look up to {largest:.2f} px off centre; reckoned out, but a checkerboard has no such bias"
    remark = Remark(reason=Reason.PERSPECTIVE_BIAS, text=text)
    return replace(found_points, remarks=(*found_points.remarks, remark))


def _centroids(gray: Gray, rough: Lattice, reach: float) -> Lattice:
    """Return the darkness-weighted centre of each disc; NaN for a lost one.

    The measurement is repeated around each result, so that the window is centred on the disc.
    """
    height, width = gray.shape
    centres = rough.reshape(-1, 2).copy()
    rows, columns = rough.shape[:2]
    for _ in range(3):
        for index, (x, y) in enumerate(centres):
            if not (np.isfinite(x) and np.isfinite(y)):
                continue
            left, top = max(0, round(x - reach)), max(0, round(y - reach))
            patch = gray[top : min(height, round(y + reach) + 1), left : min(width, round(x + reach) + 1)]
            u, v = _centroid(patch)
            centres[index] = left + u, top + v
    return centres.reshape(rows, columns, 2)


def _centroid(patch: Gray) -> FloatArray:
    """Return (x, y) of the dark disc within a patch of paper."""
    if min(patch.shape) < 3:
        return np.full(2, np.nan)
    dark, light = np.percentile(patch, (5, 90))
    if light - dark < 8:
        return np.full(2, np.nan)
    y, x = np.indices(patch.shape, dtype=np.float64)
    # Noise on paper and print has no weight; the blurred rim is weighted by its darkness.
    weight = np.clip((light - patch) / (light - dark) * 1.4 - 0.2, 0.0, 1.0)
    total = weight.sum()
    return np.asarray(np.array([(weight * x).sum(), (weight * y).sum()]) / total)


def _perspective_bias(board: Board, lattice: Lattice) -> FloatArray:
    """Return the offset of each disc's image centroid from the image of its centre, (N, 2) px."""
    places = board.points[:, :2]
    H = homography(places, lattice.reshape(-1, 2))
    if H is None:
        return np.zeros_like(places)
    angle = np.linspace(0, 2 * np.pi, RIM_POINTS, endpoint=False)
    rim = np.column_stack([np.cos(angle), np.sin(angle)]) * board.marker / 2
    seen = mapped(H, (places[:, None] + rim).reshape(-1, 2)).reshape(len(places), -1, 2)
    return _area_centres(seen) - mapped(H, places)


def _area_centres(outlines: FloatArray) -> FloatArray:
    """Return the centroids, (N, 2), of the areas inside (N, M, 2) outlines, by the shoelace formula."""
    following = np.roll(outlines, -1, axis=1)
    cross = outlines[..., 0] * following[..., 1] - outlines[..., 1] * following[..., 0]
    return np.asarray(
        ((outlines + following) * cross[..., None]).sum(axis=1) / (3 * cross.sum(axis=1))[:, None]
    )


def _goes_on(gray: Gray, lattice: Lattice) -> str | None:
    """Return the direction in which more discs follow; None if there are none."""
    height, width = gray.shape

    def levels(at: FloatArray) -> FloatArray:
        x, y = np.rint(at.reshape(-1, 2)).astype(np.intp).T
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        return np.asarray(gray[y[inside], x[inside]], dtype=np.float64)

    between = (lattice[:-1, :-1] + lattice[1:, 1:]) / 2
    middle = (np.median(levels(lattice)) + np.median(levels(between))) / 2
    for name, view in (("rows", lattice), ("columns", lattice.transpose(1, 0, 2))):
        for side in (view, view[::-1]):
            outer = beyond(side, (-1.0, -1.5))
            discs, paper = levels(outer[0]), levels((outer[1][:-1] + outer[1][1:]) / 2)
            if (
                min(discs.size, paper.size) >= 2
                and (discs < middle).mean() > 0.8
                and (paper > middle).mean() > 0.8
            ):
                return name
    return None
