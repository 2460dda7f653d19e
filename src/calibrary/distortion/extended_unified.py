"""The extended unified camera: an ellipsoid, two parameters, closed forms in both directions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Distortion
from calibrary.distortion.none import NoDistortion
from calibrary.distortion.omnidirectional import Omnidirectional, divided, undivided, widest

__all__ = ["ExtendedUnified"]


class ExtendedUnified(Omnidirectional):
    """Kalibr and Basalt ``eucm``, COLMAP ``EUCM``; with beta = 1 Basalt's ``ucm``.

    For the ray (X, Y, Z)::

        d  = √(beta·(X² + Y²) + Z²)
        x' = X / (alpha·d + (1 − alpha)·Z)        y' = Y / (alpha·d + (1 − alpha)·Z)

    Real cameras have 0 ≤ alpha ≤ 1 and beta > 0. With a negative beta no point has an image.

    Source: B. Khomutenko, G. Garcia and P. Martinet, "An enhanced unified camera model", 2016.
    """

    model: ClassVar[str] = "extended-unified"
    example: ClassVar[Mapping[str, float]] = {"alpha": 0.6, "beta": 1.1}

    alpha: float
    beta: float

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""
        return divided(rays, self.alpha, self.beta)

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN for points without a direction."""
        return undivided(xy, self.alpha, self.beta)

    def max_angle_rad(self) -> float:
        """Angle at which the image radius stops growing or, with alpha < 1/2, becomes infinite."""
        return widest(self.alpha, self.beta)

    def equivalents(self) -> tuple[Distortion, ...]:
        """A pinhole, if alpha is zero."""
        return () if self.alpha else (NoDistortion(),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> ExtendedUnified | None:
        """Convert a pinhole; None for every other model."""
        return cls(alpha=0.0, beta=1.0) if isinstance(other, NoDistortion) else None
