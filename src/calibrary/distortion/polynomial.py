"""The map that OpenCV's perspective models share, with its Jacobian; roots of polynomials, and inverses.

::

    u = x·N(r²)/D(r²) + 2·p1·x·y + p2·(r² + 2x²) + s1·r² + s2·r⁴         r² = x² + y²
    v = y·N(r²)/D(r²) + p1·(r² + 2y²) + 2·p2·x·y + s3·r² + s4·r⁴
    N(s) = 1 + k1·s + k2·s² + k3·s³        D(s) = 1 + k4·s + k5·s² + k6·s³

Source: OpenCV, "Camera Calibration and 3D Reconstruction", detailed description.

The exact inverse is Newton's method in the plane, inside the valid field of view. A table of the radial part gives a
start value with an error only from the tangential and prism terms. Two or three Newton steps with the analytic Jacobian
then reach machine precision, because each step squares the error. Inside the valid field the solution is unique, so a
converged solution there is the right one. The few points that do not converge (next to the limit, or without a
solution) are solved again with damped steps that never leave the disc.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache
from typing import ClassVar, Self, TypeAlias, TypeVar

from msgspec import Struct

from calibrary.arrays import ArrayLike, FloatArray, NDArray, np, poly
from calibrary.kernel import Form, Front

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

    def form(
        self,
        radius: float,
        front: Front = Front.PERSPECTIVE,
        shape: tuple[float, ...] = (),
        limit: float = math.pi,
    ) -> Form:
        """Return the map, valid up to ``radius`` in the plane, behind a front, for the compiled code."""
        return Form(
            front=front, shape=shape, limit=limit, radius=radius, numerator=self.numerator,
            denominator=self.denominator, tangential=(self.p1, self.p2), prism=(self.s1, self.s2, self.s3, self.s4),
            **self.further,
        )  # fmt: skip

    @property
    def further(self) -> dict[str, tuple[float, float]]:
        """Terms of the compiled code's plane that this map lacks; those of a map that has them."""
        return {}

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


TABLE_NODES = 1024

RIM_NODES = 1024

RIM_MARGIN = 1e-4
"""Generous bound for the error of the interpolated rim between two nodes, relative to its radius."""

SETTLED_IN_PLANE = 1e-9
"""Newton's method ends at a step this short, relative to the point; the error is its square, below float64 rounding."""

NEWTON_STEPS = 8

WELL_CONDITIONED = 0.05
"""Smallest det(J) relative to the sum of squares of J; below it the solution can depend on the method."""

DAMPED_STEPS = 120

RESIDUAL = 1e-13
"""Largest residual of a point solved by damped steps, relative to its radius: 4e-10 px at a focal length of 4000 px."""

LARGEST = sys.float_info.max


class Rim(Struct, frozen=True):
    """Image of the edge of the valid disc; points outside have no preimage and are not tried.

    Attributes:
        inner, outer: smallest and largest radius of the rim, with a margin.
        angle, radius: rim in polar coordinates, None if a direction intersects it more than once.
    """

    inner: float
    outer: float
    angle: FloatArray | None = None
    radius: FloatArray | None = None

    @classmethod
    def of(cls, lens: PolynomialMap, radius: float) -> Rim:
        """Compute the image of the circle of ``radius``."""
        if math.isinf(radius):
            return cls(LARGEST, LARGEST)
        direction = np.linspace(-math.pi, math.pi, RIM_NODES, endpoint=False)
        u, v = lens.image(radius * np.cos(direction), radius * np.sin(direction))
        rho = np.hypot(u, v)
        if not np.isfinite(rho).all():
            return cls(LARGEST, LARGEST)
        inner, outer = (1.0 - RIM_MARGIN) * float(rho.min()), (1.0 + 10 * RIM_MARGIN) * float(rho.max())
        angle = np.unwrap(np.arctan2(v, u))
        turned = angle[-1] - angle[0]
        if (np.diff(angle) > 0).all() and 0 < turned < 2.0 * math.pi:
            return cls(inner, outer, angle, rho)
        return cls(inner, outer)

    def holds(self, u: FloatArray, v: FloatArray, rho: FloatArray) -> NDArray[np.bool_]:
        """Return which points can be inside the rim; points outside by less than the margin may be included."""
        inside = rho <= self.outer
        if self.angle is not None and self.radius is not None:
            close = np.flatnonzero(inside & (rho > self.inner))
            if len(close):
                at = np.interp(np.arctan2(v[close], u[close]), self.angle, self.radius, period=2.0 * math.pi)
                inside[close] = rho[close] <= (1.0 + RIM_MARGIN) * at
        return inside


class Inversion(Struct, frozen=True):
    """Precomputed data for the inversion of a lens.

    Attributes:
        lens: map from undistorted to distorted.
        radius: valid radius of the lens; solutions outside are never returned.
        rim: image of the circle of that radius.
        seen_at, seen_from: distorted and undistorted radii of the radial part, as an ascending table.
    """

    lens: PolynomialMap
    radius: float
    rim: Rim
    seen_at: FloatArray
    seen_from: FloatArray

    @classmethod
    def of(cls, lens: PolynomialMap, radius: float, farthest: float) -> Inversion:
        """Prepare ``lens``, one-to-one up to ``radius``, for distorted points up to ``farthest`` from the axis."""
        reach = min(_unit(lens), radius)
        while reach < radius and lens.radial(np.float64(reach)) < farthest:
            reach = min(2.0 * reach, radius)
        return cls._reaching(lens, radius, reach)

    @classmethod
    @lru_cache(maxsize=64)
    def _reaching(cls, lens: PolynomialMap, radius: float, reach: float) -> Inversion:
        """Prepare with a table up to the undistorted radius ``reach``; cached, because it takes a millisecond."""
        unit = _unit(lens)
        # Evenly spaced up to the unit of length of the lens, geometrically beyond.
        r = unit * np.sinh(np.linspace(0.0, math.asinh(reach / unit), TABLE_NODES))
        image = lens.radial(r)
        rising = np.flatnonzero(np.isfinite(image) & (image >= np.fmax.accumulate(image)))
        return cls(lens, radius, Rim.of(lens, radius), image[rising], r[rising])

    def swift(self, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
        """Distorted to undistorted by full Newton steps.

        Returns:
            x and y (NaN for points without a solution in the valid field), and the rows that need :meth:`patient`.
        """
        rho = np.sqrt(u * u + v * v)
        inside = np.flatnonzero(self.rim.holds(u, v, rho))
        every = len(inside) == len(u)
        to_u, to_v = (u, v) if every else (u[inside], v[inside])
        x, y = self._start(to_u, to_v, rho if every else rho[inside])
        moving = np.arange(len(to_u))
        for _ in range(NEWTON_STEPS):
            # A slice of all rows avoids a copy.
            rows = slice(None) if len(moving) == len(to_u) else moving
            at_x, at_y = x[rows], y[rows]
            dx, dy = _step(self.lens, to_u[rows], to_v[rows], at_x, at_y)
            x[rows], y[rows] = at_x + dx, at_y + dy
            moving = moving[~(dx * dx + dy * dy <= SETTLED_IN_PLANE**2 * (at_x * at_x + at_y * at_y))]
            if len(moving) == 0:
                break
        missed = ~(x * x + y * y < self.radius * self.radius)
        missed[moving] = True
        if every:
            return x, y, np.flatnonzero(missed)
        found_x, found_y = np.full_like(u, math.nan), np.full_like(v, math.nan)
        found_x[inside], found_y[inside] = x, y
        return found_x, found_y, inside[missed]

    def patient(self, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distorted to undistorted for points near or beyond the limit, by steps that never leave the disc."""
        x, y = self._start(u, v, np.sqrt(u * u + v * v))
        return _damped_newton(self.lens, self.radius, u, v, x, y)

    def _start(self, u: FloatArray, v: FloatArray, rho: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the undistorted points for the radial part of the lens alone."""
        scale = np.interp(rho, self.seen_at, self.seen_from)
        np.divide(scale, rho, out=scale, where=rho > 0)
        return u * scale, v * scale


def solved(lens: PolynomialMap, u: float, v: float, radius: float) -> tuple[float, float] | None:
    """Undistort one point by full Newton steps in plain floats.

    Returns:
        x, y inside the valid field, where the solution is unique. None if the steps do not converge, if the point is
        too close to the limit, or if there is no solution; use :class:`Inversion` then.
    """
    if lens.brown is not None:
        return _brown_solved(lens.brown, u, v, radius)
    try:
        rho = math.sqrt(u * u + v * v)
        image = lens.radial(rho)
        scale = rho / image if image > 0 else 1.0
        x, y = u * scale, v * scale
        for _ in range(NEWTON_STEPS):
            at_u, at_v, (ux, uy, vx, vy) = lens.image_and_jacobian(x, y)
            at_u -= u
            at_v -= v
            det = ux * vy - uy * vx
            dx, dy = (uy * at_v - vy * at_u) / det, (vx * at_u - ux * at_v) / det
            settled = dx * dx + dy * dy <= SETTLED_IN_PLANE**2 * (x * x + y * y)
            x, y = x + dx, y + dy
            if settled:
                steep = det > WELL_CONDITIONED * (ux * ux + uy * uy + vx * vx + vy * vy)
                return (x, y) if steep and x * x + y * y < radius * radius else None
    except ArithmeticError:
        return None
    return None


def _brown_solved(
    brown: tuple[float, float, float, float, float], u: float, v: float, radius: float
) -> tuple[float, float] | None:
    """:func:`solved` written out for Brown's five coefficients; takes a third of the time of the general formula.

    With p = p2 + i·p1 the map is z·G + p·s, where s = |z|² and G = N(s) + 2·Re(p̄z). Its derivatives by z and z̄ are
    ``along`` = N + s·N' + 4·Re(p̄z), which is real, and ``turn`` = z·(z·N' + 2p).
    """
    k1, k2, k3, p1, p2 = brown
    twice_k2, thrice_k3 = 2.0 * k2, 3.0 * k3
    s = u * u + v * v
    try:
        radial = 1.0 + s * (k1 + s * (k2 + s * k3))
        x, y = (u / radial, v / radial) if radial > 0 else (u, v)
        for _ in range(NEWTON_STEPS):
            s = x * x + y * y
            slope = k1 + s * (twice_k2 + s * thrice_k3)
            radial = 1.0 + s * (k1 + s * (k2 + s * k3))
            across = 2.0 * (p2 * x + p1 * y)
            gain = radial + across
            miss_u, miss_v = x * gain + p2 * s - u, y * gain + p1 * s - v
            along = gain + s * slope + across
            a, b = x * slope + 2.0 * p2, y * slope + 2.0 * p1
            turn_x, turn_y = x * a - y * b, x * b + y * a
            det = along * along - (turn_x * turn_x + turn_y * turn_y)
            dx = ((turn_x - along) * miss_u + turn_y * miss_v) / det
            dy = (turn_y * miss_u - (turn_x + along) * miss_v) / det
            x += dx
            y += dy
            if dx * dx + dy * dy <= SETTLED_IN_PLANE**2 * s:
                # The sum of the squares of the four derivatives by x and y is 2·(along² + |turn|²).
                steep = det * (1.0 + 2.0 * WELL_CONDITIONED) > 4.0 * WELL_CONDITIONED * along * along
                return (x, y) if steep and x * x + y * y < radius * radius else None
    except ArithmeticError:
        return None
    return None


def _unit(lens: PolynomialMap) -> float:
    """Return the lens's own unit of length: 2 to the power of :attr:`PolynomialMap.octave`."""
    return math.ldexp(1.0, min(lens.octave, 1000))


def _damped_newton(
    lens: PolynomialMap, radius: float, u: FloatArray, v: FloatArray, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Newton's method inside the disc, with step lengths by Armijo's rule; NaN where it fails."""
    # The Newton step is undefined on the limit itself.
    inward = np.minimum(1.0, 0.98 * radius / np.hypot(x, y))
    x, y = x * inward, y * inward
    length, shortest = np.ones_like(x), 1e-12
    close = RESIDUAL * np.hypot(u, v)
    miss = np.hypot(*_difference(lens, u, v, x, y))
    settled = miss <= close
    rows = np.flatnonzero(~settled)
    for _ in range(DAMPED_STEPS):
        if len(rows) == 0:
            break
        dx, dy = _step(lens, u[rows], v[rows], x[rows], y[rows])
        t = length[rows]
        to_x, to_y = x[rows] + t * dx, y[rows] + t * dy
        to_miss = np.hypot(*_difference(lens, u[rows], v[rows], to_x, to_y))
        inside = to_x * to_x + to_y * to_y < radius * radius
        # Converged: by a negligible step (next to a pole the residual stays large), or by a negligible residual
        # (next to the limit the steps stay large).
        arrived = inside & (
            (np.hypot(dx, dy) <= SETTLED_IN_PLANE * np.hypot(x[rows], y[rows]))
            | (to_miss <= 1e-3 * close[rows])
        )
        better = arrived | (inside & (to_miss <= (1.0 - 0.25 * t) * miss[rows]))
        taken = rows[better]
        x[taken], y[taken], miss[taken] = to_x[better], to_y[better], to_miss[better]
        length[rows] = np.where(better, np.minimum(1.0, 2.0 * t), 0.5 * t)
        settled[rows] = arrived
        rows = rows[~arrived & (length[rows] > shortest)]
    lost = ~(settled | (miss <= close))
    x[lost] = y[lost] = math.nan
    return x, y


def _step(
    lens: PolynomialMap, u: FloatArray, v: FloatArray, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the Newton step from (x, y) towards the preimage of (u, v)."""
    at_u, at_v, (ux, uy, vx, vy) = lens.image_and_jacobian(x, y)
    at_u -= u
    at_v -= v
    det = ux * vy - uy * vx
    return (uy * at_v - vy * at_u) / det, (vx * at_u - ux * at_v) / det


def _difference(
    lens: PolynomialMap, u: FloatArray, v: FloatArray, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    at_u, at_v = lens.image(x, y)
    return at_u - u, at_v - v
