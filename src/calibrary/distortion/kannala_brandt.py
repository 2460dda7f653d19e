"""Kannala–Brandt: a fisheye model in the angle from the axis, which can exceed 90°."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from calibrary.distortion.polynomial import Number, first_positive_root
from calibrary.distortion.radial_fisheye import RadialFisheye

__all__ = ["KannalaBrandt"]


class KannalaBrandt(RadialFisheye):
    """OpenCV's fisheye model, COLMAP ``OPENCV_FISHEYE``, Kalibr ``equidistant``.

    With θ the angle between the ray (X, Y, Z) and the axis, and R² = X² + Y²::

        θ  = atan2(R, Z)
        θd = θ·(1 + k1·θ² + k2·θ⁴ + k3·θ⁶ + k4·θ⁸)
        x' = θd·X / R        y' = θd·Y / R

    Source: J. Kannala and S. Brandt, "A generic camera model and calibration method for conventional,
    wide-angle, and fish-eye lenses", 2006, in the form of ``cv2.fisheye``. OpenCV and COLMAP take θ as
    atan(R/Z) and stop at 90°. With atan2 the same coefficients continue to the limit of the valid field, or to the
    point behind the camera. :meth:`distort_rays` and :meth:`undistort_to_rays` cover all of it. :meth:`distort` and
    :meth:`undistort` cover only the part in front of the camera, because x/z and y/z express no other.
    """

    model: ClassVar[str] = "kannala-brandt"
    example: ClassVar[Mapping[str, float]] = {"k1": 0.02, "k2": -0.01}

    k1: float
    k2: float
    k3: float
    k4: float

    def max_angle_rad(self) -> float:
        """Angle at which θd stops growing, at most π."""
        slope_by_square = (1.0, 3.0 * self.k1, 5.0 * self.k2, 7.0 * self.k3, 9.0 * self.k4)
        return min(math.pi, math.sqrt(first_positive_root(slope_by_square)))

    def _image(self, theta: Number) -> Number:
        """θd(θ)."""
        square = theta * theta
        value = square * self.k4
        for k in (self.k3, self.k2, self.k1):
            value += k
            value *= square
        value += 1.0
        value *= theta
        return value

    def _slope(self, theta: Number) -> Number:
        """dθd/dθ."""
        square = theta * theta
        value = square * (9.0 * self.k4)
        for slope in (7.0 * self.k3, 5.0 * self.k2, 3.0 * self.k1):
            value += slope
            value *= square
        value += 1.0
        return value
