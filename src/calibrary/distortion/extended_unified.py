"""The extended unified camera: an ellipsoid and two numbers, all in closed form."""

from __future__ import annotations

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

    Cameras have 0 ≤ alpha ≤ 1 and beta > 0. A negative beta gives no camera.

    Source: B. Khomutenko, G. Garcia and P. Martinet, "An enhanced unified camera model", 2016.
    """

    model: ClassVar[str] = "extended-unified"

    alpha: float
    beta: float

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""
        return divided(rays, self.alpha, self.beta)

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN where nothing is seen."""
        return undivided(xy, self.alpha, self.beta)

    def max_angle_rad(self) -> float:
        """The angle at which the image radius stops growing, or below alpha = 1/2 runs to infinity."""
        return widest(self.alpha, self.beta)

    def equivalents(self) -> tuple[Distortion, ...]:
        """A pinhole, where alpha is zero."""
        return () if self.alpha else (NoDistortion(),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> ExtendedUnified | None:
        """A pinhole; None for every other model."""
        return cls(alpha=0.0, beta=1.0) if isinstance(other, NoDistortion) else None
