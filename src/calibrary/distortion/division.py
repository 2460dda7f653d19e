"""The division model: one parameter, closed forms in both directions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Columns, Distortion, by_columns, finite_pair
from calibrary.distortion.none import NoDistortion
from calibrary.distortion.omnidirectional import Omnidirectional, unit

__all__ = ["Division"]


class Division(Omnidirectional):
    """COLMAP ``DIVISION`` and ``SIMPLE_DIVISION``; barrel distortion has k < 0.

    The distorted point (x', y'), with r'² = x'² + y'², has the direction (x', y', 1 + k·r'²). Conversely, for the
    ray (X, Y, Z) and R² = X² + Y²::

        x' = 2X / (Z + √(Z² − 4k·R²))        y' = 2Y / (Z + √(Z² − 4k·R²))

    With k < 0 the image contains every direction except straight backwards. With k > 0 it ends at r' = 1/√k, where
    R/Z = 1/(2√k).

    Source: A. Fitzgibbon, "Simultaneous linear estimation of multiple view geometry and lens distortion", 2001.
    """

    model: ClassVar[str] = "division"
    example: ClassVar[Mapping[str, float]] = {"k": -0.35}
    example_reach_deg: ClassVar[float] = 37.0

    k: float

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""

        def image(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
            x, y, z = unit(x, y, z)
            r2 = x * x + y * y
            inside = z * z - 4.0 * self.k * r2
            inside[~((inside > 0) & ((z > 0) | (self.k < 0)))] = math.nan
            reach = np.sqrt(inside)
            # The divisor is z + reach; behind the camera this cancels, so use the product of the two roots.
            divisor = np.where(z < 0, -4.0 * self.k * r2 / (reach - z), z + reach)
            return finite_pair(2.0 * x / divisor, 2.0 * y / divisor)

        return by_columns(image, rays, 3, 2)

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN from r' = 1/√k on."""

        def direction(x: FloatArray, y: FloatArray) -> Columns:
            r = np.hypot(x, y)
            bend = self.k * r * r
            bend[~(bend < 1.0)] = math.nan
            z = 1.0 + bend
            shrink = 1.0 / np.hypot(r, z)
            x, y = finite_pair(x * shrink, y * shrink)
            return x, y, z * shrink + 0.0 * x

        return by_columns(direction, xy, 2, 3)

    def max_angle_rad(self) -> float:
        """Angle at which the two solutions coincide; 180° for k < 0, 90° for a pinhole."""
        if self.k < 0:
            return math.pi
        return math.atan2(1.0, 2.0 * math.sqrt(self.k))

    def equivalents(self) -> tuple[Distortion, ...]:
        """A pinhole, if k is zero."""
        return () if self.k else (NoDistortion(),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> Division | None:
        """Convert a pinhole; None for every other model."""
        return cls(k=0.0) if isinstance(other, NoDistortion) else None
