"""Fisheye models with an image radius that depends only on the angle from the axis, and their tables."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Self

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Columns, by_columns, finite_pair
from calibrary.distortion.omnidirectional import Omnidirectional
from calibrary.distortion.polynomial import Number, Rising, inverse_of_rising

__all__ = ["RadialFisheye"]

TABLE_NODES = 16_384

RAY_CELLS = 2048
"""Number of cells in a table of rays; the cubics' errors are below rounding, except next to a limit."""

TABULATED_RAD = 2.0
"""Largest tabulated angle from the axis, beyond the field of view of real lenses; larger angles are solved for."""

ROUNDING = 2e-15
"""Largest difference between a tabulated ray and the result of Newton's method."""

Numbers = FloatArray | NDArray[np.complex128]

_NODES = 0.5 - 0.5 * np.cos(math.pi * np.arange(4) / 3)
"""Chebyshev nodes of a cell from 0 to 1, including both ends: the table is exact at the ends, hence at 0."""

_TO_POWERS = np.linalg.inv(np.vander(_NODES))


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
        starts = np.arange(cells) * (reach / cells)
        values = functions((starts + _NODES[:, None] * (reach / cells)).ravel())
        values = values.reshape(len(values), 4, cells)
        # The fit is to differences within a cell: these are small, and so are the rounding errors of the coefficients.
        fitted = np.einsum("pn,mnc->pmc", _TO_POWERS, values - values[:, :1])
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
