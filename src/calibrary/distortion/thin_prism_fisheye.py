"""COLMAP's thin-prism fisheye: the Kannala–Brandt model with decentring and prism terms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from calibrary.distortion.base import Distortion
from calibrary.distortion.equidistant import EquidistantDistortion, PlanarPolynomial, only
from calibrary.distortion.kannala_brandt import KannalaBrandt

__all__ = ["ThinPrismFisheye"]


class ThinPrismFisheye(EquidistantDistortion):
    """COLMAP ``THIN_PRISM_FISHEYE``; Metashape's fisheye, with its p1 and p2 exchanged.

    With θ the angle between the ray (X, Y, Z) and the axis, R² = X² + Y² and (u, v) = θ·(X, Y)/R::

        x' = u·(1 + k1·θ² + k2·θ⁴ + k3·θ⁶ + k4·θ⁸) + 2·p1·u·v + p2·(θ² + 2u²) + sx1·θ²
        y' = v·(1 + k1·θ² + k2·θ⁴ + k3·θ⁶ + k4·θ⁸) + p1·(θ² + 2v²) + 2·p2·u·v + sy1·θ²

    Source: COLMAP, ``ThinPrismFisheyeCameraModel``, with its order of the coefficients.
    """

    model: ClassVar[str] = "thin-prism-fisheye"
    example: ClassVar[Mapping[str, float]] = {"k1": 0.02, "k2": -0.01, "sx1": 0.03, "sy1": 0.02}

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float
    k4: float
    sx1: float
    sy1: float

    def _stages(self) -> tuple[PlanarPolynomial, ...]:
        return (
            PlanarPolynomial(
                k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4, p1=self.p1, p2=self.p2, s1=self.sx1, s3=self.sy1
            ),
        )  # fmt: skip

    def equivalents(self) -> tuple[Distortion, ...]:
        """Kannala–Brandt, if there are only radial terms."""
        if not only(self, "k1", "k2", "k3", "k4"):
            return ()
        return (KannalaBrandt(k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> ThinPrismFisheye | None:
        """Convert Kannala–Brandt; None for every other model."""
        if not isinstance(other, KannalaBrandt):
            return None
        return cls(k1=other.k1, k2=other.k2, p1=0.0, p2=0.0, k3=other.k3, k4=other.k4, sx1=0.0, sy1=0.0)
