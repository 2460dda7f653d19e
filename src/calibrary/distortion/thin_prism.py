"""The rational model with thin-prism terms, for lens elements or a cover glass that are not quite parallel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from calibrary.distortion.opencv import OpenCVDistortion

__all__ = ["ThinPrism"]


class ThinPrism(OpenCVDistortion):
    """OpenCV's twelve coefficients.

    With r² = x² + y² and L = (1 + k1·r² + k2·r⁴ + k3·r⁶) / (1 + k4·r² + k5·r⁴ + k6·r⁶)::

        x' = x·L + 2·p1·x·y + p2·(r² + 2x²) + s1·r² + s2·r⁴
        y' = y·L + p1·(r² + 2y²) + 2·p2·x·y + s3·r² + s4·r⁴

    Source: OpenCV, CALIB_THIN_PRISM_MODEL, after J. Weng, P. Cohen and M. Herniou, "Camera calibration with
    distortion models and accuracy evaluation", 1992.
    """

    model: ClassVar[str] = "thin-prism"
    example: ClassVar[Mapping[str, float]] = {"k1": -0.16, "s1": 0.06, "s3": 0.04}

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float
    k4: float
    k5: float
    k6: float
    s1: float
    s2: float
    s3: float
    s4: float
