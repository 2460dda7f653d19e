"""Agisoft Metashape's frame camera: Brown's model with the additional terms k4, p3 and p4."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from calibrary.distortion.base import Distortion
from calibrary.distortion.brown_polynomial import BrownMap
from calibrary.distortion.opencv import BrownConrady, OpenCVDistortion
from calibrary.distortion.polynomial import PolynomialMap

__all__ = ["MetashapeFrame"]


class MetashapeFrame(OpenCVDistortion):
    """Metashape's (PhotoScan's) eight coefficients, in its own order: p1 and p2 are OpenCV's p2 and p1.

    With r² = x² + y²::

        x' = x·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸) + (p1·(r² + 2x²) + 2·p2·x·y)·(1 + p3·r² + p4·r⁴)
        y' = y·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸) + (p2·(r² + 2y²) + 2·p1·x·y)·(1 + p3·r² + p4·r⁴)

    Source: Agisoft Metashape User Manual, appendix "Camera models" (p3 and p4 in its older editions). The
    affinity and skew coefficients b1 and b2 belong to K.
    """

    model: ClassVar[str] = "metashape"
    example: ClassVar[Mapping[str, float]] = {"k1": -0.28, "k2": 0.06, "p1": 0.02, "p2": 0.01}

    k1: float
    k2: float
    k3: float
    k4: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    p3: float = 0.0
    p4: float = 0.0

    def _lens(self) -> PolynomialMap:
        """The map, with OpenCV's names for p1 and p2."""
        return BrownMap(
            k1=self.k1, k2=self.k2, k3=self.k3, p1=self.p2, p2=self.p1, r8=self.k4, t2=self.p3, t4=self.p4
        )  # fmt: skip

    def equivalents(self) -> tuple[Distortion, ...]:
        """Brown–Conrady, if the terms that it lacks are zero."""
        if self.k4 or ((self.p1 or self.p2) and (self.p3 or self.p4)):
            return ()
        return (BrownConrady(k1=self.k1, k2=self.k2, p1=self.p2, p2=self.p1, k3=self.k3),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> MetashapeFrame | None:
        """Convert Brown–Conrady; None for every other model."""
        if not isinstance(other, BrownConrady):
            return None
        return cls(k1=other.k1, k2=other.k2, k3=other.k3, p1=other.p2, p2=other.p1)
