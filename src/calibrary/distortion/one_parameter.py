"""Models of one parameter, with closed forms in both directions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from calibrary.arrays import FloatArray, np
from calibrary.distortion.base import Columns, Distortion, NoDistortion, by_columns, finite_pair, radially
from calibrary.distortion.omnidirectional import Omnidirectional, unit
from calibrary.errors import InputError
from calibrary.kernel import Form, Front

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


class Division(Omnidirectional):
    """COLMAP ``DIVISION`` and ``SIMPLE_DIVISION``; barrel distortion has k < 0.

    The distorted point (x', y'), with r'² = x'² + y'², has the direction (x', y', 1 + k·r'²). Conversely, for the
    ray (X, Y, Z) and R² = X² + Y²::

        x' = 2X / (Z + √(Z² − 4k·R²))        y' = 2Y / (Z + √(Z² − 4k·R²))

    With k < 0 the image contains every direction except straight backwards. With k > 0 it ends at r' = 1/√k, where
    R/Z = 1/(2√k).

    Source: A. Fitzgibbon, "Simultaneous linear estimation of multiple view geometry and lens distortion", 2001.
    """

    model: ClassVar[str] = "division"
    example: ClassVar[Mapping[str, float]] = {"k": -0.35}
    example_reach_deg: ClassVar[float] = 37.0

    k: float

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""

        def image(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
            x, y, z = unit(x, y, z)
            r2 = x * x + y * y
            inside = z * z - 4.0 * self.k * r2
            inside[~((inside > 0) & ((z > 0) | (self.k < 0)))] = math.nan
            reach = np.sqrt(inside)
            # The divisor is z + reach; behind the camera this cancels, so use the product of the two roots.
            divisor = np.where(z < 0, -4.0 * self.k * r2 / (reach - z), z + reach)
            return finite_pair(2.0 * x / divisor, 2.0 * y / divisor)

        return by_columns(image, rays, 3, 2)

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN from r' = 1/√k on."""

        def direction(x: FloatArray, y: FloatArray) -> Columns:
            r = np.hypot(x, y)
            bend = self.k * r * r
            bend[~(bend < 1.0)] = math.nan
            z = 1.0 + bend
            shrink = 1.0 / np.hypot(r, z)
            x, y = finite_pair(x * shrink, y * shrink)
            return x, y, z * shrink + 0.0 * x

        return by_columns(direction, xy, 2, 3)

    def max_angle_rad(self) -> float:
        """Angle at which the two solutions coincide; 180° for k < 0, 90° for a pinhole."""
        if self.k < 0:
            return math.pi
        return math.atan2(1.0, 2.0 * math.sqrt(self.k))

    def form(self) -> Form:
        """See :meth:`Distortion.form`."""
        return Form(Front.DIVISION, (self.k,))

    def equivalents(self) -> tuple[Distortion, ...]:
        """A pinhole, if k is zero."""
        return () if self.k else (NoDistortion(),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> Division | None:
        """Convert a pinhole; None for every other model."""
        return cls(k=0.0) if isinstance(other, NoDistortion) else None
