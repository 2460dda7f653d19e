"""Fisheye models of two steps: an equidistant projection, then polynomials in the plane.

With θ the angle between the ray (X, Y, Z) and the axis, and R² = X² + Y², the equidistant point is θ·(X, Y)/R. The
polynomials map the plane to itself; their limit and inverse are computed as for the perspective models.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from functools import cached_property
from typing import ClassVar

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Columns, Distortion, as_rows, by_columns, finite_pair
from calibrary.distortion.omnidirectional import Omnidirectional
from calibrary.distortion.opencv import OpenCVDistortion
from calibrary.distortion.polynomial import PolynomialMap, trimmed

__all__ = ["EquidistantDistortion", "PlanarPolynomial", "only"]


class PlanarPolynomial(OpenCVDistortion):
    """Polynomial of the fisheye models, not a model of its own; no coefficient is in a denominator.

    With r² = u² + v²::

        u' = u·(1 + k1·r² + … + k6·r¹²) + 2·p1·u·v + p2·(r² + 2u²) + s1·r² + s2·r⁴
        v' = v·(1 + k1·r² + … + k6·r¹²) + p1·(r² + 2v²) + 2·p2·u·v + s3·r² + s4·r⁴
    """

    model: ClassVar[str] = "planar-polynomial"

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    s1: float = 0.0
    s2: float = 0.0
    s3: float = 0.0
    s4: float = 0.0

    def _lens(self) -> PolynomialMap:
        """The map; k4 to k6 multiply r⁸ to r¹², whereas OpenCV's k4 to k6 are in the denominator."""
        return _Map(
            k1=self.k1, k2=self.k2, k3=self.k3, r8=self.k4, r10=self.k5, r12=self.k6, p1=self.p1, p2=self.p2,
            s1=self.s1, s2=self.s2, s3=self.s3, s4=self.s4,
        )  # fmt: skip


class EquidistantDistortion(Omnidirectional):
    """A model of one or several planar maps of the equidistant point.

    All maps but the last are radial. The whole is therefore one-to-one up to the smallest radius at which one of the
    maps reaches its limit.
    """

    @abstractmethod
    def _stages(self) -> tuple[PlanarPolynomial, ...]:
        """The maps, in the order of their application."""

    def max_angle_rad(self) -> float:
        """Smallest angle at which one of the maps reaches its limit, at most π."""
        *radial, last = self._stages()
        radius = last.valid_radius()
        for stage in reversed(radial):
            limit = stage.valid_radius()
            # If the limit of the later maps is outside this map's image, this map's own limit comes first.
            inner = stage.undistort(np.array([[radius, 0.0]]))[0, 0] if math.isfinite(radius) else math.nan
            radius = float(inner) if math.isfinite(inner) else limit
        return min(math.pi, radius)

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""
        point = _equidistant(rays)
        for stage in self._stages():
            point = stage.distort(point)
        return point

    def distort_unlimited(self, rays: FloatArray) -> FloatArray:
        """The formula alone; NaN only for straight backwards."""
        point = _equidistant(rays)
        for stage in self._stages():
            point = stage._image_unlimited(point)
        return point

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN for points without a direction."""
        point = as_rows(xy, 2)
        for stage in reversed(self._stages()):
            point = stage.undistort(point)
        return _directions(point)


def only(distortion: Distortion, *names: str) -> bool:
    """Return whether all coefficients other than those named are zero."""
    return not any(value for name, value in distortion.coefficients.items() if name not in names)


def _equidistant(rays: FloatArray) -> FloatArray:
    """(N, 3) directions to (N, 2) equidistant points; NaN for straight backwards, whose image is a whole circle."""

    def image(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        r = np.hypot(x, y)
        stretch = np.arctan2(r, z) / r
        stretch[(r == 0) & (z > 0)] = 0.0
        return finite_pair(x * stretch, y * stretch)

    return by_columns(image, rays, 3, 2)


def _directions(points: FloatArray) -> FloatArray:
    """The inverse of :func:`_equidistant`; NaN from 180° on."""

    def direction(u: FloatArray, v: FloatArray) -> Columns:
        theta = np.hypot(u, v)
        theta[~(theta < math.pi)] = math.nan
        # sin θ / θ without a division by zero on the axis; numpy's sinc(x) is sin(πx)/(πx).
        stretch = np.sinc(theta / math.pi)
        return *finite_pair(u * stretch, v * stretch), np.cos(theta)

    return by_columns(direction, points, 2, 3)


class _Map(PolynomialMap, frozen=True, kw_only=True):
    """OpenCV's map with three more radial terms in the numerator."""

    POWERS: ClassVar[dict[str, int]] = PolynomialMap.POWERS | {"r8": 8, "r10": 10, "r12": 12}

    r8: float = 0.0
    r10: float = 0.0
    r12: float = 0.0

    @cached_property
    def numerator(self) -> list[float]:
        """1 + k1·s + … + r12·s⁶, constant term first, without trailing zeros."""
        return trimmed([1.0, self.k1, self.k2, self.k3, self.r8, self.r10, self.r12])
