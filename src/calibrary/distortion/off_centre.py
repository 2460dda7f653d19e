"""Brown's model about a centre that is not the principal point, as in MicMac."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Distortion, as_rows, perspective
from calibrary.distortion.brown_polynomial import BrownPolynomial
from calibrary.distortion.metashape import MetashapeFrame
from calibrary.distortion.none import NoDistortion
from calibrary.distortion.opencv import BrownConrady

__all__ = ["OffCentreBrown"]


class OffCentreBrown(Distortion):
    """Undistorted to distorted about (x0, y0), with OpenCV's names and order.

    With (X, Y) the undistorted point, x = X − x0, y = Y − y0 and r² = x² + y²::

        x' = x0 + x·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸ + k5·r¹⁰) + 2·p1·x·y + p2·(r² + 2x²) + b1·x + b2·y
        y' = y0 + y·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸ + k5·r¹⁰) + p1·(r² + 2y²) + 2·p2·x·y

    (x0, y0) is the centre of the distortion in normalised coordinates: (centre − principal point) / focal length. k4
    and k5 are not in a denominator, unlike OpenCV's. b1 and b2 are an affinity and a shear of the *undistorted* point
    and cannot be part of K, which acts on the distorted one.

    Source: MicMac's ``ModRad`` and ``ModPhgrStd``.

    Raises:
        InputError: a coefficient is not finite, or b1 or b2 exceeds 0.1.
    """

    model: ClassVar[str] = "off-centre-brown"
    example: ClassVar[Mapping[str, float]] = {"k1": -0.2, "x0": 0.12, "y0": 0.06}

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

    def __post_init__(self) -> None:
        Distortion.__post_init__(self)
        self._polynomial()

    def valid_radius(self) -> float:
        """Radius of the largest disc around the axis inside the one-to-one disc around (x0, y0)."""
        return max(self._polynomial().valid_radius() - math.hypot(self.x0, self.y0), 0.0)

    def distort(self, xy: FloatArray) -> FloatArray:
        """Undistorted to distorted; NaN from :meth:`valid_radius` on."""
        undistorted = np.array(as_rows(xy, 2))
        centre = self._centre()
        with np.errstate(all="ignore"):
            undistorted[~(np.hypot(undistorted[:, 0], undistorted[:, 1]) < self.valid_radius())] = math.nan
            return self._polynomial().distort(undistorted - centre) + centre

    def distort_unlimited(self, rays: FloatArray) -> FloatArray:
        """The formula alone; NaN only for what is behind the camera."""
        centre = self._centre()
        return self._polynomial()._image_unlimited(perspective(rays) - centre) + centre

    def undistort(self, xy: FloatArray) -> FloatArray:
        """Distorted to undistorted, to machine precision; NaN without a solution inside :meth:`valid_radius`."""
        centre = self._centre()
        with np.errstate(all="ignore"):
            undistorted = self._polynomial().undistort(as_rows(xy, 2) - centre) + centre
            undistorted[~(np.hypot(undistorted[:, 0], undistorted[:, 1]) < self.valid_radius())] = math.nan
        return undistorted

    def equivalents(self) -> tuple[Distortion, ...]:
        """The models about the principal point, if x0 and y0 and the terms that they lack are zero."""
        terms = {name: value for name, value in self.coefficients.items() if name not in {"x0", "y0"}}
        if not any(terms.values()):
            return (NoDistortion(),)
        if self.x0 or self.y0 or self.b1 or self.b2 or self.k5:
            return ()
        frame = MetashapeFrame(k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4, p1=self.p2, p2=self.p1)
        return (frame, *frame.equivalents())

    @classmethod
    def from_equivalent(cls, other: Distortion) -> OffCentreBrown | None:
        """Convert Brown–Conrady, or Metashape's model without p3 and p4; None for every other model."""
        if isinstance(other, BrownConrady):
            return cls(**other.coefficients)
        if isinstance(other, MetashapeFrame) and not (other.p3 or other.p4):
            k = {name: value for name, value in other.coefficients.items() if name.startswith("k")}
            return cls(**k, p1=other.p2, p2=other.p1)
        return None

    def _polynomial(self) -> BrownPolynomial:
        """Return the map with both points relative to the centre."""
        return BrownPolynomial(
            k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4, k5=self.k5,
            p1=self.p1, p2=self.p2, b1=self.b1, b2=self.b2,
        )  # fmt: skip

    def _centre(self) -> FloatArray:
        return np.array([self.x0, self.y0])
