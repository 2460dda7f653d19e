"""The field-of-view model: one parameter, the field of view of an ideal fisheye lens."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Distortion, radially
from calibrary.distortion.none import NoDistortion
from calibrary.errors import InputError

__all__ = ["FieldOfView"]

STRAIGHT = 1e-10
"""Below this ω the distortion is less than a rounding error, and the formula would divide two rounding errors."""


class FieldOfView(Distortion):
    """Kalibr ``fov``, COLMAP ``FOV``, AliceVision ``fisheye1``, RealSense ``F-Theta``; ω in radians.

    With r² = x² + y²::

        r' = atan(2·r·tan(ω/2)) / ω        x' = x·r'/r        y' = y·r'/r

    Near the axis the camera is a pinhole with the focal length fx·2·tan(ω/2)/ω. All directions in front of it have
    r' < π/2ω. For |ω| < 0.01 COLMAP replaces the formula by a series of its inverse, which moves points by up to a
    tenth of a pixel. calibrary uses the formula.

    Source: F. Devernay and O. Faugeras, "Straight lines have to be straight", 2001.

    Raises:
        InputError: ω is not finite, or its magnitude is 180° or more.
    """

    model: ClassVar[str] = "field-of-view"
    example: ClassVar[Mapping[str, float]] = {"omega": 0.9}
    example_reach_deg: ClassVar[float] = 63.0

    omega: float

    def __post_init__(self) -> None:
        Distortion.__post_init__(self)
        if abs(self.omega) >= math.pi:
            raise InputError(
                f"omega is {self.omega:g} rad, expected an angle below 180° (3.1416 rad); is it in degrees?",
                place="omega",
            )

    def distort(self, xy: FloatArray) -> FloatArray:
        """Undistorted to distorted."""
        if abs(self.omega) <= STRAIGHT:
            return radially(xy, np.positive)
        spread = 2.0 * math.tan(self.omega / 2)
        return radially(xy, lambda r: np.arctan(r * spread) / self.omega)

    def undistort(self, xy: FloatArray) -> FloatArray:
        """Distorted to undistorted; NaN at and beyond the image of 90°."""
        if abs(self.omega) <= STRAIGHT:
            return radially(xy, np.positive)
        spread = 2.0 * math.tan(self.omega / 2)

        def undistorted(r: FloatArray) -> FloatArray:
            angle = np.abs(r * self.omega)
            angle[~(angle < math.pi / 2)] = math.nan
            return np.tan(angle) / abs(spread)

        return radially(xy, undistorted)

    def valid_radius(self) -> float:
        """Infinite: the arc tangent is monotonic everywhere."""
        return math.inf

    def equivalents(self) -> tuple[Distortion, ...]:
        """A pinhole, if ω is zero."""
        return () if self.omega else (NoDistortion(),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> FieldOfView | None:
        """Convert a pinhole; None for every other model."""
        return cls(omega=0.0) if isinstance(other, NoDistortion) else None
