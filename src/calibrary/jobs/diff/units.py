"""A K that is not in pixels: in millimetres, or divided by a side of the frame. No comparison is possible with it."""

from __future__ import annotations

from typing import Final

from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.jobs.diff.wording import frame_size

__all__ = ["check_units"]

SHORTEST: Final = 0.1
"""Focal length over width: a perspective lens of 157°; a fisheye that sees everything around it has 0.16."""
NEAR: Final = 0.05
"""How near the ratio of two focal lengths must lie to a side of the frame to be explained by it."""
SENSORS_MM: Final = (1.0, 70.0)


def check_units(a: Calibration, b: Calibration) -> None:
    """Refuse a K whose numbers cannot be pixels of its frame.

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
        # Neither focal length can be believed; the principal point lies near the middle in any unit.
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
