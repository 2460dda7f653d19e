"""The rational model: a quotient of two radial polynomials, for distortion that changes sharply with the radius."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from calibrary.distortion.opencv import OpenCVDistortion

__all__ = ["Rational"]


class Rational(OpenCVDistortion):
    """OpenCV's eight coefficients, ROS ``rational_polynomial``, COLMAP ``FULL_OPENCV``.

    With r² = x² + y² and L = (1 + k1·r² + k2·r⁴ + k3·r⁶) / (1 + k4·r² + k5·r⁴ + k6·r⁶)::

        x' = x·L + 2·p1·x·y + p2·(r² + 2x²)
        y' = y·L + p1·(r² + 2y²) + 2·p2·x·y

    Source: OpenCV, CALIB_RATIONAL_MODEL. Its k4 is in the denominator; the k4 of Metashape multiplies r⁸ instead.
    """

    model: ClassVar[str] = "rational"
    example: ClassVar[Mapping[str, float]] = {"k1": 0.5, "k2": 0.05, "k4": 0.85, "k5": 0.15, "p2": 0.01}

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float
    k4: float
    k5: float
    k6: float
