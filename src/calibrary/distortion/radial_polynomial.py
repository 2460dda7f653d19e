"""The perspective lens of panorama programs: a polynomial of the radius, with odd powers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import ClassVar

from calibrary.arrays import FloatArray, np
from calibrary.distortion.base import Distortion, NoDistortion, radially
from calibrary.distortion.opencv import BrownConrady
from calibrary.distortion.polynomial import Rising, inverse_of_rising
from calibrary.distortion.radial_fisheye import FisheyePolynomial

REACH = 1e7
"""Largest radius, a rounding error from 90°."""
TABLE_NODES = 4096


class RadialPolynomial(Distortion):
    """PTLens, Hugin and lensfun's ``ptlens``: even and odd powers of the radius; k_i multiplies r^i.

    With r² = x² + y²::

        r' = r + k2·r² + k3·r³ + k4·r⁴        x' = x·r'/r        y' = y·r'/r

    The programs count in halves of the shorter side: ρ' = ρ·(d + c·ρ + b·ρ² + a·ρ³) with d = 1 − a − b − c and ρ = r/s.
    Hence k2 = c/(d·s), k3 = b/(d·s²), k4 = a/(d·s³), and d multiplies the focal length.

    Source: H. Dersch, libpano, ``math.c`` (``radial``).
    """

    model: ClassVar[str] = "radial-polynomial"
    example: ClassVar[Mapping[str, float]] = {"k2": 0.1, "k3": -0.35}

    k2: float
    k3: float
    k4: float = 0.0

    def valid_radius(self) -> float:
        """Radius at which r' stops growing, at most 10⁷."""
        return _prepared(self).limit

    def distort(self, xy: FloatArray) -> FloatArray:
        """Undistorted to distorted; NaN from :meth:`valid_radius` on."""
        limit, image = self.valid_radius(), FisheyePolynomial(**self.coefficients)._image
        return radially(xy, lambda r: np.where(r < limit, image(r), math.nan))

    def undistort(self, xy: FloatArray) -> FloatArray:
        """Distorted to undistorted, to machine precision; NaN from the image of :meth:`valid_radius` on."""
        table, miss_and_step = _prepared(self), FisheyePolynomial(**self.coefficients)._miss_and_step
        return radially(xy, lambda r: inverse_of_rising(r, table, miss_and_step))

    def equivalents(self) -> tuple[Distortion, ...]:
        """Brown's model with k1 alone, if the other powers are zero; then a pinhole, if that is as well."""
        if self.k2 or self.k4:
            return ()
        brown = BrownConrady(k1=self.k3, k2=0.0, p1=0.0, p2=0.0)
        return (brown, *brown.equivalents())

    @classmethod
    def from_equivalent(cls, other: Distortion) -> RadialPolynomial | None:
        """Convert a pinhole, or Brown's model with k1 alone; None for every other model."""
        if isinstance(other, NoDistortion):
            return cls(k2=0.0, k3=0.0)
        if not isinstance(other, BrownConrady) or other.k2 or other.k3 or other.p1 or other.p2:
            return None
        return cls(k2=0.0, k3=other.k1)


@lru_cache(maxsize=64)
def _prepared(model: RadialPolynomial) -> Rising:
    """The table of r' up to where it stops growing; cached, because this takes longer than a single point."""
    lens = FisheyePolynomial(**model.coefficients)
    limit = min(REACH, lens.turning_point())
    nodes = np.linspace(0.0, limit, TABLE_NODES)
    with np.errstate(all="ignore"):
        return Rising.of(nodes, np.maximum.accumulate(lens._image(nodes)))
