"""Where a radial model stops growing or runs to infinity, and its inverse up to there."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike

from calibrary.arrays import FloatArray

__all__ = ["first_positive_root", "inverse_of_rising", "positive_roots"]

NEGLIGIBLE = 1e-200
"""Less than this, where the largest coefficient is about one, moves no root that can be computed with."""

SETTLED = 1e-9
"""A Newton step this short, relative to the solution, leaves an error of its square: nothing in float64."""

SOLVER_STEPS = 60

REAL = 1e-7
"""A double root comes out as a pair this close to the real axis: sqrt(machine epsilon), with room."""


def positive_roots(coefficients: ArrayLike) -> list[float]:
    """The positive real roots, ascending, of the polynomial given with its constant term first.

    They are reciprocals of eigenvalues of the reversed polynomial's companion matrix, each brought to machine
    precision by Newton's method. Reversed, because the roots wanted are the small ones, and a far-off root that
    a tiny leading coefficient brings in must not drown them; one a thousand million times larger than the
    smallest may go unseen. The unit is first chosen, as a power of two, so that no coefficient exceeds one: any
    finite polynomial will do.
    """
    largest = np.finfo(np.float64).max
    given = np.clip(np.asarray(coefficients, dtype=np.float64), -largest, largest)
    octave = min(
        (math.floor(-math.log2(abs(c)) / power) for power, c in enumerate(given) if power and c), default=0
    )
    unit = np.array([math.ldexp(c, power * octave) for power, c in enumerate(given)])
    unit[np.abs(unit) < NEGLIGIBLE] = 0.0
    # A root at zero is not positive, one at infinity none.
    unit = np.trim_zeros(unit)
    if len(unit) < 2:
        return []
    reciprocals = poly.polyroots(unit[::-1])
    real = (np.abs(reciprocals.imag) <= REAL * np.abs(reciprocals)) & (reciprocals.real > 0)
    roots = (_polished(unit, 1.0 / float(reciprocal)) for reciprocal in reciprocals.real[real])
    # A root too large for a float is as good as none.
    return sorted(math.ldexp(root, octave) for root in roots if math.log2(root) + octave < 1023)


def first_positive_root(coefficients: ArrayLike) -> float:
    """The smallest of :func:`positive_roots`, ``inf`` when there is none."""
    return min(positive_roots(coefficients), default=math.inf)


def inverse_of_rising(
    wanted: FloatArray,
    nodes: FloatArray,
    image: FloatArray,
    miss_and_step: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]],
) -> FloatArray:
    """Where a rising function takes the values ``wanted``; NaN where that is not below its last node.

    Newton's method from a tabulated start. A step that would leave the bracket halves it instead, so the
    solution next to a limit, where the slope vanishes, is found as surely as any other.

    Args:
        wanted: (N,) values.
        nodes: (M,) arguments from 0 up to the limit.
        image: (M,) the function there, not falling.
        miss_and_step: from arguments and wanted values to the function less the values, and Newton's step.
    """
    found: FloatArray = np.interp(wanted, image, nodes)
    found[~(wanted < image[-1])] = math.nan
    low, high = np.zeros_like(found), np.full_like(found, nodes[-1])
    moving = np.flatnonzero(found > 0)
    for _ in range(SOLVER_STEPS):
        at = found[moving]
        miss, step = miss_and_step(at, wanted[moving])
        low[moving] = np.where(miss <= 0, at, low[moving])
        high[moving] = np.where(miss >= 0, at, high[moving])
        to = at - step
        inside = (to >= low[moving]) & (to <= high[moving])
        to = np.where(inside, to, 0.5 * (low[moving] + high[moving]))
        found[moving] = to
        moving = moving[~(np.abs(to - at) <= SETTLED * at)]
        if len(moving) == 0:
            break
    found[~(found < nodes[-1])] = math.nan
    return found


def _polished(coefficients: FloatArray, root: float) -> float:
    slope = poly.polyder(coefficients)
    for _ in range(6):
        value, rise = float(poly.polyval(root, coefficients)), float(poly.polyval(root, slope))
        step = value / rise if rise else math.inf
        # At a double root Newton's step is noise; the eigenvalue is as good as it gets.
        if not abs(step) <= 1e-3 * root:
            break
        root -= step
        if abs(step) <= 1e-15 * root:
            break
    return root
