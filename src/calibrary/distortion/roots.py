"""The first positive root of a polynomial: where a radial model folds or blows up."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.polynomial import polynomial as poly

__all__ = ["first_positive_root", "positive_roots"]

NEGLIGIBLE = 1e-60
"""A leading coefficient this much smaller than the largest moves only roots that no camera can reach."""

REAL = 1e-7
"""A double root comes out as a pair this close to the real axis: sqrt(machine epsilon), with room."""


def positive_roots(coefficients: Sequence[float]) -> list[float]:
    """The positive real roots, ascending; coefficients with the constant term first and none above one or so.

    The eigenvalues of the companion matrix, each brought to machine precision by Newton's method.
    """
    kept = np.asarray(coefficients, dtype=np.float64)
    large = np.flatnonzero(np.abs(kept) > NEGLIGIBLE * np.abs(kept).max())
    if len(large) == 0 or large[-1] == 0:
        return []
    kept = kept[: large[-1] + 1]
    roots = poly.polyroots(kept)
    real = np.abs(roots.imag) <= REAL * np.abs(roots)
    return sorted(_polished(kept, float(root)) for root in roots.real[real & (roots.real > 0)])


def first_positive_root(coefficients: Sequence[float]) -> float:
    """The smallest of :func:`positive_roots`, ``inf`` when there is none."""
    return min(positive_roots(coefficients), default=math.inf)


def _polished(coefficients: np.ndarray[tuple[int, ...], np.dtype[np.float64]], root: float) -> float:
    slope = poly.polyder(coefficients)
    for _ in range(3):
        value, rise = float(poly.polyval(root, coefficients)), float(poly.polyval(root, slope))
        step = value / rise if rise else math.inf
        # Near a double root Newton's step is noise; the eigenvalue is as good as it gets.
        if abs(step) > 1e-6 * root:
            break
        root -= step
    return root
