"""Fisheye model with a general polynomial of the angle from the axis as image radius, as in Pix4D."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from calibrary.distortion.base import Distortion
from calibrary.distortion.kannala_brandt import KannalaBrandt
from calibrary.distortion.polynomial import Number, first_positive_root
from calibrary.distortion.radial_fisheye import RadialFisheye

__all__ = ["FisheyePolynomial"]


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
