"""OpenSfM's largest fisheye: six radial, two tangential and four prism terms on the equidistant point."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from calibrary.distortion.base import Distortion
from calibrary.distortion.equidistant import EquidistantDistortion, PlanarPolynomial, only
from calibrary.distortion.kannala_brandt import KannalaBrandt
from calibrary.distortion.thin_prism_fisheye import ThinPrismFisheye

__all__ = ["Fisheye624"]

RADIAL = ("k1", "k2", "k3", "k4")


class Fisheye624(EquidistantDistortion):
    """OpenSfM ``fisheye624`` and, without s0 to s3, ``fisheye62``.

    With θ the angle between the ray (X, Y, Z) and the axis, R² = X² + Y² and (u, v) = θ·(X, Y)/R::

        x' = u·(1 + k1·θ² + … + k6·θ¹²) + 2·p1·u·v + p2·(θ² + 2u²) + s0·θ² + s1·θ⁴
        y' = v·(1 + k1·θ² + … + k6·θ¹²) + p1·(θ² + 2v²) + 2·p2·u·v + s2·θ² + s3·θ⁴

    Meta's model of the same name, COLMAP's ``RAD_TAN_THIN_PRISM_FISHEYE``, differs. It computes the last
    two groups of terms at the point that the first group gives, and exchanges p1 and p2.

    Source: OpenSfM, ``camera_distortions_functions.h``.
    """

    model: ClassVar[str] = "fisheye624"
    example: ClassVar[Mapping[str, float]] = {"k1": 0.02, "k2": -0.01, "s0": 0.03, "s2": 0.02}

    k1: float
    k2: float
    k3: float
    k4: float
    k5: float
    k6: float
    p1: float
    p2: float
    s0: float = 0.0
    s1: float = 0.0
    s2: float = 0.0
    s3: float = 0.0

    def _stages(self) -> tuple[PlanarPolynomial, ...]:
        return (
            PlanarPolynomial(
                k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4, k5=self.k5, k6=self.k6,
                p1=self.p1, p2=self.p2, s1=self.s0, s2=self.s1, s3=self.s2, s4=self.s3,
            ),
        )  # fmt: skip

    def equivalents(self) -> tuple[Distortion, ...]:
        """The smaller fisheye models, if the terms that they lack are zero."""
        same: list[Distortion] = []
        if only(self, *RADIAL):
            same.append(KannalaBrandt(k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4))
        if only(self, *RADIAL, "p1", "p2", "s0", "s2"):
            same.append(
                ThinPrismFisheye(
                    k1=self.k1, k2=self.k2, p1=self.p1, p2=self.p2, k3=self.k3, k4=self.k4, sx1=self.s0, sy1=self.s2
                )
            )  # fmt: skip
        return tuple(same)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> Fisheye624 | None:
        """Convert one of the smaller fisheye models; None for every other model."""
        if isinstance(other, KannalaBrandt):
            return cls(k1=other.k1, k2=other.k2, k3=other.k3, k4=other.k4, k5=0.0, k6=0.0, p1=0.0, p2=0.0)
        if isinstance(other, ThinPrismFisheye):
            return cls(
                k1=other.k1, k2=other.k2, k3=other.k3, k4=other.k4, k5=0.0, k6=0.0, p1=other.p1, p2=other.p2,
                s0=other.sx1, s2=other.sy1,
            )  # fmt: skip
        return None
