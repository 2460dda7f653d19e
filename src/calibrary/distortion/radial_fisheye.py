"""Fisheye models with an image radius that depends only on the angle from the axis, and their tables."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from functools import cache, lru_cache, partial
from typing import ClassVar, Self, TypeAlias

from msgspec import Struct

from calibrary.arrays import FloatArray, NDArray, np
from calibrary.distortion.base import Columns, Distortion, by_columns, finite_pair
from calibrary.distortion.omnidirectional import Omnidirectional
from calibrary.distortion.polynomial import Number, Rising, first_positive_root, inverse_of_rising
from calibrary.kernel import Form, Front

TABLE_NODES = 16_384

RAY_CELLS = 2048
"""Number of cells in a table of rays; the cubics' errors are below rounding, except next to a limit."""

TABULATED_RAD = 2.0
"""Largest tabulated angle from the axis, beyond the field of view of real lenses; larger angles are solved for."""

ROUNDING = 2e-15
"""Largest difference between a tabulated ray and the result of Newton's method."""

Numbers: TypeAlias = "FloatArray | NDArray[np.complex128]"


@cache
def _nodes() -> tuple[FloatArray, FloatArray]:
    """Return the (4,) Chebyshev nodes of a cell from 0 to 1, and the (4, 4) matrix from values there to powers.

    They include both ends: the table is exact at the ends, hence at 0.
    """
    nodes = 0.5 - 0.5 * np.cos(math.pi * np.arange(4) / 3)
    return nodes, np.asarray(np.linalg.inv(np.vander(nodes)), dtype=np.float64)


class Cubics(Struct, frozen=True):
    """Table of several smooth functions of one argument ≥ 0 as piecewise cubics, a dozen array operations to evaluate.

    An operation on a short array costs about 0.5 µs regardless of its length, and Newton's method needs a hundred.

    Attributes:
        reach: end of the table.
        per_unit: number of cells per unit of the argument.
        coefficients: (4, functions, cells), highest power first.
    """

    reach: float
    per_unit: float
    coefficients: Numbers

    @classmethod
    def of(cls, functions: Callable[[FloatArray], Numbers], reach: float, cells: int) -> Self:
        """Tabulate ``functions``, which returns the (M, N) values of all M functions at N arguments."""
        nodes, to_powers = _nodes()
        starts = np.arange(cells) * (reach / cells)
        values = functions((starts + nodes[:, None] * (reach / cells)).ravel())
        values = values.reshape(len(values), 4, cells)
        # The fit is to differences within a cell: these are small, and so are the rounding errors of the coefficients.
        fitted = np.einsum("pn,mnc->pmc", to_powers, values - values[:, :1])
        fitted[3] += values[:, 0]
        return cls(reach, cells / reach, fitted)

    def at(self, argument: FloatArray) -> Numbers:
        """Return the (M, N) values of all functions at N arguments, 0 ≤ argument < :attr:`reach`."""
        within = argument * self.per_unit
        cell = within.astype(np.intp)
        within -= cell
        found = self.coefficients.take(cell, axis=2, mode="clip")
        value: Numbers = found[0]
        for power in (1, 2, 3):
            value *= within
            value += found[power]
        return value

    def holding(self, functions: Callable[[FloatArray], Numbers], tolerance: float) -> Self:
        """Return the table up to the first cell with an error above ``tolerance``, tested at 0.1 and 0.5 of a cell."""
        if not self.reach > 0:
            return self
        cells = self.coefficients.shape[2]
        at = (np.repeat(np.arange(cells), 2) + np.tile([0.1, 0.5], cells)) / self.per_unit
        wrong = ~(np.abs(self.at(at) - functions(at)) <= tolerance).all(axis=0)
        held = int(wrong.argmax()) // 2 if wrong.any() else cells
        return type(self)(held / self.per_unit, self.per_unit, self.coefficients)


class RadialFisheye(Omnidirectional):
    """A model with the image radius θd(θ) for a ray at the angle θ from the axis; θd increases up to a limit."""

    @abstractmethod
    def _image(self, theta: Number) -> Number:
        """θd(θ)."""

    @abstractmethod
    def _slope(self, theta: Number) -> Number:
        """dθd/dθ."""

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""
        return by_columns(partial(self._distorted, _prepared(self).limit), rays, 3, 2)

    def distort(self, xy: FloatArray) -> FloatArray:
        """Undistorted (x/z, y/z), less than 90° from the axis, to distorted; NaN from :meth:`valid_radius` on."""
        limit = _prepared(self).limit
        return by_columns(lambda x, y: self._distorted(limit, x, y, np.ones_like(x)), xy, 2, 2)

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN from the image of :meth:`max_angle_rad` on."""
        rays = _rays(self)

        def direction(x: FloatArray, y: FloatArray) -> Columns:
            square = x * x
            square += y * y
            inside = square < rays.reach
            if np.count_nonzero(inside) == len(square):
                stretch, depth = rays.at(square)
            else:
                stretch, depth = rays.at(np.where(inside, square, 0.0))
                far = np.flatnonzero(~inside)
                stretch[far], depth[far] = self._stretch_and_depth(square[far])
            return x * stretch, y * stretch, depth

        return by_columns(direction, xy, 2, 3)

    def undistort(self, xy: FloatArray) -> FloatArray:
        """Distorted to undistorted (x/z, y/z); NaN if the ray is 90° or more from the axis or does not exist."""
        ready = _prepared(self)

        def undistorted(x: FloatArray, y: FloatArray) -> Columns:
            theta, rho = self._polar(x, y, ready)
            theta[theta >= math.pi / 2] = math.nan
            stretch = np.tan(theta) / rho
            return x * stretch, y * stretch

        return by_columns(undistorted, xy, 2, 2)

    def distort_ray(self, x: float, y: float, z: float, /) -> tuple[float, float] | None:
        """One direction; None on the axis and from the limit on."""
        r = math.hypot(x, y)
        theta = math.atan2(r, z)
        if not r > 0 or not theta < _prepared(self).limit:
            return None
        stretch = self._image(theta) / r
        u, v = x * stretch, y * stretch
        return (u, v) if math.isfinite(u) and math.isfinite(v) else None

    def undistort_to_ray(self, x: float, y: float, /) -> tuple[float, float, float] | None:
        """One point; None outside the table of rays."""
        rays = _rays(self)
        square = x * x + y * y
        if not square < rays.reach:
            return None
        within = square * rays.per_unit
        cell = int(within)
        within -= cell
        (a, d), (b, e), (c, f), (g, h) = rays.coefficients[:, :, cell].tolist()
        stretch = ((a * within + b) * within + c) * within + g
        return x * stretch, y * stretch, ((d * within + e) * within + f) * within + h

    def _distorted(self, limit: float, x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        r = np.hypot(x, y)
        theta = np.arctan2(r, z)
        stretch = self._image(theta) / r
        # The image of the axis is the principal point; the image of straight backwards would be a whole circle.
        if np.count_nonzero(r) < len(r):
            stretch[(r == 0) & (z > 0)] = 0.0
        np.copyto(stretch, math.nan, where=~(theta < limit))
        x *= stretch
        y *= stretch
        return finite_pair(x, y)

    def _polar(self, x: FloatArray, y: FloatArray, ready: _Prepared) -> tuple[FloatArray, FloatArray]:
        """Return θ of all distorted points and their distance from the axis, which is set to 1 on the axis itself."""
        rho = np.sqrt(x * x + y * y)
        theta = inverse_of_rising(rho, ready.table, self._miss_and_step)
        rho[rho == 0] = 1.0
        return theta, rho

    def _stretch_and_depth(self, square: FloatArray) -> FloatArray:
        """Return (2, N): the factor from the x, y of a distorted point to those of the unit ray, and the ray's z.

        Both are smooth functions of the point's squared distance from the axis, the argument of the table.
        """
        rho = np.sqrt(square)
        theta = inverse_of_rising(rho, _prepared(self).table, self._miss_and_step)
        rho[rho == 0] = 1.0
        stretch = np.sin(theta) / rho
        return np.stack([stretch, np.cos(theta)])

    def _miss_and_step(self, theta: FloatArray, rho: FloatArray) -> tuple[FloatArray, FloatArray]:
        miss = self._image(theta) - rho
        return miss, miss / self._slope(theta)


class _Prepared(Struct, frozen=True):
    """Precomputed data of a model.

    Attributes:
        limit: :meth:`Distortion.max_angle_rad`.
        table: image radius of the angles up to the limit.
    """

    limit: float
    table: Rising


@lru_cache(maxsize=64)
def _prepared(model: RadialFisheye) -> _Prepared:
    """Prepare a model; cached, because this takes longer than a single point."""
    limit = model.max_angle_rad()
    theta = np.linspace(0.0, limit, TABLE_NODES)
    with np.errstate(all="ignore"):
        return _Prepared(limit, Rising.of(theta, np.maximum.accumulate(model._image(theta))))


@lru_cache(maxsize=64)
def _rays(model: RadialFisheye) -> Cubics:
    """Tabulate the model's rays, up to the radius where the table is as exact as the solution."""
    ready = _prepared(model)
    with np.errstate(all="ignore"):
        rim = float(model._image(np.float64(min(0.999 * ready.limit, TABULATED_RAD))))
        if not 1e-100 < rim < min(ready.table.top, 1e100):
            return Cubics(0.0, 0.0, np.zeros((4, 2, 1)))

        def exact(square: FloatArray) -> FloatArray:
            # On the axis the factor is undefined; use its value close to the axis.
            return model._stretch_and_depth(np.maximum(square, 1e-20 * rim * rim))

        return Cubics.of(exact, rim * rim, RAY_CELLS).holding(exact, ROUNDING)


class KannalaBrandt(RadialFisheye):
    """OpenCV's fisheye model, COLMAP ``OPENCV_FISHEYE``, Kalibr ``equidistant``.

    With θ the angle between the ray (X, Y, Z) and the axis, and R² = X² + Y²::

        θ  = atan2(R, Z)
        θd = θ·(1 + k1·θ² + k2·θ⁴ + k3·θ⁶ + k4·θ⁸)
        x' = θd·X / R        y' = θd·Y / R

    Source: J. Kannala and S. Brandt, "A generic camera model and calibration method for conventional,
    wide-angle, and fish-eye lenses", 2006, in the form of ``cv2.fisheye``. OpenCV and COLMAP take θ as
    atan(R/Z) and stop at 90°. With atan2 the same coefficients continue to the limit of the valid field, or to the
    point behind the camera. :meth:`distort_rays` and :meth:`undistort_to_rays` cover all of it. :meth:`distort` and
    :meth:`undistort` cover only the part in front of the camera, because x/z and y/z express no other.
    """

    model: ClassVar[str] = "kannala-brandt"
    example: ClassVar[Mapping[str, float]] = {"k1": 0.02, "k2": -0.01}

    k1: float
    k2: float
    k3: float
    k4: float

    def max_angle_rad(self) -> float:
        """Angle at which θd stops growing, at most π."""
        slope_by_square = (1.0, 3.0 * self.k1, 5.0 * self.k2, 7.0 * self.k3, 9.0 * self.k4)
        return min(math.pi, math.sqrt(first_positive_root(slope_by_square)))

    def form(self) -> Form:
        """See :meth:`Distortion.form`."""
        return Form(Front.ANGLE, (self.k1, self.k2, self.k3, self.k4), limit=self.max_angle_rad())

    def _image(self, theta: Number) -> Number:
        """θd(θ)."""
        square = theta * theta
        value = square * self.k4
        for k in (self.k3, self.k2, self.k1):
            value += k
            value *= square
        value += 1.0
        value *= theta
        return value

    def _slope(self, theta: Number) -> Number:
        """dθd/dθ."""
        square = theta * theta
        value = square * (9.0 * self.k4)
        for slope in (7.0 * self.k3, 5.0 * self.k2, 3.0 * self.k1):
            value += slope
            value *= square
        value += 1.0
        return value


class FisheyePolynomial(RadialFisheye):
    """Pix4D's and Bentley's fisheye model, with even and odd powers of the angle; k_i multiplies θ^i.

    With θ the angle between the ray (X, Y, Z) and the axis, in radians, and R² = X² + Y²::

        θ  = atan2(R, Z)
        θd = θ + k2·θ² + k3·θ³ + k4·θ⁴
        x' = θd·X / R        y' = θd·Y / R

    Pix4D's unit of the angle is the right angle: ρ = p0 + p1·t + p2·t² + p3·t³ with t = 2θ/π and p0 = 0, p1 = 1.
    Hence k_i = p_i·(2/π)^(i−1), and the focal length is 2/π times the one in its affine matrix.

    Source: Pix4D, "Camera internals for fisheye lens".
    """

    model: ClassVar[str] = "fisheye-polynomial"
    example: ClassVar[Mapping[str, float]] = {"k2": 0.05, "k3": -0.12}

    k2: float
    k3: float
    k4: float = 0.0

    def max_angle_rad(self) -> float:
        """Angle at which θd stops growing, at most π."""
        return min(math.pi, self.turning_point())

    def turning_point(self) -> float:
        """Argument at which the polynomial stops growing; ``inf`` if it never does."""
        return first_positive_root((1.0, 2.0 * self.k2, 3.0 * self.k3, 4.0 * self.k4))

    def equivalents(self) -> tuple[Distortion, ...]:
        """The Kannala–Brandt model, if the even powers are zero."""
        return () if self.k2 or self.k4 else (KannalaBrandt(k1=self.k3, k2=0.0, k3=0.0, k4=0.0),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> FisheyePolynomial | None:
        """Convert a Kannala–Brandt model without terms above θ³; None for every other model."""
        if not isinstance(other, KannalaBrandt) or other.k2 or other.k3 or other.k4:
            return None
        return cls(k2=0.0, k3=other.k1)

    def _image(self, theta: Number) -> Number:
        """θd(θ)."""
        return theta * (1.0 + theta * (self.k2 + theta * (self.k3 + theta * self.k4)))

    def _slope(self, theta: Number) -> Number:
        """dθd/dθ."""
        return 1.0 + theta * (2.0 * self.k2 + theta * (3.0 * self.k3 + theta * (4.0 * self.k4)))
