"""The fisheye model of Meta's Aria glasses: radial terms, then tangential and prism terms of their result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from calibrary.distortion.base import Distortion
from calibrary.distortion.equidistant import EquidistantDistortion, PlanarPolynomial, only
from calibrary.distortion.fisheye624 import Fisheye624
from calibrary.distortion.kannala_brandt import KannalaBrandt

__all__ = ["RadTanThinPrismFisheye"]


class RadTanThinPrismFisheye(EquidistantDistortion):
    """COLMAP ``RAD_TAN_THIN_PRISM_FISHEYE``, Project Aria ``FISHEYE624``.

    With θ the angle between the ray (X, Y, Z) and the axis, and R² = X² + Y²::

        θd = θ·(1 + k0·θ² + k1·θ⁴ + k2·θ⁶ + k3·θ⁸ + k4·θ¹⁰ + k5·θ¹²)        (u, v) = θd·(X, Y)/R
        x' = u + p0·(θd² + 2u²) + 2·p1·u·v + s0·θd² + s1·θd⁴
        y' = v + p1·(θd² + 2v²) + 2·p0·u·v + s2·θd² + s3·θd⁴

    p0 and p1 are OpenCV's p2 and p1.

    Source: Project Aria, "Camera intrinsic models", FisheyeRadTanThinPrism; COLMAP's order of coefficients.
    """

    model: ClassVar[str] = "rad-tan-thin-prism-fisheye"
    example: ClassVar[Mapping[str, float]] = {"k0": 0.02, "k1": -0.01, "p0": 0.02, "s2": 0.02}

    k0: float
    k1: float
    k2: float
    k3: float
    k4: float
    k5: float
    p0: float
    p1: float
    s0: float
    s1: float
    s2: float
    s3: float

    def _stages(self) -> tuple[PlanarPolynomial, ...]:
        return (
            PlanarPolynomial(k1=self.k0, k2=self.k1, k3=self.k2, k4=self.k3, k5=self.k4, k6=self.k5),
            PlanarPolynomial(p1=self.p1, p2=self.p0, s1=self.s0, s2=self.s1, s3=self.s2, s4=self.s3),
        )

    def equivalents(self) -> tuple[Distortion, ...]:
        """OpenSfM's model if there are only radial terms, and Kannala–Brandt if there are at most four."""
        same: list[Distortion] = []
        if only(self, "k0", "k1", "k2", "k3", "k4", "k5"):
            same.append(
                Fisheye624(
                    k1=self.k0, k2=self.k1, k3=self.k2, k4=self.k3, k5=self.k4, k6=self.k5, p1=0.0, p2=0.0
                )
            )
        if only(self, "k0", "k1", "k2", "k3"):
            same.append(KannalaBrandt(k1=self.k0, k2=self.k1, k3=self.k2, k4=self.k3))
        return tuple(same)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> RadTanThinPrismFisheye | None:
        """Convert Kannala–Brandt, or OpenSfM's fisheye with radial terms only; None for every other model."""
        if isinstance(other, KannalaBrandt):
            radial = (other.k1, other.k2, other.k3, other.k4, 0.0, 0.0)
        elif isinstance(other, Fisheye624) and only(other, "k1", "k2", "k3", "k4", "k5", "k6"):
            radial = (other.k1, other.k2, other.k3, other.k4, other.k5, other.k6)
        else:
            return None
        k0, k1, k2, k3, k4, k5 = radial
        return cls(k0=k0, k1=k1, k2=k2, k3=k3, k4=k4, k5=k5, p0=0.0, p1=0.0, s0=0.0, s1=0.0, s2=0.0, s3=0.0)
