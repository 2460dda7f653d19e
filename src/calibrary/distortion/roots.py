"""The positive roots of a polynomial: where a radial model folds or blows up."""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike

from calibrary.distortion.base import FloatArray

__all__ = ["first_positive_root", "positive_roots"]

NEGLIGIBLE = 1e-60
"""A leading coefficient this much smaller than the largest moves only roots that no camera can reach."""

REAL = 1e-7
"""A double root comes out as a pair this close to the real axis: sqrt(machine epsilon), with room."""


def positive_roots(coefficients: ArrayLike) -> list[float]:
    """The positive real roots, ascending, of the polynomial given with its constant term first.

    The eigenvalues of the companion matrix, each brought to machine precision by Newton's method. The unit is
    first chosen, as a power of two, so that no coefficient exceeds one: any finite polynomial will do.
    """
    largest = np.finfo(np.float64).max
    given = np.clip(np.asarray(coefficients, dtype=np.float64), -largest, largest)
    growing = [math.floor(-math.log2(abs(c)) / power) for power, c in enumerate(given) if power and c]
    octave = min(growing, default=0)
    unit = np.array([math.ldexp(c, power * octave) for power, c in enumerate(given)])
    kept = np.flatnonzero(np.abs(unit) > NEGLIGIBLE * np.abs(unit).max())
    if len(kept) == 0 or kept[-1] == 0:
        return []
    unit = unit[: kept[-1] + 1]
    roots = poly.polyroots(unit)
    real = (np.abs(roots.imag) <= REAL * np.abs(roots)) & (roots.real > 0)
    polished = (_polished(unit, float(root)) for root in roots.real[real])
    # A root too large for a float is as good as none.
    return sorted(math.ldexp(root, octave) for root in polished if math.log2(root) + octave < 1023)


def first_positive_root(coefficients: ArrayLike) -> float:
    """The smallest of :func:`positive_roots`, ``inf`` when there is none."""
    return min(positive_roots(coefficients), default=math.inf)


def _polished(coefficients: FloatArray, root: float) -> float:
    slope = poly.polyder(coefficients)
    for _ in range(3):
        value, rise = float(poly.polyval(root, coefficients)), float(poly.polyval(root, slope))
        step = value / rise if rise else math.inf
        # Near a double root Newton's step is noise; the eigenvalue is as good as it gets.
        if abs(step) > 1e-6 * root:
            break
        root -= step
    return root
