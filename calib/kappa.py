"""A lie detector for standard deviations: do two halves of the views agree as well as each half says it should?

A covariance from residuals knows noise that differs from corner to corner. What bends all corners of a view
together, such as a bowed board or a rolling shutter, makes the estimates scatter more than it says, by 2 to 20
times. So the views are dealt into two halves at random, each is solved alone, and with d the difference of the two
and C its covariance as they state it, κ² = dᵀ C⁻¹ d / n is about 1 where noise is all there is. Measured at 25
views: 0.6–1.2 for a flat board, over 10 for one bent by 0.2 mm in 400 that is taken for flat.

Splitting the data is mrcal's "cross-validation"; the multiple of the variance is a Birge ratio (R. T. Birge,
"The calculation of errors by the method of least squares", 1932).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibrary.calib.adjustment import Adjusted, adjust
from calibrary.calib.covariance import lens_covariance
from calibrary.calibration import Covariance
from calibrary.errors import CalibrationError

__all__ = ["SplitHalf", "chi_square", "split_half"]

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.intp]

SPLITS: Final = 7
FEWEST_VIEWS: Final = 6
"""In all: a half of fewer than three views of a plane hardly determines a camera."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SplitHalf:
    """What the halves said.

    Attributes:
        kappa2: median over the splits of χ² / n.
        by_split: the values that it is the median of, in the order of the splits.
        halves: (2, n) lens parameters of the two halves in the median split.
    """

    kappa2: float
    by_split: tuple[float, ...]
    halves: FloatArray


def split_half(adjusted: Adjusted, *, splits: int = SPLITS, seed: int = 0) -> SplitHalf | None:
    """Solve halves of the views, several times over.

    Args:
        adjusted: the solution from all views; the halves start from it and keep its model and its warp free.
        splits: how many times; an odd number has a split for its median.
        seed: of the dealing.

    Returns:
        None where there are fewer than six views, or hardly any half can be solved.
    """
    rows = np.flatnonzero(adjusted.network.used)
    if len(rows) < FEWEST_VIEWS:
        return None
    random = np.random.default_rng(seed)
    found: list[tuple[float, FloatArray]] = []
    for _ in range(splits):
        dealt = random.permutation(rows)
        with suppress(CalibrationError):
            a, C_a = _half(adjusted, np.sort(dealt[::2]))
            b, C_b = _half(adjusted, np.sort(dealt[1::2]))
            found.append((chi_square(a - b, C_a.matrix + C_b.matrix) / len(a), np.stack([a, b])))
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
        raise CalibrationError("a parameter has no variance: nothing can be said about a difference in it")
    unit = difference / scale
    try:
        return float(unit @ np.linalg.solve(covariance / np.outer(scale, scale), unit))
    except np.linalg.LinAlgError:
        raise CalibrationError("the covariance of the difference is singular") from None


def _half(adjusted: Adjusted, rows: IntArray) -> tuple[FloatArray, Covariance]:
    bent = len(adjusted.free) > len(adjusted.state.parameters)
    half = adjust(adjusted.network.views(rows), adjusted.state.views(rows), warp=bent)
    return half.state.parameters, lens_covariance(half)
