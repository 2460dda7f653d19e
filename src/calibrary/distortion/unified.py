"""The unified camera: a sphere seen from a point behind its centre, then Brown's k1, k2, p1, p2 in the plane."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Distortion, perspective, unit_rays
from calibrary.distortion.omnidirectional import Omnidirectional, lifted, lowered, widest_lifted
from calibrary.distortion.opencv import BrownConrady

__all__ = ["Unified"]


class Unified(Omnidirectional):
    """Kalibr ``omni`` with ``radtan`` or none, camodocal ``MEI``, OpenCV's ``cv2.omnidir``.

    With |P| the length of the ray (X, Y, Z)::

        x = X / (Z + ξ·|P|)        y = Y / (Z + ξ·|P|)        r² = x² + y²
        x' = x·(1 + k1·r² + k2·r⁴) + 2·p1·x·y + p2·(r² + 2x²)
        y' = y·(1 + k1·r² + k2·r⁴) + p1·(r² + 2y²) + 2·p2·x·y

    The focal lengths in K are Mei's generalised γ: near the axis the camera is a pinhole with the focal length
    γ/(1 + ξ). With ξ ≤ −1 no point has an image.

    Source: C. Mei and P. Rives, "Single view point omnidirectional camera calibration from planar grids", 2007.
    """

    model: ClassVar[str] = "unified"
    example: ClassVar[Mapping[str, float]] = {"xi": 0.9}

    xi: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""
        return self._plane().distort(perspective(lifted(rays, self.xi)))

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN for points without a direction."""
        return lowered(unit_rays(self._plane().undistort(xy)), self.xi)

    def max_angle_rad(self) -> float:
        """Angle at which the terms in the plane reach their limit or the ray becomes parallel to the plane."""
        return widest_lifted(math.atan(self._plane().valid_radius()), self.xi)

    def equivalents(self) -> tuple[Distortion, ...]:
        """Brown–Conrady, if ξ is zero."""
        return () if self.xi else (self._plane(),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> Unified | None:
        """Convert Brown–Conrady without k3; None for every other model."""
        if not isinstance(other, BrownConrady) or other.k3:
            return None
        return cls(xi=0.0, k1=other.k1, k2=other.k2, p1=other.p1, p2=other.p2)

    def _plane(self) -> BrownConrady:
        return BrownConrady(k1=self.k1, k2=self.k2, p1=self.p1, p2=self.p2)
