"""Fisheyes whose image radius is a function of the angle from the axis and of nothing else."""

from __future__ import annotations

import math
from abc import abstractmethod
from functools import lru_cache, partial

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Columns, by_columns, finite_pair
from calibrary.distortion.inversion import NEWTON_STEPS, SETTLED, WELL_CONDITIONED
from calibrary.distortion.omnidirectional import Omnidirectional
from calibrary.distortion.polynomial import Number
from calibrary.distortion.roots import Rising, inverse_of_rising

__all__ = ["RadialFisheye"]

TABLE_NODES = 16_384


class RadialFisheye(Omnidirectional):
    """A model that puts a ray at θ from the axis at the image radius θd(θ), which rises up to a limiting angle."""

    @abstractmethod
    def _image(self, theta: Number) -> Number:
        """θd of θ."""

    @abstractmethod
    def _slope(self, theta: Number) -> Number:
        """dθd/dθ."""

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on, and straight back."""
        return by_columns(partial(self._distorted, _prepared(self).limit), rays, 3, 2)

    def distort(self, xy: FloatArray) -> FloatArray:
        """Undistorted (x/z, y/z), so less than 90° off the axis, to distorted; NaN from :meth:`valid_radius` on."""
        limit = _prepared(self).limit
        return by_columns(lambda x, y: self._distorted(limit, x, y, np.ones_like(x)), xy, 2, 2)

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN from the image of :meth:`max_angle_rad` on."""
        ready = _prepared(self)

        def direction(x: FloatArray, y: FloatArray) -> Columns:
            theta, rho = self._polar(x, y, ready)
            stretch = np.sin(theta) / rho
            return x * stretch, y * stretch, np.cos(theta)

        return by_columns(direction, xy, 2, 3)

    def undistort(self, xy: FloatArray) -> FloatArray:
        """Distorted to undistorted (x/z, y/z); NaN where the ray is 90° or more off the axis, or there is none."""
        ready = _prepared(self)

        def undistorted(x: FloatArray, y: FloatArray) -> Columns:
            theta, rho = self._polar(x, y, ready)
            theta[theta >= math.pi / 2] = math.nan
            stretch = np.tan(theta) / rho
            return x * stretch, y * stretch

        return by_columns(undistorted, xy, 2, 2)

    def distort_ray(self, x: float, y: float, z: float, /) -> tuple[float, float] | None:
        """One direction; nothing on the axis and from the limit on."""
        r = math.hypot(x, y)
        theta = math.atan2(r, z)
        if not r > 0 or not theta < _prepared(self).limit:
            return None
        stretch = self._image(theta) / r
        u, v = x * stretch, y * stretch
        return (u, v) if math.isfinite(u) and math.isfinite(v) else None

    def undistort_to_ray(self, x: float, y: float, /) -> tuple[float, float, float] | None:
        """One point, by Newton's method; nothing on the axis and where that does not settle below the limit."""
        rho = theta = math.sqrt(x * x + y * y)
        if not rho > 0:
            return None
        for _ in range(NEWTON_STEPS):
            slope = self._slope(theta)
            if not slope > WELL_CONDITIONED:
                return None
            step = (self._image(theta) - rho) / slope
            theta -= step
            if abs(step) <= SETTLED * theta:
                stretch = math.sin(theta) / rho
                ray = x * stretch, y * stretch, math.cos(theta)
                return ray if theta < _prepared(self).limit else None
        return None

    def _distorted(self, limit: float, x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        r = np.hypot(x, y)
        theta = np.arctan2(r, z)
        stretch = self._image(theta) / r
        # On the axis itself the image is the principal point; straight back it would be a whole circle.
        stretch[(r == 0) & (z > 0)] = 0.0
        stretch[~(theta < limit)] = math.nan
        return finite_pair(x * stretch, y * stretch)

    def _polar(self, x: FloatArray, y: FloatArray, ready: _Prepared) -> tuple[FloatArray, FloatArray]:
        """θ of every distorted point, and its distance from the axis, 1 on the axis itself."""
        rho = np.sqrt(x * x + y * y)
        theta = inverse_of_rising(rho, ready.table, self._miss_and_step)
        rho[rho == 0] = 1.0
        return theta, rho

    def _miss_and_step(self, theta: FloatArray, rho: FloatArray) -> tuple[FloatArray, FloatArray]:
        miss = self._image(theta) - rho
        return miss, miss / self._slope(theta)


class _Prepared(Struct, frozen=True):
    """What a model needs for any point.

    Attributes:
        limit: :meth:`Distortion.max_angle_rad`.
        table: the image radius of every angle up to it.
    """

    limit: float
    table: Rising


@lru_cache(maxsize=64)
def _prepared(model: RadialFisheye) -> _Prepared:
    """Remembered, because a single point costs less than this."""
    limit = model.max_angle_rad()
    theta = np.linspace(0.0, limit, TABLE_NODES)
    with np.errstate(all="ignore"):
        return _Prepared(limit, Rising.of(theta, np.maximum.accumulate(model._image(theta))))
