"""The seven distortion parameters of the ten-parameter camera of close-range photogrammetry."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from calibrary.distortion.base import Distortion
from calibrary.distortion.brown_polynomial import BrownPolynomial
from calibrary.distortion.inverse_brown import InverseBrown
from calibrary.distortion.inverse_model import InverseModel
from calibrary.distortion.none import NoDistortion

__all__ = ["Australis"]


class Australis(InverseModel):
    """Distorted to undistorted: Australis, iWitness, CameraCalibrator, with OpenCV's axes, names and order.

    With (x, y) the distorted point, y down, and r² = x² + y², the undistorted point is::

        x·(1 + k1·r² + k2·r⁴ + k3·r⁶) + 2·p1·x·y + p2·(r² + 2x²) + b1·x + b2·y
        y·(1 + k1·r² + k2·r⁴ + k3·r⁶) + p1·(r² + 2y²) + 2·p2·x·y

    The program's own coefficients are per mm, with y up and the decentring terms in the other order.

    Source: C. S. Fraser, "Digital camera self-calibration", 1997.

    Raises:
        InputError: a coefficient is not finite, or b1 or b2 exceeds 0.1.
    """

    model: ClassVar[str] = "australis"
    example: ClassVar[Mapping[str, float]] = {"k1": 0.3, "p1": 0.01, "b1": 0.01}

    k1: float
    k2: float
    k3: float
    p1: float
    p2: float
    b1: float
    b2: float

    def _polynomial(self) -> BrownPolynomial:
        return BrownPolynomial(**self.coefficients)

    def equivalents(self) -> tuple[Distortion, ...]:
        """Brown's inverse model, and its equivalents."""
        brown = InverseBrown(**self.coefficients)
        return (brown, *brown.equivalents())

    @classmethod
    def from_equivalent(cls, other: Distortion) -> Australis | None:
        """Convert Brown's inverse model about the principal point with terms up to r⁶; None for every other model."""
        if isinstance(other, NoDistortion):
            return cls(**dict.fromkeys(cls.names(), 0.0))
        if not isinstance(other, InverseBrown) or other.k4 or other.k5 or other.x0 or other.y0:
            return None
        return cls(**{name: value for name, value in other.coefficients.items() if name in cls.names()})
