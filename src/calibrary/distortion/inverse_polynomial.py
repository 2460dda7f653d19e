"""Distorted to undistorted with all terms that some program adds to Brown's model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from calibrary.distortion.base import Distortion
from calibrary.distortion.brown_polynomial import BrownPolynomial
from calibrary.distortion.inverse_brown import InverseBrown
from calibrary.distortion.inverse_model import InverseModel

__all__ = ["InversePolynomial"]


class InversePolynomial(InverseModel):
    """Distorted to undistorted: USGS reports with P3 or P4, and the Stereo Pipeline's decentring by an angle.

    With (x, y) the distorted point, r² = x² + y² and t = 1 + p3·r² + p4·r⁴, the undistorted point is::

        x·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸) + (2·p1·x·y + p2·(r² + 2x²))·t + s1·r² + s2·r⁴
        y·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸) + (p1·(r² + 2y²) + 2·p2·x·y)·t + s3·r² + s4·r⁴

    Sources: the SMAC adjustment of the USGS for p3 and p4; D. C. Brown, "Decentering distortion of lenses", 1966,
    for s1 to s4 (profile P1·r² + P2·r⁴ at an angle φ).

    Raises:
        InputError: a coefficient is not finite.
    """

    model: ClassVar[str] = "observed-polynomial"
    example: ClassVar[Mapping[str, float]] = {"k1": 0.3, "s1": 0.03, "s3": 0.02}

    k1: float
    k2: float
    k3: float
    k4: float
    p1: float
    p2: float
    p3: float
    p4: float
    s1: float
    s2: float
    s3: float
    s4: float

    def _polynomial(self) -> BrownPolynomial:
        return BrownPolynomial(**self.coefficients)

    def equivalents(self) -> tuple[Distortion, ...]:
        """Brown's inverse model and its equivalents, if the other terms have no effect."""
        grows = (self.p1 or self.p2) and (self.p3 or self.p4)
        if grows or self.s1 or self.s2 or self.s3 or self.s4:
            return ()
        brown = InverseBrown(k1=self.k1, k2=self.k2, p1=self.p1, p2=self.p2, k3=self.k3, k4=self.k4)
        return (brown, *brown.equivalents())

    @classmethod
    def from_equivalent(cls, other: Distortion) -> InversePolynomial | None:
        """Convert Brown's inverse model about the principal point, up to r⁸, without affinity; None for every other."""
        if not isinstance(other, InverseBrown):
            return None
        if other.k5 or other.b1 or other.b2 or other.x0 or other.y0:
            return None
        rest = dict.fromkeys(("p3", "p4", "s1", "s2", "s3", "s4"), 0.0)
        return cls(k1=other.k1, k2=other.k2, k3=other.k3, k4=other.k4, p1=other.p1, p2=other.p2, **rest)
