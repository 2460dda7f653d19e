"""Exact inverse of a perspective model: Newton's method in the plane, inside the valid field of view.

A table of the radial part gives a start value with an error only from the tangential and prism terms. Two or three
Newton steps with the analytic Jacobian then reach machine precision, because each step squares the error. Inside the
valid field the solution is unique, so a converged solution there is the right one. The few points that do not converge
(next to the limit, or without a solution) are solved again with damped steps that never leave the disc.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary.arrays import FloatArray
from calibrary.distortion.polynomial import PolynomialMap

__all__ = ["NEWTON_STEPS", "SETTLED", "WELL_CONDITIONED", "Inversion", "solved"]

TABLE_NODES = 1024

RIM_NODES = 1024

RIM_MARGIN = 1e-4
"""Generous bound for the error of the interpolated rim between two nodes, relative to its radius."""

SETTLED = 1e-9
"""Newton's method ends at a step this short, relative to the point; the error is its square, below float64 rounding."""

NEWTON_STEPS = 8

WELL_CONDITIONED = 0.05
"""Smallest det(J) relative to the sum of squares of J; below it the solution can depend on the method."""

DAMPED_STEPS = 120

RESIDUAL = 1e-13
"""Largest residual of a point solved by damped steps, relative to its radius: 4e-10 px at a focal length of 4000 px."""

LARGEST = float(np.finfo(np.float64).max)


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
            moving = moving[~(dx * dx + dy * dy <= SETTLED**2 * (at_x * at_x + at_y * at_y))]
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
            settled = dx * dx + dy * dy <= SETTLED**2 * (x * x + y * y)
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
            if dx * dx + dy * dy <= SETTLED**2 * s:
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
            (np.hypot(dx, dy) <= SETTLED * np.hypot(x[rows], y[rows])) | (to_miss <= 1e-3 * close[rows])
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
