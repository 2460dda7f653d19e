"""The exact inverse of a perspective model: Newton's method in the plane, kept inside the valid field.

The radial part alone, tabulated, gives a start that is wrong by the tangential and prism terms only; two or
three Newton steps with the analytic Jacobian then reach machine precision, since every step squares the error.
Inside the valid field the solution is unique, so whatever converges there is the answer. The few points that do not
converge at once (next to the limit, or no image of anything) are taken up again with a step length that
guarantees progress and never leaves the disc.
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
"""How far the rim may bulge between two nodes, relative to its radius, with plenty to spare."""

SETTLED = 1e-9
"""A Newton step this short, relative to the point, leaves an error of its square: nothing in float64."""

NEWTON_STEPS = 8

WELL_CONDITIONED = 0.05
"""Below it a step in the image says little of the step before the lens, and ways that end elsewhere differ."""

DAMPED_STEPS = 120

RESIDUAL = 1e-13
"""What a point that needed damping may miss by, relative to its radius: 4e-10 px at a focal length of 4000 px."""

LARGEST = float(np.finfo(np.float64).max)


class Rim(Struct, frozen=True):
    """Where the edge of the valid disc is seen: what lies outside has no preimage and need not be tried.

    Attributes:
        inner, outer: the rim lies between these two radii.
        angle, radius: the rim itself in polar coordinates, None where a direction meets it more than once.
    """

    inner: float
    outer: float
    angle: FloatArray | None = None
    radius: FloatArray | None = None

    @classmethod
    def of(cls, lens: PolynomialMap, radius: float) -> Rim:
        """The image of the circle of ``radius``."""
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
        """Which points may lie inside; a point outside by less than the margin may pass too."""
        inside = rho <= self.outer
        if self.angle is not None and self.radius is not None:
            close = np.flatnonzero(inside & (rho > self.inner))
            if len(close):
                at = np.interp(np.arctan2(v[close], u[close]), self.angle, self.radius, period=2.0 * math.pi)
                inside[close] = rho[close] <= (1.0 + RIM_MARGIN) * at
        return inside


class Inversion(Struct, frozen=True):
    """A lens prepared for being inverted.

    Attributes:
        lens: the map.
        radius: its valid radius; nothing outside is ever returned.
        rim: the image of the circle of that radius.
        seen_at, seen_from: the radial part as a rising table, distorted and undistorted radii.
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
        """Prepared, with a table up to the undistorted radius ``reach``; remembered, since it costs a millisecond."""
        unit = _unit(lens)
        # Evenly spaced up to the length of the lens, geometrically beyond.
        r = unit * np.sinh(np.linspace(0.0, math.asinh(reach / unit), TABLE_NODES))
        image = lens.radial(r)
        rising = np.flatnonzero(np.isfinite(image) & (image >= np.fmax.accumulate(image)))
        return cls(lens, radius, Rim.of(lens, radius), image[rising], r[rising])

    def swift(self, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
        """Distorted to undistorted by full Newton steps.

        Returns:
            x, y, NaN where nothing inside the valid field is seen, and the rows that need :meth:`patient` instead.
        """
        x, y = np.full_like(u, math.nan), np.full_like(v, math.nan)
        rho = np.sqrt(u * u + v * v)
        rows = np.flatnonzero(self.rim.holds(u, v, rho))
        if len(rows) == len(u):
            x, y = self._start(u, v, rho)
            return x, y, _newton(self.lens, self.radius, u, v, x, y)
        u, v = u[rows], v[rows]
        found_x, found_y = self._start(u, v, rho[rows])
        missed = _newton(self.lens, self.radius, u, v, found_x, found_y)
        x[rows], y[rows] = found_x, found_y
        return x, y, rows[missed]

    def patient(self, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distorted to undistorted for points next to the limit or outside it, by steps that never leave the disc."""
        x, y = self._start(u, v, np.sqrt(u * u + v * v))
        return _damped_newton(self.lens, self.radius, u, v, x, y)

    def _start(self, u: FloatArray, v: FloatArray, rho: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where the points would be seen from if the lens had only its radial part."""
        scale = np.interp(rho, self.seen_at, self.seen_from)
        np.divide(scale, rho, out=scale, where=rho > 0)
        return u * scale, v * scale


def solved(lens: PolynomialMap, u: float, v: float, radius: float) -> tuple[float, float] | None:
    """What is seen at one point, by full Newton steps in plain floats.

    Returns:
        x, y inside the valid field, where the solution is unique; None where this way does not settle, where next to
        the limit it may end elsewhere, and where there is no solution: :class:`Inversion` decides those.
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
    """:func:`solved` of Brown's five coefficients, written out: a third of what any map's formula takes.

    With p = p2 + i·p1 the map is z·G + p·s, s = |z|² and G = N(s) + 2·Re(p̄z); its derivatives by z and by z̄ are
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
    """The length that the lens is measured by."""
    return math.ldexp(1.0, min(lens.octave, 1000))


def _newton(
    lens: PolynomialMap, radius: float, u: FloatArray, v: FloatArray, x: FloatArray, y: FloatArray
) -> NDArray[np.intp]:
    """Improve x, y in place by full steps; the rows that did not settle inside the disc are returned."""
    every = np.arange(len(u))
    moving = every
    for _ in range(NEWTON_STEPS):
        # Taking all rows needs no copy of them.
        rows = slice(None) if len(moving) == len(every) else moving
        at_x, at_y = x[rows], y[rows]
        dx, dy = _step(lens, u[rows], v[rows], at_x, at_y)
        x[rows], y[rows] = at_x + dx, at_y + dy
        moving = moving[~(dx * dx + dy * dy <= SETTLED**2 * (at_x * at_x + at_y * at_y))]
        if len(moving) == 0:
            break
    missed = ~(x * x + y * y < radius * radius)
    missed[moving] = True
    return np.flatnonzero(missed)


def _damped_newton(
    lens: PolynomialMap, radius: float, u: FloatArray, v: FloatArray, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Newton's method with Armijo's rule for the length of the step, inside the disc; NaN where it fails."""
    # On the limit itself there is no Newton step.
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
        # Where the image runs away (next to a pole) a step of nothing is all that can be had, next to the limit
        # a miss of nothing.
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
    """Newton's step from (x, y) towards what is seen at (u, v)."""
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
