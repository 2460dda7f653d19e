"""How far out a perspective model is one-to-one.

On the circle of radius r, with A = r·N/D, q = (p2, p1) and S = r²(s1, s3) + r⁴(s2, s4), the point r·e (e a unit
vector) is seen at ``(A + 2r² q·e) e + r² q + S``. So a circle's image is a limaçon, shifted: a simple curve
while A > 2r²|q|, and at the first radius where that fails its tangent vanishes, and the Jacobian determinant
with it. A map that is locally one-to-one on a disc and one-to-one on its rim is one-to-one on the disc. Hence,
for this family, **the determinant is positive on a disc if and only if the map is one-to-one there**, and the
fold is the first radius at which, in some direction, the determinant

    r·det = (A' + 6r q·e + S'·e)(A + 2r² q·e) − 2r² q·e⊥ (2r q·e⊥ + S'·e⊥)

is no longer positive. On every circle it is a trigonometric polynomial of degree two in the direction.

* Radial (q = S = 0): the first zero of A', or of D: roots of polynomials in r².
* Tangential (S = 0): the determinant is quadratic in q·e, and its minimum lies at q·e = −|q| or at the vertex
  of the parabola; setting either to zero gives a polynomial in r.
* With a prism, or a tilted sensor whose horizon comes into view: a search, described at :func:`_searched`.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.polynomial import polynomial as poly

from calibrary.distortion.base import FloatArray
from calibrary.distortion.polynomial import PolynomialMap
from calibrary.distortion.roots import first_positive_root, positive_roots

__all__ = ["fold_radius"]

SCAN = np.concatenate(
    [np.tan(np.linspace(0.0, 0.5 * math.pi, 512, endpoint=False)[1:]), np.logspace(3, 9, 73)]
)
"""Radii of the search in units of the map's own length; a fold beyond a thousand million of them counts as none."""

DIRECTIONS = np.linspace(0.0, 2.0 * math.pi, 32, endpoint=False)
SAMPLES = DIRECTIONS[::4]
"""Eight samples on a circle hold a trigonometric polynomial of degree two (of three, even) completely."""

HARMONICS = np.stack(
    [np.ones(32), np.cos(DIRECTIONS), -np.sin(DIRECTIONS), np.cos(2 * DIRECTIONS), -np.sin(2 * DIRECTIONS)]
)


def fold_radius(lens: PolynomialMap, horizon: tuple[float, float] = (0.0, 0.0)) -> float:
    """The radius of the largest disc around the axis on which the map is one-to-one; ``inf`` if it always is.

    Args:
        lens: the map.
        horizon: (h1, h2) such that a tilted sensor sees the image point (u, v) only while 1 + h1·u + h2·v > 0.
    """
    octave = lens.octave
    steepness = math.hypot(*horizon)
    if steepness:
        octave = min(octave, math.floor(-math.log2(steepness)) - 1)
    unit = lens.in_octave(octave)
    pole = math.sqrt(first_positive_root(unit.denominator))
    if unit.has_prism or steepness:
        radius = _searched(unit, (math.ldexp(horizon[0], octave), math.ldexp(horizon[1], octave)), pole)
    elif unit.is_radial:
        radius = math.sqrt(first_positive_root(_radial_slope(unit)))
    else:
        radius = _tangential(unit)
    try:
        return math.ldexp(min(radius, pole), octave)
    except OverflowError:
        return math.inf


def _radial_slope(lens: PolynomialMap) -> FloatArray:
    """The numerator of A' = M/D², a polynomial in r²: M = D(N + 2sN') − 2sND'."""
    top, bottom = np.array(lens.numerator), np.array(lens.denominator)
    growing = poly.polyadd(top, poly.polymulx(2.0 * poly.polyder(top)))
    fading = poly.polymulx(2.0 * poly.polyder(bottom))
    return np.asarray(poly.polysub(poly.polymul(bottom, growing), poly.polymul(top, fading)))


def _tangential(lens: PolynomialMap) -> float:
    """The fold with tangential terms, in closed form.

    With c = q·e and q = |q|, r·det = (A' + 6rc)(A + 2r²c) − 4r³(q² − c²) is a parabola in c, open upwards. At
    c = −q it is (A' − 6rq)(A − 2r²q). Its vertex, c = −(3A + rA')/16r², counts while it lies right of −q; there
    16r²·det = −(rA' − A)(rA' − 9A) − 64r⁴q². All times powers of D, to be polynomials.
    """
    q = math.hypot(lens.p1, lens.p2)
    N, D, M = (_in_radius(p) for p in (lens.numerator, lens.denominator, _radial_slope(lens)))
    D2, ND = poly.polymul(D, D), poly.polymul(N, D)
    fold = first_positive_root(poly.polysub(M, poly.polymul([0.0, 6.0 * q], D2)))
    loop = first_positive_root(poly.polysub(N, poly.polymul([0.0, 2.0 * q], D)))
    at_vertex = poly.polyadd(
        poly.polymul(poly.polysub(M, ND), poly.polysub(M, 9.0 * ND)),
        poly.polymul([0.0, 0.0, 64.0 * q * q], poly.polymul(D2, D2)),
    )
    vertex_counts = poly.polysub(poly.polymul([0.0, 16.0 * q], D2), poly.polyadd(3.0 * ND, M))
    vertices = (r for r in positive_roots(at_vertex) if poly.polyval(r, vertex_counts) >= 0)
    return min(fold, loop, next(vertices, math.inf))


def _in_radius(in_square: list[float] | FloatArray) -> FloatArray:
    """A polynomial in r² as one in r."""
    spread = np.zeros(2 * len(in_square) - 1)
    spread[::2] = in_square
    return spread


def _searched(lens: PolynomialMap, horizon: tuple[float, float], pole: float) -> float:
    """The fold by search: the first radius at which the least margin over all directions is not positive.

    For every radius the least margin is exact, not sampled, see :func:`_least_over_directions`. Over the radii
    it is scanned in steps of 0.18° of ``atan(r / length)``, and every local minimum of the scan is followed
    down, so that a dip that is shorter than a step is found as well. The bracket is then narrowed to machine
    precision and its inner end returned.
    """

    def margin(radii: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            return _least_margin(lens, horizon, radii)

    radii = SCAN[pole > SCAN]
    if math.isfinite(pole):
        radii = np.append(radii, pole * (1.0 - np.logspace(-2, -12, 11)))
        radii.sort()
    margins = margin(radii)
    radii, margins = np.append(0.0, radii), np.append(1.0, margins)
    failed = np.append(np.flatnonzero(~(margins > 0)), len(radii))[0]
    dips = 1 + np.flatnonzero((margins[:-2] >= margins[1:-1]) & (margins[1:-1] < margins[2:]))
    for i in dips[dips < failed - 1]:
        lowest = _followed_down(margin, radii[i - 1], radii[i + 1])
        if not margin(np.array([lowest]))[0] > 0:
            return _narrowed(margin, radii[i - 1], lowest)
    return _narrowed(margin, radii[failed - 1], radii[failed]) if failed < len(radii) else math.inf


def _least_margin(lens: PolynomialMap, horizon: tuple[float, float], radii: FloatArray) -> FloatArray:
    """The least determinant on each circle, or the least height over a tilted sensor's horizon if that is less."""
    x, y = radii[:, None] * np.cos(SAMPLES), radii[:, None] * np.sin(SAMPLES)
    u, v, (ux, uy, vx, vy) = lens.image_and_jacobian(x, y)
    least = _least_over_directions(ux * vy - uy * vx)
    if any(horizon):
        height = 1.0 + horizon[0] * u + horizon[1] * v
        least = np.minimum(least, _least_over_directions(height))
    return least


def _least_over_directions(samples: FloatArray) -> FloatArray:
    """Per row, the least value of the trigonometric polynomial of degree two through eight samples of a circle.

    Such a polynomial has two minima at most. Both are taken from a finer sampling and polished by Newton's
    method; the sampled values stand in where that goes astray.
    """
    mean, first, second = np.fft.rfft(samples, axis=1).T[:3] / len(SAMPLES)
    terms = np.stack([mean.real, 2 * first.real, 2 * first.imag, 2 * second.real, 2 * second.imag], axis=1)
    values = terms @ HARMONICS
    is_minimum = (values <= np.roll(values, 1, axis=1)) & (values <= np.roll(values, -1, axis=1))
    two = np.argpartition(np.where(is_minimum, values, np.inf), 1, axis=1)[:, :2]
    angle = DIRECTIONS[two]
    c, a1, b1, a2, b2 = terms.T[:, :, None]
    for _ in range(4):
        cos1, sin1, cos2, sin2 = np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)
        slope = -a1 * sin1 - b1 * cos1 - 2 * a2 * sin2 - 2 * b2 * cos2
        bend = -a1 * cos1 + b1 * sin1 - 4 * a2 * cos2 + 4 * b2 * sin2
        angle = angle - np.divide(slope, bend, out=np.zeros_like(slope), where=bend > 0)
    polished = c + a1 * np.cos(angle) - b1 * np.sin(angle) + a2 * np.cos(2 * angle) - b2 * np.sin(2 * angle)
    return np.asarray(np.minimum(values.min(axis=1), polished.min(axis=1)))


def _narrowed(margin: Callable[[FloatArray], FloatArray], inner: float, outer: float) -> float:
    """The inner end of a bracket [positive margin, not positive], narrowed sixteenfold a round."""
    for _ in range(14):
        radii = np.linspace(inner, outer, 17)
        folded = ~(margin(radii[1:]) > 0)
        first = int(folded.argmax()) if folded.any() else 15
        inner, outer = float(radii[first]), float(radii[first + 1])
    return inner


def _followed_down(margin: Callable[[FloatArray], FloatArray], inner: float, outer: float) -> float:
    """Where between two radii the margin is least (the first place where it is not positive, if it is there)."""
    for _ in range(8):
        radii = np.linspace(inner, outer, 17)
        margins = margin(radii)
        lowest = int((~(margins > 0)).argmax()) or int(margins.argmin())
        if not margins[lowest] > 0:
            return float(radii[lowest])
        inner, outer = float(radii[max(lowest - 1, 0)]), float(radii[min(lowest + 1, 16)])
    return float(radii[lowest])
