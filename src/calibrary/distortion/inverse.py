"""The exact inverse of a perspective model: Newton's method in the plane, kept inside the fold.

The radial part alone, tabulated, gives a start that is wrong by the tangential and prism terms only; two or
three Newton steps with the analytic Jacobian then reach machine precision, since every step squares the error.
Inside the fold the solution is unique, so whatever converges there is the answer. The few points that do not
converge at once (next to the fold, or no image of anything) are taken up again with a step length that
guarantees progress and never leaves the disc.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from calibrary.distortion.base import FloatArray
from calibrary.distortion.polynomial import PolynomialMap

__all__ = ["invert"]

TABLE_NODES = 1024

SETTLED = 1e-9
"""A Newton step this short, relative to the point, leaves an error of its square: nothing in float64."""

NEWTON_STEPS = 8

DAMPED_STEPS = 120

RESIDUAL = 1e-13
"""What a point that needed damping may miss by, relative to its radius: 4e-10 px at a focal length of 4000 px."""


def invert(
    lens: PolynomialMap, radius: float, u: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Observed to ideal; NaN where nothing inside ``radius`` (the lens's fold) is seen."""
    x, y = np.full_like(u, math.nan), np.full_like(v, math.nan)
    rho = np.sqrt(u * u + v * v)
    rows = np.flatnonzero(rho <= _rim(lens, radius))
    if len(rows) == 0:
        return x, y
    u, v, rho = u[rows], v[rows], rho[rows]
    x0, y0 = _radial_start(lens, radius, u, v, rho)
    found_x, found_y = x0.copy(), y0.copy()
    missed = _newton(lens, radius, u, v, found_x, found_y)
    if len(missed):
        found_x[missed], found_y[missed] = _damped_newton(
            lens, radius, u[missed], v[missed], x0[missed], y0[missed]
        )
    x[rows], y[rows] = found_x, found_y
    return x, y


def _rim(lens: PolynomialMap, radius: float) -> float:
    """A radius that holds the image of the whole disc, so that what lies outside need not be tried."""
    largest = float(np.finfo(np.float64).max)
    if math.isinf(radius):
        return largest
    angle = np.linspace(0.0, 2.0 * math.pi, 256, endpoint=False)
    u, v = lens.image(radius * np.cos(angle), radius * np.sin(angle))
    # Between two of these directions the rim may bulge a little further.
    rim = 1.001 * float(np.max(np.hypot(u, v)))
    return min(rim, largest) if rim > 0 else largest


def _radial_start(
    lens: PolynomialMap, radius: float, u: FloatArray, v: FloatArray, rho: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where the points would be seen from if the lens had only its radial part."""
    unit = math.ldexp(1.0, min(lens.octave, 1000))
    reach, farthest = min(unit, radius), rho.max()
    while reach < radius and lens.radial(np.array([reach]))[0] < farthest:
        reach = min(2.0 * reach, radius)
    # Evenly spaced up to the length of the lens, geometrically beyond.
    r = unit * np.sinh(np.linspace(0.0, math.asinh(reach / unit), TABLE_NODES))
    image = lens.radial(r)
    rising = np.flatnonzero(np.isfinite(image) & (image >= np.fmax.accumulate(image)))
    scale = np.interp(rho, image[rising], r[rising])
    np.divide(scale, rho, out=scale, where=rho > 0)
    return u * scale, v * scale


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
    # On the fold itself there is no Newton step.
    inward = np.minimum(1.0, 0.98 * radius / np.hypot(x, y))
    x, y = x * inward, y * inward
    length = np.ones_like(x)
    close = RESIDUAL * np.hypot(u, v)
    finest = 1e-3 * close
    rows = np.arange(len(x))
    miss = np.hypot(*_difference(lens, u, v, x, y))
    for _ in range(DAMPED_STEPS):
        rows = rows[(miss[rows] > finest[rows]) & (length[rows] > 1e-12)]
        if len(rows) == 0:
            break
        dx, dy = _step(lens, u[rows], v[rows], x[rows], y[rows])
        t = length[rows]
        to_x, to_y = x[rows] + t * dx, y[rows] + t * dy
        to_miss = np.hypot(*_difference(lens, u[rows], v[rows], to_x, to_y))
        better = (to_x * to_x + to_y * to_y < radius * radius) & (to_miss <= (1.0 - 0.25 * t) * miss[rows])
        taken = rows[better]
        x[taken], y[taken], miss[taken] = to_x[better], to_y[better], to_miss[better]
        length[rows] = np.where(better, np.minimum(1.0, 2.0 * t), 0.5 * t)
    lost = ~((miss <= close) & (x * x + y * y < radius * radius))
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
