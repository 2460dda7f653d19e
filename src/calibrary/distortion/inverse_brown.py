"""Brown's model as in photogrammetry: from the distorted to the undistorted point."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from calibrary.distortion.base import Distortion
from calibrary.distortion.brown_polynomial import BrownPolynomial
from calibrary.distortion.inverse_model import InverseModel
from calibrary.distortion.none import NoDistortion

__all__ = ["InverseBrown"]


class InverseBrown(InverseModel):
    """Distorted to undistorted, with OpenCV's names and order; PhotoModeler, VisualSfM, MicMac's C2M.

    With (x', y') the distorted point, x = x' − x0, y = y' − y0 and r² = x² + y², the undistorted point is::

        x0 + x·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸ + k5·r¹⁰) + 2·p1·x·y + p2·(r² + 2x²) + b1·x + b2·y
        y0 + y·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸ + k5·r¹⁰) + p1·(r² + 2y²) + 2·p2·x·y

    (x0, y0) is the centre of the distortion in normalised coordinates, relative to the principal point. b1 and b2
    are an affinity and a shear that cannot be moved into K, because r is measured before them. Barrel distortion
    has k1 > 0 here.

    Source: D. C. Brown, "Close-range camera calibration", 1971.

    Raises:
        InputError: a coefficient is not finite, or b1 or b2 exceeds 0.1.
    """

    model: ClassVar[str] = "observed-brown"
    example: ClassVar[Mapping[str, float]] = {"k1": 0.3, "p1": 0.01, "p2": 0.01}

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    b1: float = 0.0
    b2: float = 0.0
    x0: float = 0.0
    y0: float = 0.0

    def _polynomial(self) -> BrownPolynomial:
        return BrownPolynomial(
            k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4, k5=self.k5,
            p1=self.p1, p2=self.p2, b1=self.b1, b2=self.b2,
        )  # fmt: skip

    def _centre(self) -> tuple[float, float]:
        return self.x0, self.y0

    def equivalents(self) -> tuple[Distortion, ...]:
        """No distortion, if every term is zero; the centre does not matter."""
        terms = (value for name, value in self.coefficients.items() if name not in {"x0", "y0"})
        return () if any(terms) else (NoDistortion(),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> InverseBrown | None:
        """Convert no distortion; other models with an exact inverse-Brown form list it in their ``equivalents``."""
        return cls(k1=0.0, k2=0.0, p1=0.0, p2=0.0) if isinstance(other, NoDistortion) else None
