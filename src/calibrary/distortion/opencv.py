"""OpenCV's perspective models: one map with 5, 8, 12 or 14 coefficients, and where it is one-to-one.

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
from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache
from typing import ClassVar

from msgspec import Struct

from calibrary.arrays import FloatArray, NDArray, np, poly
from calibrary.distortion.base import (
    Columns,
    Distortion,
    as_rows,
    blocks,
    by_columns,
    finite_pair,
    perspective,
    unit_ray,
)
from calibrary.distortion.polynomial import Inversion, PolynomialMap, first_positive_root, solved
from calibrary.errors import InputError
from calibrary.kernel import Form


@cache
def _scan() -> FloatArray:
    """Return radii of the search in the map's unit of length: 0.03 apart up to 1, 3 % apart beyond, up to a million."""
    return np.sinh(np.linspace(0.0, math.asinh(1e6), 500)[1:])


CERTAIN = 1e-6
"""Relative margin of the quick test, far above rounding errors; cases closer to the limit need the exact test."""

GUESSES = 12
SMALLEST_GAIN = 0.05
"""Smallest ratio of image radius to disc radius of a guess; smaller ones are beyond the limit of any lens."""


@cache
def _samples() -> FloatArray:
    """Return eight directions on a circle, which determine a trigonometric polynomial of degree two (even three)."""
    return np.linspace(0.0, 2.0 * math.pi, 8, endpoint=False)


class OpenCVDistortion(Distortion):
    """A model with OpenCV's coefficients k, p, s (and τ), or a subset of them."""

    def _lens(self) -> PolynomialMap:
        """Map of the lens, before the tilt of the sensor."""
        return PolynomialMap(**self.coefficients)

    def _sensor(self) -> FloatArray | None:
        """(3, 3) homography from the image on an untilted sensor to the tilted one; None if there is no tilt."""
        return None

    def valid_radius(self) -> float:
        """Radius at which the map stops being one-to-one or the horizon of a tilted sensor comes into view."""
        return _prepared(self).radius

    def form(self) -> Form | None:
        """See :meth:`Distortion.form`; None if the sensor is tilted."""
        ready = _prepared(self)
        return ready.lens.form(ready.radius) if ready.sensor is None else None

    def distort(self, xy: FloatArray) -> FloatArray:
        """Undistorted to distorted; NaN from :meth:`valid_radius` on."""
        ready = _prepared(self)
        lens, sensor, square = ready.lens, ready.sensor, ready.radius * ready.radius

        def image(x: FloatArray, y: FloatArray) -> Columns:
            u, v = lens.image(x, y)
            if sensor is not None:
                u, v = _through(sensor, u, v)
            u[~(x * x + y * y < square)] = np.nan
            return finite_pair(u, v)

        return by_columns(image, xy, 2, 2)

    def distort_unlimited(self, rays: FloatArray) -> FloatArray:
        """The formula alone; NaN only for what is behind the camera or beyond a tilted sensor's horizon."""
        return self._image_unlimited(perspective(rays))

    def _image_unlimited(self, xy: FloatArray) -> FloatArray:
        lens, sensor = self._lens(), self._sensor()

        def image(x: FloatArray, y: FloatArray) -> Columns:
            u, v = lens.image(x, y)
            return finite_pair(*((u, v) if sensor is None else _through(sensor, u, v)))

        return by_columns(image, xy, 2, 2)

    def undistort(self, xy: FloatArray) -> FloatArray:
        """Distorted to undistorted, to machine precision; NaN without a solution inside :meth:`valid_radius`."""
        xy = as_rows(xy, 2)
        out = np.empty_like(xy)
        ready = _prepared(self)
        upright = ready.upright

        def image(rows: slice | NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
            u, v = xy[rows].T.copy()
            return (u, v) if upright is None else _through(upright, u, v)

        with np.errstate(all="ignore"):
            inverse = Inversion.of(ready.lens, ready.radius, 2.0 * _largest(xy))
            hard = [np.empty(0, dtype=np.intp)]
            for rows in blocks(len(xy)):
                out[rows, 0], out[rows, 1], missed = inverse.swift(*image(rows))
                hard.append(rows.start + missed)
            # Collected over all blocks: a few points take as long as a whole block.
            left = np.concatenate(hard)
            for part in blocks(len(left)):
                out[left[part], 0], out[left[part], 1] = inverse.patient(*image(left[part]))
        return out

    def distort_ray(self, x: float, y: float, z: float, /) -> tuple[float, float] | None:
        """One direction; None if the sensor is tilted or the point is beyond the limit."""
        ready = _prepared(self)
        if not z > 0 or ready.sensor is not None:
            return None
        x, y = x / z, y / z
        if not x * x + y * y < ready.radius * ready.radius:
            return None
        try:
            u, v = ready.lens.image(x, y)
        except ArithmeticError:
            return None
        return (u, v) if math.isfinite(u) and math.isfinite(v) else None

    def undistort_to_ray(self, x: float, y: float, /) -> tuple[float, float, float] | None:
        """One point; None if the sensor is tilted or the point is close to or beyond the limit."""
        ready = _prepared(self)
        found = solved(ready.lens, x, y, ready.radius) if ready.sensor is None else None
        return unit_ray(*found) if found is not None else None


class BrownConrady(OpenCVDistortion):
    """OpenCV's four and five coefficients, ROS ``plumb_bob``, COLMAP ``OPENCV``.

    With r² = x² + y²::

        x' = x·(1 + k1·r² + k2·r⁴ + k3·r⁶) + 2·p1·x·y + p2·(r² + 2x²)
        y' = y·(1 + k1·r² + k2·r⁴ + k3·r⁶) + p1·(r² + 2y²) + 2·p2·x·y

    Source: D. C. Brown, "Close-range camera calibration", 1971, in the form and order of OpenCV. DJI's DewarpData
    has this order too; Metashape swaps p1 and p2, and OpenSfM and Pix4D put k3 before p1.
    """

    model: ClassVar[str] = "brown"
    example: ClassVar[Mapping[str, float]] = {"k1": -0.28, "k2": 0.06, "p1": 0.01, "p2": 0.02}

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float = 0.0

    def covers(self, radius: float) -> bool:
        """See :meth:`Distortion.covers`; takes microseconds, because the check of a registry tests all entries."""
        return covers((self.k1, self.k2, self.k3), math.hypot(self.p1, self.p2), radius)


class Rational(OpenCVDistortion):
    """OpenCV's eight coefficients, ROS ``rational_polynomial``, COLMAP ``FULL_OPENCV``.

    With r² = x² + y² and L = (1 + k1·r² + k2·r⁴ + k3·r⁶) / (1 + k4·r² + k5·r⁴ + k6·r⁶)::

        x' = x·L + 2·p1·x·y + p2·(r² + 2x²)
        y' = y·L + p1·(r² + 2y²) + 2·p2·x·y

    Source: OpenCV, CALIB_RATIONAL_MODEL. Its k4 is in the denominator; the k4 of Metashape multiplies r⁸ instead.
    """

    model: ClassVar[str] = "rational"
    example: ClassVar[Mapping[str, float]] = {"k1": 0.5, "k2": 0.05, "k4": 0.85, "k5": 0.15, "p2": 0.01}

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float
    k4: float
    k5: float
    k6: float


class ThinPrism(OpenCVDistortion):
    """OpenCV's twelve coefficients.

    With r² = x² + y² and L = (1 + k1·r² + k2·r⁴ + k3·r⁶) / (1 + k4·r² + k5·r⁴ + k6·r⁶)::

        x' = x·L + 2·p1·x·y + p2·(r² + 2x²) + s1·r² + s2·r⁴
        y' = y·L + p1·(r² + 2y²) + 2·p2·x·y + s3·r² + s4·r⁴

    Source: OpenCV, CALIB_THIN_PRISM_MODEL, after J. Weng, P. Cohen and M. Herniou, "Camera calibration with
    distortion models and accuracy evaluation", 1992.
    """

    model: ClassVar[str] = "thin-prism"
    example: ClassVar[Mapping[str, float]] = {"k1": -0.16, "s1": 0.06, "s3": 0.04}

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float
    k4: float
    k5: float
    k6: float
    s1: float
    s2: float
    s3: float
    s4: float


class Tilted(OpenCVDistortion):
    """OpenCV's fourteen coefficients; τx and τy in radians.

    The result (x', y', 1) of :class:`~calibrary.distortion.ThinPrism` is multiplied by the homography::

        ⎡R33  0  −R13⎤                              ⎡cos τy  0  −sin τy⎤   ⎡1     0       0  ⎤
        ⎢ 0  R33 −R23⎥ · R        where R(τx, τy) = ⎢  0     1     0   ⎥ · ⎢0   cos τx  sin τx⎥
        ⎣ 0   0    1 ⎦                              ⎣sin τy  0   cos τy⎦   ⎣0  −sin τx  cos τx⎦

    Source: OpenCV, CALIB_TILTED_MODEL, after T. Louhichi et al., "A model of Scheimpflug camera for mobile
    mapping", 2007.

    Raises:
        InputError: a coefficient is not finite, or the sensor is tilted by 90° or more.
    """

    model: ClassVar[str] = "tilted"
    example: ClassVar[Mapping[str, float]] = {"k1": -0.12, "tau_x": 0.08, "tau_y": 0.12}

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float
    k4: float
    k5: float
    k6: float
    s1: float
    s2: float
    s3: float
    s4: float
    tau_x: float
    tau_y: float

    def __post_init__(self) -> None:
        Distortion.__post_init__(self)
        for name in ("tau_x", "tau_y"):
            if abs(getattr(self, name)) >= math.pi / 2:
                raise InputError(
                    f"{name} is {getattr(self, name):g} rad, expected a tilt below 90° (1.5708 rad): "
                    "beyond it the sensor looks away from the lens; is it in degrees?",
                    place=name,
                )

    def _lens(self) -> PolynomialMap:
        """Map of the lens, before the tilt of the sensor."""
        return PolynomialMap(
            **{name: value for name, value in self.coefficients.items() if not name.startswith("tau")}
        )

    def _sensor(self) -> FloatArray | None:
        """(3, 3) homography from the image on an untilted sensor to the tilted one; None if there is no tilt."""
        if not (self.tau_x or self.tau_y):
            return None
        cx, sx = math.cos(self.tau_x), math.sin(self.tau_x)
        cy, sy = math.cos(self.tau_y), math.sin(self.tau_y)
        R = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]) @ np.array(
            [[1, 0, 0], [0, cx, sx], [0, -sx, cx]]
        )
        to_sensor = np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]])
        return np.asarray(to_sensor @ R)


class _Prepared(Struct, frozen=True):
    """Precomputed data of a model.

    Attributes:
        lens: map of the lens, before the tilt of the sensor.
        sensor: (3, 3) homography from the untilted image to the tilted sensor; None if there is no tilt.
        upright: inverse of ``sensor``.
        radius: :meth:`Distortion.valid_radius`.
    """

    lens: PolynomialMap
    sensor: FloatArray | None
    upright: FloatArray | None
    radius: float


@lru_cache(maxsize=256)
def _prepared(model: OpenCVDistortion) -> _Prepared:
    """Prepare a model; cached, because this takes longer than a single point."""
    lens, sensor = model._lens(), model._sensor()
    with np.errstate(all="ignore"):
        if sensor is None:
            return _Prepared(lens, None, None, monotonic_radius(lens))
        h1, h2, h0 = sensor[2]
        radius = monotonic_radius(lens, (h1 / h0, h2 / h0))
    return _Prepared(lens, sensor, np.asarray(np.linalg.inv(sensor)), radius)


def _largest(xy: FloatArray) -> float:
    """Return the largest finite absolute coordinate, which determines the extent of the table."""
    sizes = (np.abs(xy[rows]) for rows in blocks(len(xy)))
    return max((float(np.max(size, initial=0.0, where=np.isfinite(size))) for size in sizes), default=0.0)


def _through(homography: FloatArray, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Map points by a homography; NaN for points beyond its horizon."""
    H = homography
    depth = H[2, 0] * u + H[2, 1] * v + H[2, 2]
    depth[~(depth > 0)] = np.nan
    return (H[0, 0] * u + H[0, 1] * v + H[0, 2]) / depth, (H[1, 0] * u + H[1, 1] * v + H[1, 2]) / depth


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

    radii = _scan()[pole > _scan()]
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
    along = _samples()
    x, y = radii[:, None] * np.cos(along), radii[:, None] * np.sin(along)
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
    mean, f, g = np.fft.rfft(samples[usable], axis=1).T[:3] / len(_samples())
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
