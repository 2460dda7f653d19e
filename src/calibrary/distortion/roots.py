"""Where a radial model stops growing or runs to infinity, and its inverse up to there."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec import Struct
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike

from calibrary.arrays import FloatArray

__all__ = ["Rising", "first_positive_root", "inverse_of_rising", "positive_roots"]

NEGLIGIBLE = 1e-200
"""Less than this, where the largest coefficient is about one, moves no root that can be computed with."""

SETTLED = 1e-8
"""A Newton step this short, relative to the solution, leaves an error of its square: nothing in float64."""

SOLVER_STEPS = 60

START_NODES = 16_384

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


class Rising(Struct, frozen=True):
    """A function that rises from 0 up to a limit, tabulated for its inverse.

    Attributes:
        limit: the argument where it ends.
        top: its value there.
        starts: arguments of evenly spaced values from 0 to ``top``, to the table's precision.
    """

    limit: float
    top: float
    starts: FloatArray

    @classmethod
    def of(cls, nodes: FloatArray, image: FloatArray) -> Rising:
        """From (M,) arguments that start at 0 and the function there, which does not fall."""
        top = float(image[-1])
        values = np.linspace(0.0, top, START_NODES) if math.isfinite(top) else np.zeros(START_NODES)
        return cls(float(nodes[-1]), top, np.interp(values, image, nodes))

    def start(self, wanted: FloatArray) -> FloatArray:
        """(N,) arguments near those of the values ``wanted``; NaN where these are not below ``top``."""
        at = wanted * ((START_NODES - 1) / self.top)
        at[~(wanted < self.top)] = 0.0
        cell = np.minimum(at.astype(np.intp), START_NODES - 2)
        at -= cell
        low = self.starts.take(cell)
        found: FloatArray = low + at * (self.starts.take(cell + 1) - low)
        found[~(wanted < self.top)] = math.nan
        return found


def inverse_of_rising(
    wanted: FloatArray,
    table: Rising,
    miss_and_step: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]],
) -> FloatArray:
    """Where a rising function takes the values ``wanted``; NaN where that is not below its last value.

    Newton's method from a tabulated start. Nearly everywhere its first step settles the value; next to a limit, where
    the slope vanishes, a step that would leave the bracket halves it instead, so the solution is found as surely.

    Args:
        wanted: (N,) values, 0 or more.
        table: the function.
        miss_and_step: from arguments and wanted values to the function less the values, and Newton's step.
    """
    found = table.start(wanted)
    to = found - miss_and_step(found, wanted)[1]
    settled = np.abs(to - found) <= SETTLED * found
    settled &= (to > 0) & (to <= table.limit)
    moving = np.flatnonzero((wanted > 0) & (wanted < table.top) & ~settled)
    np.copyto(found, to, where=settled)
    if len(moving):
        found[moving] = _bracketed(found[moving], wanted[moving], table.limit, miss_and_step)
    found[~(found < table.limit)] = math.nan
    return found


def _bracketed(
    found: FloatArray,
    wanted: FloatArray,
    limit: float,
    miss_and_step: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]],
) -> FloatArray:
    """:func:`inverse_of_rising` by steps that never leave the bracket in which the solution lies."""
    low, high = np.zeros_like(found), np.full_like(found, limit)
    moving = np.arange(len(found))
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
    return found


@np.errstate(all="ignore")
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
