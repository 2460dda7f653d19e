"""Conversion of lengths in mm: sensor size, and coefficients of radii in mm to normalised coordinates.

A term c·rⁿ of a correction in mm, with r in mm, equals c·fⁿ⁻¹·(r/f)ⁿ in units of the focal length f.
"""

from __future__ import annotations

from collections.abc import Sequence

from calibrary.calibration import Calibration
from calibrary.parsers import text as strict
from calibrary.parsers.convention import SizeMm

RADIAL_POWERS = (2, 4, 6, 8)
NOMINAL_WIDTH_MM = 36.0
"""Sensor width assumed if none is stated; it cancels out if all lengths in a file depend on it."""


def sensor_extra(key: str, sensor_mm: SizeMm) -> tuple[str, str]:
    """The sensor size as an extra of a calibration."""
    return key, f"{sensor_mm[0]!r}x{sensor_mm[1]!r}"


def sensor_mm_of(calibration: Calibration, key: str) -> SizeMm:
    """The sensor size in mm: as read, else from the nominal focal length, else a nominal one.

    Args:
        calibration: to be written.
        key: of the extra made by :func:`sensor_extra`.
    """
    K = calibration.intrinsics
    width, height = K.image_size
    for name, value in calibration.extras:
        if name == key:
            sides = [strict.number(side) for side in value.split("x")]
            if len(sides) == 2 and min(sides) > 0:
                return sides[0], sides[1]
    focal_mm = calibration.camera.focal_mm
    sensor_width = width * focal_mm / K.fx if focal_mm else NOMINAL_WIDTH_MM
    return sensor_width, sensor_width * height / width


def normalised(values: Sequence[float], focal: float, powers: Sequence[int] = RADIAL_POWERS) -> list[float]:
    """Each value times its power of the focal length; an overflow gives infinity, not an error."""
    return [value * _power(focal, power) for value, power in zip(values, powers, strict=False)]


def per_length(values: Sequence[float], focal: float, powers: Sequence[int] = RADIAL_POWERS) -> list[float]:
    """The inverse of :func:`normalised`."""
    return [value / _power(focal, power) for value, power in zip(values, powers, strict=False)]


def _power(focal: float, power: int) -> float:
    """The power by multiplication, because ``**`` raises an error on overflow."""
    product = 1.0
    for _ in range(power):
        product *= focal
    return product
