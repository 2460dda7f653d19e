"""Refusal of a K that is not in pixels but in millimetres, or divided by an image side; it cannot be compared."""

from __future__ import annotations

from typing import Final

from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.jobs.diff.wording import frame_size

__all__ = ["check_units"]

SHORTEST: Final = 0.1
"""Smallest plausible fx / W: a perspective lens of 157°; a 360° fisheye has 0.16."""
NEAR: Final = 0.05
"""Relative tolerance at which an image side explains the ratio of two focal lengths."""
SENSORS_MM: Final = (1.0, 70.0)


def check_units(a: Calibration, b: Calibration) -> None:
    """Refuse a K with numbers that cannot be pixels of its image.

    Raises:
        InputError: the message names the likely unit and the factor.
    """
    for name, one, other in (("A", a, b), ("B", b, a)):
        K = one.intrinsics
        if K.fx >= SHORTEST * K.image_size[0]:
            continue
        guess = _unit(one, other) or "the unit is unknown"
        raise InputError(
            f"{name}: fx = {K.fx:.6g} in a {frame_size(K.image_size)} frame is not in pixels: {guess}; convert "
            "fx, fy, cx and cy to pixels and compare again"
        )


def _unit(one: Calibration, other: Calibration) -> str | None:
    K, true = one.intrinsics, other.intrinsics
    width, height = K.image_size
    if true.fx >= SHORTEST * true.image_size[0]:
        factor = true.fx * width / true.image_size[0] / K.fx
    elif K.cx > 0:
        # Both focal lengths are implausible; the principal point is near the centre in any unit.
        factor = width / (2 * K.cx)
    else:
        return None
    for side, pixels in (("width", width), ("height", height)):
        if abs(factor / pixels - 1) <= NEAR:
            longer = " (the longer side)" if pixels == max(width, height) else ""
            return f"it is probably divided by the {side}{longer}, × {pixels} gives pixels"
    sensor_mm = width / factor
    if SENSORS_MM[0] <= sensor_mm <= SENSORS_MM[1]:
        return (
            f"it is probably in millimetres of a sensor {sensor_mm:.3g} mm wide, × {factor:.5g} gives pixels"
        )
    return None
