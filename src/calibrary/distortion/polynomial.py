"""The map that OpenCV's perspective models share, with its Jacobian; roots of polynomials, and inverses.

::

    u = x·N(r²)/D(r²) + 2·p1·x·y + p2·(r² + 2x²) + s1·r² + s2·r⁴         r² = x² + y²
    v = y·N(r²)/D(r²) + p1·(r² + 2y²) + 2·p2·x·y + s3·r² + s4·r⁴
    N(s) = 1 + k1·s + k2·s² + k3·s³        D(s) = 1 + k4·s + k5·s² + k6·s³

Source: OpenCV, "Camera Calibration and 3D Reconstruction", detailed description.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import ClassVar, Self, TypeAlias, TypeVar

import numpy as np
from msgspec import Struct
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike

from calibrary.arrays import FloatArray

__all__ = [
    "Jacobian",
    "Number",
    "PolynomialMap",
    "Rising",
    "first_positive_root",
    "inverse_of_rising",
    "trimmed",
]

Number = TypeVar("Number", float, FloatArray)
"""Coordinate of one point (float) or of many (array), with the same arithmetic."""

Jacobian: TypeAlias = tuple[Number, Number, Number, Number]
"""∂u/∂x, ∂u/∂y, ∂v/∂x, ∂v/∂y."""

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


class PolynomialMap(Struct, frozen=True, kw_only=True, dict=True):
    """Coefficients of the formula above; those that a model lacks are zero."""

    POWERS: ClassVar[dict[str, int]] = {
        "k1": 2, "k2": 4, "p1": 1, "p2": 1, "k3": 6, "k4": 2,
        "k5": 4, "k6": 6, "s1": 1, "s2": 3, "s3": 1, "s4": 3,
    }  # fmt: skip
    """Power of r in the contribution of each coefficient to the image point, relative to the point itself."""

    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0
    s1: float = 0.0
    s2: float = 0.0
    s3: float = 0.0
    s4: float = 0.0

    @cached_property
    def numerator(self) -> list[float]:
        """N, constant term first, without trailing zeros."""
        return trimmed([1.0, self.k1, self.k2, self.k3])

    @cached_property
    def denominator(self) -> list[float]:
        """D, constant term first, without trailing zeros."""
        return trimmed([1.0, self.k4, self.k5, self.k6])

    @cached_property
    def is_radial(self) -> bool:
        """Whether every point moves along its own radius."""
        return not (self.p1 or self.p2 or self.has_prism)

    @cached_property
    def has_prism(self) -> bool:
        """Whether a thin-prism coefficient is not zero."""
        return bool(self.s1 or self.s2 or self.s3 or self.s4)

    @cached_property
    def brown(self) -> tuple[float, float, float, float, float] | None:
        """k1, k2, k3, p1, p2 if the map has only these, as for nearly every lens; otherwise None."""
        if len(self.numerator) > 4 or len(self.denominator) > 1 or self.has_prism:
            return None
        return self.k1, self.k2, self.k3, self.p1, self.p2

    @cached_property
    def octave(self) -> int:
        """Exponent of the map's unit of length, a power of two in which no coefficient of ``POWERS`` exceeds 1/2.

        The limit of the map is at radii of this order. In this unit nothing overflows and roots are well conditioned;
        scaling by a power of two is exact.
        """
        return min(
            (
                math.floor(-math.log2(abs(c)) / power) - 1
                for name, power in self.POWERS.items()
                if power and (c := getattr(self, name))
            ),
            default=0,
        )

    def in_octave(self, octave: int) -> Self:
        """Return the same map with undistorted and distorted radii in units of 2**octave."""
        return type(self)(
            **{name: math.ldexp(getattr(self, name), power * octave) for name, power in self.POWERS.items()}
        )

    def radial(self, r: Number) -> Number:
        """Return the distorted radius of ``r`` by the radial part alone."""
        r2 = r * r
        return r * _horner(self.numerator, r2) / _horner(self.denominator, r2)

    def image(self, x: Number, y: Number) -> tuple[Number, Number]:
        """Undistorted to distorted."""
        r2 = x * x
        r2 += y * y
        gain = _horner(self.numerator, r2)
        if len(self.denominator) > 1:
            gain = gain / _horner(self.denominator, r2)
        if not (self.p1 or self.p2):
            u, v = x * gain, y * gain
        else:
            # 2·p1·x·y + p2·(r² + 2x²) = x·across + p2·r², and likewise for v.
            gain = gain + (2.0 * self.p2) * x + (2.0 * self.p1) * y
            u, v = x * gain, y * gain
            u += self.p2 * r2
            v += self.p1 * r2
        if self.has_prism:
            u += r2 * (self.s1 + self.s2 * r2)
            v += r2 * (self.s3 + self.s4 * r2)
        return u, v

    def image_and_jacobian(self, x: Number, y: Number) -> tuple[Number, Number, Jacobian[Number]]:
        """Undistorted to distorted, with the four derivatives."""
        x2, y2 = 2.0 * x, 2.0 * y
        r2 = x * x + y * y
        gain, slope = _horner(self.numerator, r2), _horner(self._slopes[0], r2)
        if len(self.denominator) > 1:
            divisor = _horner(self.denominator, r2)
            gain = gain / divisor
            slope = (slope - gain * _horner(self._slopes[1], r2)) / divisor
        gain = gain + self.p2 * x2 + self.p1 * y2
        gain_x = slope * x2 + 2.0 * self.p2
        gain_y = slope * y2 + 2.0 * self.p1
        u, v = x * gain, y * gain
        ux, uy = gain + x * gain_x, x * gain_y
        vx, vy = y * gain_x, gain + y * gain_y
        if not self.is_radial:
            by_r2_u, by_r2_v = self.p2 + self.s1, self.p1 + self.s3
            u += by_r2_u * r2
            v += by_r2_v * r2
            ux += by_r2_u * x2
            uy += by_r2_u * y2
            vx += by_r2_v * x2
            vy += by_r2_v * y2
        if self.s2 or self.s4:
            r4, r2_twice = r2 * r2, 2.0 * r2
            u += self.s2 * r4
            v += self.s4 * r4
            ux += self.s2 * r2_twice * x2
            uy += self.s2 * r2_twice * y2
            vx += self.s4 * r2_twice * x2
            vy += self.s4 * r2_twice * y2
        return u, v, (ux, uy, vx, vy)

    @cached_property
    def _slopes(self) -> tuple[list[float], list[float]]:
        """The derivatives of N and D by r²."""
        return _derivative(self.numerator), _derivative(self.denominator)


def _horner(coefficients: Sequence[float], s: Number) -> Number:
    """Evaluate a polynomial, constant term first, at ``s``."""
    if len(coefficients) == 1:
        return s * 0.0 + coefficients[0]
    value = s * coefficients[-1]
    for c in coefficients[-2:0:-1]:
        value += c
        value *= s
    value += coefficients[0]
    return value


def _derivative(coefficients: Sequence[float]) -> list[float]:
    return [power * c for power, c in enumerate(coefficients)][1:] or [0.0]


def trimmed(coefficients: list[float]) -> list[float]:
    """Remove trailing zeros from the list, except the first coefficient; returns the list."""
    while len(coefficients) > 1 and coefficients[-1] == 0.0:
        coefficients.pop()
    return coefficients


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
