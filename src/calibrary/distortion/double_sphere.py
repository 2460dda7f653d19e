"""The double sphere camera: two spheres, two parameters, closed forms in both directions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Distortion
from calibrary.distortion.extended_unified import ExtendedUnified
from calibrary.distortion.none import NoDistortion
from calibrary.distortion.omnidirectional import (
    Omnidirectional,
    divided,
    lifted,
    lowered,
    undivided,
    widest,
    widest_lifted,
)
from calibrary.distortion.unified import Unified

__all__ = ["DoubleSphere"]


class DoubleSphere(Omnidirectional):
    """Kalibr and Basalt ``ds``.

    For the ray (X, Y, Z)::

        d1 = √(X² + Y² + Z²)        d2 = √(X² + Y² + (ξ·d1 + Z)²)
        x' = X / (alpha·d2 + (1 − alpha)·(ξ·d1 + Z))        y' = Y / (…)

    Near the axis the camera is a pinhole with the focal length fx/(1 + ξ). Real cameras have −1 < ξ < 1 and
    0 ≤ alpha ≤ 1; with ξ ≤ −1 no point has an image.

    Source: V. Usenko, N. Demmel and D. Cremers, "The double sphere camera model", 2018.
    """

    model: ClassVar[str] = "double-sphere"
    example: ClassVar[Mapping[str, float]] = {"xi": -0.2, "alpha": 0.6}

    xi: float
    alpha: float

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""
        return divided(lifted(rays, self.xi), self.alpha, 1.0)

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN for points without a direction."""
        return lowered(undivided(xy, self.alpha, 1.0), self.xi)

    def max_angle_rad(self) -> float:
        """Angle at which the image radius stops growing or, with alpha < 1/2, becomes infinite."""
        return widest_lifted(widest(self.alpha, 1.0), self.xi)

    def equivalents(self) -> tuple[Distortion, ...]:
        """The model of one sphere, if xi or alpha is zero."""
        one_sphere: list[Distortion] = []
        if not self.xi:
            one_sphere.append(ExtendedUnified(alpha=self.alpha, beta=1.0))
        if not self.alpha:
            one_sphere.append(Unified(xi=self.xi))
        return (*one_sphere, NoDistortion()) if len(one_sphere) == 2 else tuple(one_sphere)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> DoubleSphere | None:
        """Convert a pinhole or a one-sphere model without further terms; None for every other model."""
        if isinstance(other, NoDistortion):
            return cls(xi=0.0, alpha=0.0)
        if isinstance(other, ExtendedUnified) and other.beta == 1:
            return cls(xi=0.0, alpha=other.alpha)
        if isinstance(other, Unified) and other == Unified(xi=other.xi):
            return cls(xi=other.xi, alpha=0.0)
        return None
