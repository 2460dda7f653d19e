"""Limit of the valid field of view: the radius up to which a perspective model is one-to-one.

On the circle of radius r, with A = r·N/D, q = (p2, p1) and S = r²(s1, s3) + r⁴(s2, s4), the image of the point r·e (e a
unit vector) is ``(A + 2r² q·e) e + r² q + S``. The image of a circle is therefore a shifted limaçon. It is a simple
curve while A > 2r²|q|; at the first radius where this fails, its tangent vanishes, and so does the Jacobian
determinant. A map that is locally one-to-one on a disc and one-to-one on its rim is one-to-one on the disc. So, for
this family, **the determinant is positive on a disc if and only if the map is one-to-one there**. The limit is the
first radius at which, in some direction, the determinant

    r·det = (A' + 6r q·e + S'·e)(A + 2r² q·e) − 2r² q·e⊥ (2r q·e⊥ + S'·e⊥)

is not positive. On every circle it is a trigonometric polynomial of degree two in the direction.

* Radial (q = S = 0): the first zero of A' or D, which are polynomials in r².
* Tangential (S = 0): the determinant is smallest in the direction −q, where it is a product of two polynomials in r.
* With a prism, or if the horizon of a tilted sensor comes into view: a search, see :func:`_searched`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numpy.polynomial import polynomial as poly

from calibrary.arrays import FloatArray
from calibrary.distortion.polynomial import PolynomialMap
from calibrary.distortion.roots import first_positive_root

__all__ = ["covers", "monotonic_radius"]

SCAN = np.sinh(np.linspace(0.0, math.asinh(1e6), 500)[1:])
"""Radii of the search in the map's unit of length: 0.03 apart up to 1, 3 % apart beyond, up to a million."""

CERTAIN = 1e-6
"""Relative margin of the quick test, far above rounding errors; cases closer to the limit need the exact test."""

GUESSES = 12
SMALLEST_GAIN = 0.05
"""Smallest ratio of image radius to disc radius of a guess; smaller ones are beyond the limit of any lens."""

SAMPLES = np.linspace(0.0, 2.0 * math.pi, 8, endpoint=False)
"""Directions of eight samples on a circle, which determine a trigonometric polynomial of degree two (even three)."""


@lru_cache(maxsize=256)
def monotonic_radius(lens: PolynomialMap, horizon: tuple[float, float] = (0.0, 0.0)) -> float:
    """Return the radius of the largest disc around the axis on which the map is one-to-one; ``inf`` if unlimited.

    Args:
        lens: map from undistorted to distorted.
        horizon: (h1, h2); the image point (u, v) is on a tilted sensor only if 1 + h1·u + h2·v > 0.
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
        radius = _tangential(unit, pole)
    try:
        return math.ldexp(min(radius, pole), octave)
    except OverflowError:
        return math.inf


def covers(radial: Sequence[float], tangential: float, radius: float) -> bool:
    """Test if a map without denominator is one-to-one on a disc whose image contains the disc of ``radius``.

    True is certain, False is not; the test needs neither roots nor an inverse. It guesses a disc of radius R, whose
    image contains the disc of radius A(R) − 3R²q, a lower bound for the distance of the image of its rim. The map is
    one-to-one on the disc if A' − 6rq and 3A/r + A' − 16rq are positive, see :func:`_tangential`. With r replaced by R
    in the tangential terms, both are polynomials in r², which are positive if all their Bernstein coefficients are.

    Args:
        radial: k1, k2, k3, …
        tangential: q, the length of (p1, p2).
        radius: radius in the distorted image, from the centre of distortion.
    """
    powers = (1.0, *radial)
    wanted = reach = radius * (1.0 + CERTAIN)
    for _ in range(GUESSES):
        square, gain = reach * reach, 0.0
        for k in reversed(powers):
            gain = gain * square + k
        gain -= 3.0 * tangential * reach
        if gain * reach >= wanted:
            break
        if not gain > SMALLEST_GAIN:
            return False
        reach = (1.0 + CERTAIN) * wanted / gain
    else:
        return False
    slope = [(2 * power + 1) * k for power, k in enumerate(powers)]
    vertex = [(2 * power + 4) * k for power, k in enumerate(powers)]
    slope[0] -= 6.0 * tangential * reach
    vertex[0] -= 16.0 * tangential * reach
    return _is_positive(slope, square) and _is_positive(vertex, square)


def _is_positive(coefficients: Sequence[float], end: float) -> bool:
    """Test if a polynomial, constant term first, is positive from 0 to ``end``; True is certain, False is not."""
    degree = len(coefficients) - 1
    scaled, power = [], 1.0
    for at, c in enumerate(coefficients):
        scaled.append(c * power / math.comb(degree, at))
        power *= end
    return all(
        sum(math.comb(last, at) * scaled[at] for at in range(last + 1)) > CERTAIN
        for last in range(degree + 1)
    )


def _radial_slope(lens: PolynomialMap) -> FloatArray:
    """Return M, the numerator of A' = M/D², as a polynomial in s = r²: M = D(N + 2sN') − 2sND'."""
    top, bottom = np.array(lens.numerator), np.array(lens.denominator)
    growing = poly.polyadd(top, poly.polymulx(2.0 * poly.polyder(top)))
    fading = poly.polymulx(2.0 * poly.polyder(bottom))
    return np.asarray(poly.polysub(poly.polymul(bottom, growing), poly.polymul(top, fading)))


def _tangential(lens: PolynomialMap, pole: float) -> float:
    """Return the limit with tangential terms, in closed form.

    With c = q·e and q = |q|, r·det = (A' + 6rc)(A + 2r²c) − 4r³(q² − c²) is a parabola in c, open upwards. At c = −q it
    is (A' − 6rq)(A − 2r²q). While the first factor is positive, so is the second, because by integration it is at least
    r²q. The limit is therefore the first zero of A' − 6rq. The vertex of the parabola is at c > −q only if
    3A + rA' < 16r²q. Lenses reach their limit before that; if one does not, the search decides.
    """
    q = math.hypot(lens.p1, lens.p2)
    N, D, M = (_in_radius(p) for p in (lens.numerator, lens.denominator, _radial_slope(lens)))
    D2, ND = poly.polymul(D, D), poly.polymul(N, D)
    limit = first_positive_root(poly.polysub(M, poly.polymul([0.0, 6.0 * q], D2)))
    vertex = first_positive_root(poly.polysub(poly.polyadd(3.0 * ND, M), poly.polymul([0.0, 16.0 * q], D2)))
    return limit if min(limit, pole) <= vertex else _searched(lens, (0.0, 0.0), pole)


def _in_radius(in_square: list[float] | FloatArray) -> FloatArray:
    """Convert the coefficients of a polynomial in r² to those of one in r."""
    spread = np.zeros(2 * len(in_square) - 1)
    spread[::2] = in_square
    return spread


def _searched(lens: PolynomialMap, horizon: tuple[float, float], pole: float) -> float:
    """Search for the limit: the first radius at which the smallest margin over all directions is not positive.

    At each radius the smallest margin is exact, not sampled, see :func:`_least_over_directions`. The radii are scanned
    in steps of 3 % of the lens's unit of length or of the radius, whichever is larger. Each local minimum of the scan
    is refined, so that dips shorter than a step are found as well. The bracket is then narrowed to machine precision;
    the result is its inner end.
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
    """Return the smallest determinant on each circle, or the smallest distance from the sensor's horizon if less."""
    x, y = radii[:, None] * np.cos(SAMPLES), radii[:, None] * np.sin(SAMPLES)
    u, v, (ux, uy, vx, vy) = lens.image_and_jacobian(x, y)
    least = _least_over_directions(ux * vy - uy * vx)
    if any(horizon):
        height = 1.0 + horizon[0] * u + horizon[1] * v
        least = np.minimum(least, _least_over_directions(height))
    return least


def _least_over_directions(samples: FloatArray) -> FloatArray:
    """Return, per row, the minimum of the trigonometric polynomial of degree two through eight samples of a circle.

    With z = exp(iθ), c + 2·Re(f·z + g·z²) is stationary where 2g·z⁴ + f·z³ − f*·z − 2g* = 0, so the minimum is at one
    of four angles. NaN if a sample is not finite.
    """
    least = np.full(len(samples), math.nan)
    usable = np.isfinite(samples).all(axis=1)
    mean, f, g = np.fft.rfft(samples[usable], axis=1).T[:3] / len(SAMPLES)
    # Only the ratio of f and g affects the angles; both are negligible if tiny relative to the mean.
    size = np.maximum(np.maximum(np.abs(f), np.abs(g)), 1e-30 * np.abs(mean) + 1e-300)
    f, g = f / size, g / size
    # Without a second harmonic two of the roots are infinite; 1e-12 keeps them finite.
    lead = 2.0 * np.where(np.abs(g) > 1e-12, g, 1e-12)
    companion = np.zeros((len(lead), 4, 4), dtype=np.complex128)
    companion[:, (1, 2, 3), (0, 1, 2)] = 1.0
    companion[:, :, 3] = np.stack([2.0 * g.conj(), f.conj(), np.zeros_like(f), -f], axis=1) / lead[:, None]
    z = np.exp(1j * np.angle(np.linalg.eigvals(companion)))
    waves = (f[:, None] * z + g[:, None] * z * z).real
    stationary = mean.real[:, None] + 2.0 * size[:, None] * waves
    least[usable] = stationary.min(axis=1)
    return least


def _narrowed(margin: Callable[[FloatArray], FloatArray], inner: float, outer: float) -> float:
    """Return the inner end of a bracket [positive margin, not positive], narrowed 16-fold in each round."""
    for _ in range(14):
        radii = np.linspace(inner, outer, 17)
        failed = ~(margin(radii[1:]) > 0)
        first = int(failed.argmax()) if failed.any() else 15
        inner, outer = float(radii[first]), float(radii[first + 1])
    return inner


def _followed_down(margin: Callable[[FloatArray], FloatArray], inner: float, outer: float) -> float:
    """Return the radius of the smallest margin between two radii, or the first radius where it is not positive."""
    for _ in range(8):
        radii = np.linspace(inner, outer, 17)
        margins = margin(radii)
        lowest = int((~(margins > 0)).argmax()) or int(margins.argmin())
        if not margins[lowest] > 0:
            return float(radii[lowest])
        inner, outer = float(radii[max(lowest - 1, 0)]), float(radii[min(lowest + 1, 16)])
    return float(radii[lowest])
