"""Focal length from single pairs of images: without reconstruction or start value, with a known principal point.

For two images of one camera with known principal point and square pixels, the fundamental matrix has seven degrees of
freedom and the relative pose five. The focal length follows from the other two (Sturm's quadratic).

It is undetermined if the optical axes intersect or are parallel, as for two vertical images or two images of the same
spot, and if a plane explains all matches. Close to these cases it is poorly determined, and thresholds on angles do not
describe this well. Each pair's standard deviation is therefore measured on its own matches (a jackknife over groups),
and pairs with a large one are ignored.

Sources: P. Sturm, "On focal length calibration from two views", CVPR 2001, equations 5-7; K. Kanatani and
C. Matsunaga, "Closed-form expression for focal lengths from the fundamental matrix", ACCV 2000 (the degenerate cases);
R. Hartley, "In defense of the eight-point algorithm", 1997 (the normalisation).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.start import homographies
from calibrary.calibration import Calibration
from calibrary.records import replace
from calibrary.sfm.engine import Matches

GROUPS: Final = 10
"""Number of groups of a pair's matches; each is left out once."""

LEAST_MATCHES: Final = 60
"""Smallest number of matches of a pair: each tenth of them is left out once."""
WIDEST_STD: Final = 0.15
"""Largest relative standard deviation of f of a pair; pairs above it are ignored."""

LEAST_PAIRS: Final = 8
ROUNDS: Final = 5
FLAT: Final = 6.0
"""Ratio of the distances by a homography and by F below which a plane explains a pair; noise alone gives about 3."""

MAD_TO_STD: Final = 1.4826


class TwoViewFocal(Struct, frozen=True, kw_only=True):
    """Focal length by the pairs of a flight.

    Attributes:
        focal_px: weighted median over the pairs, px.
        std: its relative standard deviation, from the spread over the pairs; only as many pairs as images count as
            independent.
        pairs: number of pairs used.
    """

    focal_px: float
    std: float
    pairs: int


def focal_of_pairs(pairs: Iterable[Matches], camera: Calibration) -> TwoViewFocal | None:
    """Estimate the focal length from all pairs; None if too few of them determine it.

    Args:
        pairs: verified matches.
        camera: provides the principal point and, if known, the distortion; its focal length does not affect the result.
    """
    centre = np.array([camera.intrinsics.cx, camera.intrinsics.cy])
    scale = float(max(camera.intrinsics.image_size)) / 2
    found, images = [], set[int]()
    for pair in pairs:
        if pair.by_homography or len(pair.pixels_first) < LEAST_MATCHES:
            continue
        one = (undistorted(pair.pixels_first, camera) - centre) / scale
        other = (undistorted(pair.pixels_second, camera) - centre) / scale
        focal, std = _with_std(one, other)
        if std <= WIDEST_STD:
            found.append((math.log(focal * scale), std))
            images |= {pair.first, pair.second}
    if len(found) < LEAST_PAIRS:
        return None
    logs, stds = np.array(found).T
    # A median, because single pairs may be far off.
    weights = 1 / np.maximum(stds, 0.005) ** 2
    middle = _weighted_median(logs, weights)
    spread = MAD_TO_STD * _weighted_median(np.abs(logs - middle), weights)
    independent = min(len(found), len(images))
    # The median of n normal numbers is √(π/2) times as uncertain as their mean.
    std = math.sqrt(math.pi / 2 / independent) * max(spread, float(np.median(stds)))
    return TwoViewFocal(focal_px=math.exp(middle), std=std, pairs=len(found))


def undistorted(pixels: FloatArray, camera: Calibration) -> FloatArray:
    """Return (N, 2) undistorted px of the same K; unchanged if the distortion is unknown."""
    if camera.distortion is None:
        return pixels
    return replace(camera, distortion=None).project(camera.unproject(pixels))


def _with_std(one: FloatArray, other: FloatArray) -> tuple[float, float]:
    """Return the focal length of a pair in the unit of the points, and its relative std; (NaN, inf) if undetermined."""
    seen = np.isfinite(one).all(axis=1) & np.isfinite(other).all(axis=1)
    one, other = one[seen], other[seen]
    if len(one) < LEAST_MATCHES:
        return math.nan, math.inf
    F, kept = fundamental(one, other)
    focal = focal_of_fundamental(F)
    if focal is None or int(kept.sum()) < LEAST_MATCHES:
        return math.nan, math.inf
    one, other = one[kept], other[kept]
    if _is_flat(one, other, F):
        return math.nan, math.inf
    group = np.random.default_rng(0).permutation(len(one)) % GROUPS
    logs = []
    for left_out in range(GROUPS):
        rows = group != left_out
        part = focal_of_fundamental(fundamental(one[rows], other[rows], rounds=1)[0])
        if part is None:
            return math.nan, math.inf
        logs.append(math.log(part))
    # Delete-group jackknife.
    variance = (GROUPS - 1) / GROUPS * float(np.sum((np.array(logs) - np.mean(logs)) ** 2))
    return focal, math.sqrt(variance)


def _is_flat(one: FloatArray, other: FloatArray, F: FloatArray) -> bool:
    """Return whether a homography explains the matches nearly as well as F; then F is determined by noise only."""
    a, b = np.column_stack([one, np.ones(len(one))]), np.column_stack([other, np.ones(len(other))])
    moved = a @ homographies(one[None], other[None], np.ones((1, len(one)), dtype=np.bool_))[0].T
    off_plane = np.linalg.norm(moved[:, :2] / moved[:, 2:] - other, axis=1)
    off_line = _off_lines(a, b, F)[0]
    return bool(np.median(off_plane) < FLAT * np.median(off_line))


def _off_lines(a: FloatArray, b: FloatArray, F: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Sampson's distances of the matches from their epipolar lines, and the weights of the algebraic errors."""
    gradient = np.hypot(*(a @ F.T)[:, :2].T) ** 2 + np.hypot(*(b @ F)[:, :2].T) ** 2
    weights = 1 / np.sqrt(np.maximum(gradient, 1e-300))
    return np.abs(np.einsum("ni,ij,nj->n", b, F, a)) * weights, weights


def fundamental(one: FloatArray, other: FloatArray, *, rounds: int = ROUNDS) -> tuple[FloatArray, BoolArray]:
    """Estimate F with other'ᵀ F one' = 0 by least squares on Sampson's distances; returns F and the (N,) inliers.

    Args:
        one: (N, 2) points, in a unit of about their extent.
        other: (N, 2) the same points in the other image; most of them correct.
        rounds: number of reweightings.
    """
    a, b = np.column_stack([one, np.ones(len(one))]), np.column_stack([other, np.ones(len(other))])
    to_a, to_b = _normaliser(one), _normaliser(other)
    A, B = a @ to_a.T, b @ to_b.T
    rows = np.einsum("ni,nj->nij", B, A).reshape(-1, 9)
    weights, kept = np.ones(len(one)), np.ones(len(one), dtype=np.bool_)
    F = np.eye(3)
    for _ in range(rounds + 1):
        _, _, Vt = np.linalg.svd((rows * (weights * kept)[:, None]).T @ (rows * (weights * kept)[:, None]))
        U, S, Wt = np.linalg.svd(Vt[-1].reshape(3, 3))
        # The nearest matrix of rank 2, because only that is a fundamental matrix.
        F = to_b.T @ (U * (S[0], S[1], 0.0)) @ Wt @ to_a
        off, weights = _off_lines(a, b, F)
        kept = np.asarray(off <= max(3 * MAD_TO_STD * float(np.median(off)), 1e-9))
        weights /= weights.mean()
    return F, kept


def focal_of_fundamental(F: FloatArray) -> float | None:
    """Return the focal length in the unit of F's points; None if F fits no camera with square pixels.

    Args:
        F: (3, 3) fundamental matrix of points relative to the principal point.
    """
    U, (a, b, _), Vt = np.linalg.svd(F)
    u1, u2, v1, v2 = U[2, 0], U[2, 1], Vt[0, 2], Vt[1, 2]
    quadratic = (
        a**2 * (1 - u1**2) * (1 - v1**2) - b**2 * (1 - u2**2) * (1 - v2**2),
        a**2 * (u1**2 + v1**2 - 2 * u1**2 * v1**2) - b**2 * (u2**2 + v2**2 - 2 * u2**2 * v2**2),
        a**2 * u1**2 * v1**2 - b**2 * u2**2 * v2**2,
    )
    roots = np.roots(quadratic)
    focals = [math.sqrt(x.real) for x in roots if abs(x.imag) <= 1e-9 * abs(x) and x.real > 0]
    if not focals:
        return None

    def mismatch(focal: float) -> float:
        """Difference of the essential matrix's singular values, which must be equal, plus Sturm's linear residual."""
        G = np.diag([focal, focal, 1.0])
        singular = np.linalg.svd(G @ F @ G, compute_uv=False)
        linear = focal**2 * (a * u1 * u2 * (1 - v1**2) + b * v1 * v2 * (1 - u2**2)) + u2 * v1 * (
            a * u1 * v1 + b * u2 * v2
        )
        return float(abs(singular[0] - singular[1]) / singular[0] + abs(linear))

    return min(focals, key=mismatch)


def _normaliser(points: FloatArray) -> FloatArray:
    """Return the transform to the origin and a mean distance of √2, for the conditioning of the equations.

    Source: R. I. Hartley, "In defence of the 8-point algorithm", 1995.
    """
    middle = points.mean(axis=0)
    size = math.sqrt(2) / max(float(np.linalg.norm(points - middle, axis=1).mean()), 1e-12)
    return np.array([[size, 0, -size * middle[0]], [0, size, -size * middle[1]], [0, 0, 1]])


def _weighted_median(values: FloatArray, weights: FloatArray) -> float:
    order = np.argsort(values)
    shares = np.cumsum(weights[order]) / weights.sum()
    return float(values[order][np.searchsorted(shares, 0.5)])
