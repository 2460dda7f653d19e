"""Agisoft Metashape's frame camera: Brown's model with one radial term more than OpenCV's."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from calibrary.distortion.base import Distortion, FloatArray
from calibrary.distortion.brown import BrownConrady
from calibrary.distortion.opencv import OpenCVDistortion
from calibrary.distortion.polynomial import Jacobian, PolynomialMap

__all__ = ["MetashapeFrame"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MetashapeFrame(OpenCVDistortion):
    """Metashape's (PhotoScan's) eight coefficients, in its own order: p1 and p2 stand the other way round.

    With r² = x² + y²::

        x' = x·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸) + (p1·(r² + 2x²) + 2·p2·x·y)·(1 + p3·r² + p4·r⁴)
        y' = y·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸) + (p2·(r² + 2y²) + 2·p1·x·y)·(1 + p3·r² + p4·r⁴)

    Source: Agisoft Metashape User Manual, appendix "Camera models" (p3 and p4 in its older editions). The
    affinity and skew coefficients b1 and b2 belong to K.
    """

    model: ClassVar[str] = "metashape"

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
        return _Map(
            k1=self.k1, k2=self.k2, k3=self.k3, p1=self.p2, p2=self.p1, r8=self.k4, t2=self.p3, t4=self.p4
        )  # fmt: skip

    def equivalents(self) -> tuple[Distortion, ...]:
        """Brown–Conrady, where the terms that it lacks are zero."""
        if self.k4 or ((self.p1 or self.p2) and (self.p3 or self.p4)):
            return ()
        return (BrownConrady(k1=self.k1, k2=self.k2, p1=self.p2, p2=self.p1, k3=self.k3),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> MetashapeFrame | None:
        """Any Brown–Conrady; None for every other model."""
        if not isinstance(other, BrownConrady):
            return None
        return cls(k1=other.k1, k2=other.k2, k3=other.k3, p1=other.p2, p2=other.p1)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Map(PolynomialMap):
    """OpenCV's map with a fourth radial term and tangential terms that grow with the radius.

    On a circle the determinant is still a trigonometric polynomial of degree two in the direction, which is
    what the search for the fold rests on: with h = r²·(1 + t2·r² + t4·r⁴) in place of r², nothing else
    changes.
    """

    r8: float = 0.0
    t2: float = 0.0
    t4: float = 0.0

    @property
    def numerator(self) -> list[float]:
        """1 + k1·s + k2·s² + k3·s³ + r8·s⁴, constant term first, without trailing zeros."""
        terms = [1.0, self.k1, self.k2, self.k3, self.r8]
        while len(terms) > 1 and terms[-1] == 0.0:
            terms.pop()
        return terms

    @property
    def has_prism(self) -> bool:
        """Whether the fold must be searched for, as with a prism: no closed form holds."""
        return bool((self.t2 or self.t4) and (self.p1 or self.p2))

    @property
    def octave(self) -> int:
        """As for the map it extends."""
        strongest = (
            math.floor(-math.log2(abs(c)) / power) - 1
            for name, power in _POWERS.items()
            if (c := getattr(self, name))
        )
        return min(strongest, default=0)

    def in_octave(self, octave: int) -> PolynomialMap:
        """The same map with ideal and observed radii counted in units of 2**octave."""
        return _Map(
            **{name: math.ldexp(getattr(self, name), power * octave) for name, power in _POWERS.items()}
        )

    def image(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Ideal to observed."""
        u, v = PolynomialMap.image(self, x, y)
        if self.has_prism:
            r2 = x * x + y * y
            growth = r2 * (self.t2 + self.t4 * r2)
            along_x, along_y = self._tangential(x, y, r2)
            u = u + along_x * growth
            v = v + along_y * growth
        return u, v

    def image_and_jacobian(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, Jacobian]:
        """Ideal to observed, and the four derivatives there."""
        u, v, (ux, uy, vx, vy) = PolynomialMap.image_and_jacobian(self, x, y)
        if not self.has_prism:
            return u, v, (ux, uy, vx, vy)
        r2 = x * x + y * y
        growth = r2 * (self.t2 + self.t4 * r2)
        slope = 2.0 * (self.t2 + 2.0 * self.t4 * r2)
        along_x, along_y = self._tangential(x, y, r2)
        p1, p2 = self.p1, self.p2
        cross = 2.0 * (p1 * x + p2 * y)
        return (
            u + along_x * growth,
            v + along_y * growth,
            (
                ux + growth * (6.0 * p2 * x + 2.0 * p1 * y) + along_x * slope * x,
                uy + growth * cross + along_x * slope * y,
                vx + growth * cross + along_y * slope * x,
                vy + growth * (6.0 * p1 * y + 2.0 * p2 * x) + along_y * slope * y,
            ),
        )

    def _tangential(self, x: FloatArray, y: FloatArray, r2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The tangential terms before they grow."""
        across = 2.0 * (self.p2 * x + self.p1 * y)
        return x * across + self.p2 * r2, y * across + self.p1 * r2


_POWERS = {"k1": 2, "k2": 4, "k3": 6, "r8": 8, "p1": 1, "p2": 1, "t2": 2, "t4": 4}
"""How the share of each coefficient in the image point grows with r, relative to the point itself."""
