"""Variance factor: check of the stated standard deviations by the agreement of two halves of the views.

A covariance from residuals represents noise that is independent between corners. Effects that move all corners of a
view together, such as a bowed board or a rolling shutter, make the estimates scatter 2 to 20 times more. So the views
are split into two random halves, each is solved alone, and with d the difference of the two and C its stated
covariance, κ² = dᵀ C⁻¹ d / n is about 1 if noise is the only error. Measured with 25 views: 0.6–1.2 for a flat board,
over 10 for a board bent by 0.2 mm in 400 mm that is taken to be flat.

The result depends on the split: with OpenCV's own 13 images, single splits give 1 to 13, and the median of seven 3 to
9. So many splits are made, each by one Gauss–Newton step from the solution of all views, which nearly reaches the
solution of the half; this needs the normal equations of each view only once.

Splitting the data is mrcal's "cross-validation"; the factor on the variance is a Birge ratio (R. T. Birge, "The
calculation of errors by the method of least squares", 1932).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted
from calibrary.calib.network import LensT
from calibrary.errors import CalibrationError

Half: TypeAlias = tuple[FloatArray, FloatArray]
"""(g,) difference of a half's solution from the full one, and its (g, g) covariance."""

SPLITS: Final = 101
"""Over a hundred, so that the verdict does not depend on the seed; an odd number has a median split."""
FEWEST_VIEWS: Final = 6
"""In total: fewer than three views per half hardly determine a camera."""


class SplitHalf(Struct, frozen=True, kw_only=True, eq=False):
    """Comparison of halves of the views.

    Attributes:
        kappa2: variance factor, the median over the splits of χ² / n.
        by_split: value of each split.
        halves: (2, n) compared parameters of the two halves in the median split.
    """

    kappa2: float
    by_split: tuple[float, ...]
    halves: FloatArray


def split_half(
    adjusted: Adjusted[LensT], *, of: slice | None = None, splits: int = SPLITS, seed: int = 0
) -> SplitHalf | None:
    """Compare halves of the views in several random splits.

    Args:
        adjusted: solution from all views; the halves use its model, and its warp if free.
        of: parameters to compare; None for all except the warp.
        splits: number of splits; an odd number has a median split.
        seed: random seed of the splits.

    Returns:
        The comparison; None if there are fewer than six views, or too few halves can be solved.
    """
    network = adjusted.network
    rows = np.flatnonzero(network.used)
    if len(rows) < FEWEST_VIEWS:
        return None
    random, size = np.random.default_rng(seed), len(adjusted.free)
    of = of or slice(len(adjusted.state.parameters))
    # (2 · splits, V): the halves of the first split, of the second, …
    chosen = np.zeros((2 * splits, len(network.seen)))
    for split in range(splits):
        dealt = rows[random.permutation(len(rows))]
        chosen[2 * split, dealt[::2]] = chosen[2 * split + 1, dealt[1::2]] = 1.0
    views = adjusted.reduced
    # At its best pose each view has a sum of squares of its own.
    rss = (adjusted.linear.residuals**2).sum(axis=1) - views.from_gone
    steps, covariances = _solved(
        np.tensordot(chosen, views.by_member, axes=1),
        chosen @ views.right_by_member,
        chosen @ rss,
        chosen @ (2.0 * network.seen.sum(axis=1) - 6.0) - size,
    )
    halves = [*zip(steps[:, of], covariances[:, of, of], strict=True)]
    pairs = [*zip(halves[::2], halves[1::2], strict=True)]
    return compared(pairs, adjusted.state.parameters[of], splits)


def compared(pairs: Sequence[tuple[Half, Half]], parameters: FloatArray, splits: int) -> SplitHalf | None:
    """Compare pairs of halves.

    Args:
        pairs: splits with both halves solved.
        parameters: (g,) solution from all views.
        splits: number of splits made.

    Returns:
        The comparison; None if half of the splits or more could not be solved.
    """
    if not pairs:
        return None
    a, C_a, b, C_b = (np.stack([pair[half][part] for pair in pairs]) for half in (0, 1) for part in (0, 1))
    apart = (a - b)[:, :, None]
    with np.errstate(invalid="ignore"):
        ratios = (apart.transpose(0, 2, 1) @ _inverses(C_a + C_b) @ apart)[:, 0, 0] / a.shape[1]
    sure = np.isfinite(ratios)
    if 2 * int(sure.sum()) <= splits:
        return None
    ratios, a, b = ratios[sure], a[sure], b[sure]
    kappa2 = float(np.median(ratios))
    middle = int(np.argmin(np.abs(ratios - kappa2)))
    return SplitHalf(
        kappa2=kappa2, by_split=tuple(ratios.tolist()), halves=parameters + np.stack([a[middle], b[middle]])
    )


def solved_half(matrix: FloatArray, right: FloatArray, rss: float, dof: int) -> Half:
    """Solve the normal equations of a half, reduced to the lens parameters.

    Args:
        matrix: (g, g).
        right: (g,) right-hand side.
        rss: sum of squares before the step, px².
        dof: degrees of freedom of the half.

    Raises:
        CalibrationError: the equations do not determine every parameter.
    """
    steps, covariances = _solved(matrix[None], right[None], np.array([rss]), np.array([float(dof)]))
    if not np.isfinite(steps).all():
        raise CalibrationError("half of the views do not determine all parameters")
    return steps[0], covariances[0]


def _solved(matrices: FloatArray, rights: FloatArray, rss: FloatArray, dof: FloatArray) -> Half:
    """Solve many halves, (H, …), at once; NaN where the equations do not determine every parameter."""
    inverses = _inverses(matrices)
    with np.errstate(invalid="ignore"):
        steps = (inverses @ rights[..., None])[..., 0]
        left = rss - (rights * steps).sum(axis=1)
        sure = (np.diagonal(inverses, axis1=1, axis2=2) > 0).all(axis=1) & (dof > 0) & (left > 0)
        variance = np.where(sure, left, np.nan) / np.maximum(dof, 1.0)
        covariances = variance[:, None, None] * (inverses + inverses.transpose(0, 2, 1)) / 2
    return np.where(sure[:, None], steps, np.nan), covariances


def _inverses(matrices: FloatArray) -> FloatArray:
    """Invert symmetric matrices, (H, n, n), of parameters of different scale; NaN for those that are singular."""
    scale = np.sqrt(np.maximum(np.diagonal(matrices, axis1=1, axis2=2), 0.0))
    sure = np.asarray((scale > 0).all(axis=1), dtype=np.bool_)
    scale = np.where(sure[:, None], scale, 1.0)
    by = scale[:, :, None] * scale[:, None, :]
    unit = np.where(sure[:, None, None], matrices / by, np.eye(matrices.shape[-1]))
    try:
        inverses = np.linalg.inv(unit)
    except np.linalg.LinAlgError:
        if len(unit) == 1:
            return np.full_like(unit, np.nan)
        return np.concatenate([_inverses(one[None]) for one in matrices])
    return np.where(sure[:, None, None], inverses / by, np.nan)
