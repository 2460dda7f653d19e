"""Common base of OpenCV's perspective models: one map, optionally with a tilted sensor."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary.arrays import FloatArray
from calibrary.distortion.base import (
    Columns,
    Distortion,
    as_rows,
    blocks,
    by_columns,
    finite_pair,
    unit_ray,
)
from calibrary.distortion.inversion import Inversion, solved
from calibrary.distortion.polynomial import PolynomialMap
from calibrary.distortion.valid_field import monotonic_radius

__all__ = ["OpenCVDistortion"]


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
