"""A lie detector for standard deviations: do two halves of the views agree as well as each half says it should?

A covariance from residuals knows noise that differs from corner to corner. What bends all corners of a view
together, such as a bowed board or a rolling shutter, makes the estimates scatter more than it says, by 2 to 20
times. So the views are dealt into two halves at random, each is solved alone, and with d the difference of the two
and C its covariance as they state it, κ² = dᵀ C⁻¹ d / n is about 1 where noise is all there is. Measured at 25
views: 0.6–1.2 for a flat board, over 10 for one bent by 0.2 mm in 400 that is taken for flat.

How the views happen to be dealt matters: with OpenCV's own 13 frames single splits say 1 to 13, and the median of seven
anything from 3 to 9. So many splits are made, each by one step of Gauss and Newton from the solution of all views,
which is nearly where a half's own solution lies; it takes the normal equations of each view only, once.

Splitting the data is mrcal's "cross-validation"; the multiple of the variance is a Birge ratio (R. T. Birge,
"The calculation of errors by the method of least squares", 1932).
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
"""(g,) where a half's solution lies from that of everything, and its (g, g) covariance."""

SPLITS: Final = 101
FEWEST_VIEWS: Final = 6
"""In all: a half of fewer than three views of a plane hardly determines a camera."""


class SplitHalf(Struct, frozen=True, kw_only=True, eq=False):
    """What the halves said.

    Attributes:
        kappa2: median over the splits of χ² / n.
        by_split: the values that it is the median of, in the order of the splits.
        halves: (2, n) the parameters that were compared, of the two halves in the median split.
    """

    kappa2: float
    by_split: tuple[float, ...]
    halves: FloatArray


def split_half(
    adjusted: Adjusted[LensT], *, of: slice | None = None, splits: int = SPLITS, seed: int = 0
) -> SplitHalf | None:
    """Solve halves of the views, several times over.

    Args:
        adjusted: the solution from all views; the halves keep its model, and its warp free.
        of: the parameters that are compared; None for all but the warp.
        splits: how many times; an odd number has a split for its median.
        seed: of the dealing.

    Returns:
        None where there are fewer than six views, or hardly any half can be solved.
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
    """Hold halves against one another.

    Args:
        pairs: of the splits whose halves could be solved.
        parameters: (g,) the solution from everything.
        splits: how many were dealt.

    Returns:
        None where half of them or more could not be solved.
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
    """dᵀ C⁻¹ d, of parameters of very different sizes; χ² with n degrees of freedom where d is noise.

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
    """One view's normal equations around the solution of all, its own pose eliminated.

    Attributes:
        matrix: (g, g) of the lens and the warp.
        right: (g,).
        rss: px², at its best pose.
        scalars: measured coordinates.
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
    """Solve a half's normal equations, all but the lens eliminated.

    Args:
        matrix: (g, g).
        right: (g,).
        rss: px², before the step.
        dof: of the half.

    Raises:
        CalibrationError: they do not determine every parameter.
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
