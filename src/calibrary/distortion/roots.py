"""Positive roots of polynomials (limits of radial models), and the inverse of increasing functions."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec import Struct
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike

from calibrary.arrays import FloatArray

__all__ = ["Rising", "first_positive_root", "inverse_of_rising"]

NEGLIGIBLE = 1e-200
"""Coefficients below this, with the largest about one, have no effect on any representable root."""

SETTLED = 1e-8
"""Newton's method ends at this relative step; the remaining error is its square, which is below float64 rounding."""

SOLVER_STEPS = 60

POLISHED = 6
"""Most steps by which an eigenvalue is refined to a root."""

START_NODES = 16_384

REAL = 1e-7
"""Largest relative imaginary part of a real root; a double root gives a pair at about sqrt(machine epsilon)."""


def first_positive_root(coefficients: ArrayLike) -> float:
    """Return the smallest positive real root of a polynomial with its constant term first; ``inf`` if there is none.

    The roots are reciprocals of eigenvalues of the reversed polynomial's companion matrix, each refined to machine
    precision by Newton's method. The reversal protects the small roots, which matter, from a very large root due to a
    tiny leading coefficient; roots more than 1e9 times the smallest may be missed. The unit is first scaled by a power
    of two so that no coefficient exceeds one; any finite polynomial is therefore accepted.
    """
    largest = np.finfo(np.float64).max
    given = np.clip(np.asarray(coefficients, dtype=np.float64), -largest, largest)
    octave = min(
        (math.floor(-math.log2(abs(c)) / power) for power, c in enumerate(given) if power and c), default=0
    )
    unit = np.array([math.ldexp(c, power * octave) for power, c in enumerate(given)])
    unit[np.abs(unit) < NEGLIGIBLE] = 0.0
    # Drop roots at zero, which are not positive, and roots at infinity.
    unit = np.trim_zeros(unit)
    if len(unit) < 2:
        return math.inf
    reciprocals = poly.polyroots(unit[::-1])
    real = (np.abs(reciprocals.imag) <= REAL * np.abs(reciprocals)) & (reciprocals.real > 0)
    slope, first = poly.polyder(unit), math.inf
    for reciprocal in reciprocals.real[real]:
        root = 1.0 / float(reciprocal)
        for _ in range(POLISHED):
            with np.errstate(all="ignore"):
                value, rise = float(poly.polyval(root, unit)), float(poly.polyval(root, slope))
            step = value / rise if rise else math.inf
            # At a double root Newton's step is only noise, and the eigenvalue is the best available estimate.
            if not abs(step) <= 1e-3 * root:
                break
            root -= step
            if abs(step) <= 1e-15 * root:
                break
        # Omit roots that overflow a float.
        if math.log2(root) + octave < 1023:
            first = min(first, math.ldexp(root, octave))
    return first


class Rising(Struct, frozen=True):
    """Table for the inverse of a function that increases from 0 up to a limit.

    Attributes:
        limit: largest argument.
        top: value at the limit.
        starts: approximate arguments of evenly spaced values from 0 to ``top``.
    """

    limit: float
    top: float
    starts: FloatArray

    @classmethod
    def of(cls, nodes: FloatArray, image: FloatArray) -> Rising:
        """Tabulate from (M,) arguments, the first 0, and the (M,) non-decreasing values there."""
        top = float(image[-1])
        values = np.linspace(0.0, top, START_NODES) if math.isfinite(top) else np.zeros(START_NODES)
        return cls(float(nodes[-1]), top, np.interp(values, image, nodes))

    def start(self, wanted: FloatArray) -> FloatArray:
        """Return (N,) approximate arguments of the values ``wanted``; NaN for values not below ``top``."""
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
    """Return the arguments at which an increasing function has the values ``wanted``; NaN if not below its last.

    Newton's method from a tabulated start. Nearly everywhere the first step converges. Next to a limit, where the slope
    vanishes, a step that would leave the bracket is replaced by a bisection, so the method always converges.

    Args:
        wanted: (N,) values, 0 or more.
        table: table of the function.
        miss_and_step: from arguments and wanted values to the residuals (function minus values) and Newton steps.
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
    """:func:`inverse_of_rising` by steps that never leave the bracket of the solution."""
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
