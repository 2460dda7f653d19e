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
from contextlib import suppress
from typing import Final, TypeAlias

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted, reduce
from calibrary.calib.network import LensT, Linear
from calibrary.errors import CalibrationError

__all__ = ["Half", "SplitHalf", "chi_square", "compared", "solved_half", "split_half"]


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
    rows = np.flatnonzero(adjusted.network.used)
    if len(rows) < FEWEST_VIEWS:
        return None
    views, random = [_view(adjusted, row) for row in rows.tolist()], np.random.default_rng(seed)
    size, of = len(adjusted.free), of or slice(len(adjusted.state.parameters))
    found: list[tuple[Half, Half]] = []
    for _ in range(splits):
        dealt = random.permutation(len(rows))
        with suppress(CalibrationError):
            a, b = (_half([views[at] for at in dealt[first::2]], size) for first in (0, 1))
            found.append(((a[0][of], a[1][of, of]), (b[0][of], b[1][of, of])))
    return compared(found, adjusted.state.parameters[of], splits)


def compared(pairs: Sequence[tuple[Half, Half]], parameters: FloatArray, splits: int) -> SplitHalf | None:
    """Compare pairs of halves.

    Args:
        pairs: splits with both halves solved.
        parameters: (g,) solution from all views.
        splits: number of splits made.

    Returns:
        The comparison; None if half of the splits or more could not be solved.
    """
    found: list[tuple[float, FloatArray]] = []
    for (a, C_a), (b, C_b) in pairs:
        with suppress(CalibrationError):
            ratio = chi_square(a - b, C_a + C_b) / len(a)
            found.append((ratio, parameters + np.stack([a, b])))
    if 2 * len(found) <= splits:
        return None
    ratios = [ratio for ratio, _ in found]
    kappa2 = float(np.median(ratios))
    middle = int(np.argmin(np.abs(np.array(ratios) - kappa2)))
    return SplitHalf(kappa2=kappa2, by_split=tuple(ratios), halves=found[middle][1])


def chi_square(difference: FloatArray, covariance: FloatArray) -> float:
    """Return dᵀ C⁻¹ d for parameters of different scale; χ² with n degrees of freedom if d is noise.

    Raises:
        CalibrationError: C is singular.
    """
    scale = np.sqrt(np.diag(covariance))
    if not (scale > 0).all():
        raise CalibrationError("a parameter has no variance, so a difference in it cannot be judged")
    unit = difference / scale
    try:
        return float(unit @ np.linalg.solve(covariance / np.outer(scale, scale), unit))
    except np.linalg.LinAlgError:
        raise CalibrationError("the covariance of the difference is singular") from None


class _View(Struct, frozen=True, kw_only=True, eq=False):
    """Normal equations of one view at the solution from all views, with its own pose eliminated.

    Attributes:
        matrix: (g, g) for lens and warp.
        right: (g,) right-hand side.
        rss: sum of squares at its best pose, px².
        scalars: number of measured coordinates.
    """

    matrix: FloatArray
    right: FloatArray
    rss: float
    scalars: int


def _view(adjusted: Adjusted[LensT], row: int) -> _View:
    of, only = adjusted.linear, slice(row, row + 1)
    linear = Linear(residuals=of.residuals[only], by_global=of.by_global[only], by_pose=of.by_pose[only])
    reduced = reduce(linear, adjusted.free)
    return _View(
        matrix=reduced.matrix,
        right=reduced.right,
        rss=linear.rss - reduced.from_poses,
        scalars=2 * int(adjusted.network.seen[row].sum()),
    )


def _half(views: Sequence[_View], size: int) -> Half:
    return solved_half(
        np.sum([view.matrix for view in views], axis=0),
        np.sum([view.right for view in views], axis=0),
        sum(view.rss for view in views),
        sum(view.scalars for view in views) - 6 * len(views) - size,
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
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    if not (scale > 0).all():
        raise CalibrationError("a parameter has no influence on any corner of this half")
    try:
        inverse = np.linalg.inv(matrix / np.outer(scale, scale)) / np.outer(scale, scale)
    except np.linalg.LinAlgError:
        raise CalibrationError("half of the views do not determine all parameters") from None
    step = inverse @ right
    rss -= float(right @ step)
    if not (np.diag(inverse) > 0).all() or dof <= 0 or rss <= 0:
        raise CalibrationError("half of the views do not determine all parameters")
    return step, rss / dof * (inverse + inverse.T) / 2
