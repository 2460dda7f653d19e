"""Brown–Conrady: radial and decentring distortion, the model of most aerial cameras."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from calibrary.distortion.opencv import OpenCVDistortion
from calibrary.distortion.valid_field import covers

__all__ = ["BrownConrady"]


class BrownConrady(OpenCVDistortion):
    """OpenCV's four and five coefficients, ROS ``plumb_bob``, COLMAP ``OPENCV``.

    With r² = x² + y²::

        x' = x·(1 + k1·r² + k2·r⁴ + k3·r⁶) + 2·p1·x·y + p2·(r² + 2x²)
        y' = y·(1 + k1·r² + k2·r⁴ + k3·r⁶) + p1·(r² + 2y²) + 2·p2·x·y

    Source: D. C. Brown, "Close-range camera calibration", 1971, in the form and order of OpenCV. DJI's DewarpData
    has this order too; Metashape swaps p1 and p2, and OpenSfM and Pix4D put k3 before p1.
    """

    model: ClassVar[str] = "brown"
    example: ClassVar[Mapping[str, float]] = {"k1": -0.28, "k2": 0.06, "p1": 0.01, "p2": 0.02}

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float = 0.0

    def covers(self, radius: float) -> bool:
        """See :meth:`Distortion.covers`; takes microseconds, because the check of a registry tests all entries."""
        return covers((self.k1, self.k2, self.k3), math.hypot(self.p1, self.p2), radius)
