"""Conversion of two calibrations to a common image size, so that their numbers can be subtracted.

A K that is not in pixels (in millimetres, or divided by an image side) is refused first.
"""

from __future__ import annotations

import math
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import FrameError, InputError
from calibrary.image_size import same_aspect
from calibrary.jobs.diff.lens_rays import axial
from calibrary.jobs.diff.wording import frame_size

FOCAL_SLACK = 0.2
"""Largest relative difference at which two focal lengths count as the same one with a crop."""

SHORTEST: Final = 0.1
"""Smallest plausible fx / W: a perspective lens of 157°; a 360° fisheye has 0.16."""
NEAR: Final = 0.05
"""Relative tolerance at which an image side explains the ratio of two focal lengths."""
NEAR_ANGLE: Final = 0.005
"""The same for degrees and radians, which no other unit is that near to."""
SENSORS_MM: Final = (1.0, 70.0)


class CommonFrame(Struct, frozen=True, kw_only=True):
    """Two calibrations at a common image size.

    Attributes:
        a, b: both at the smaller of the two image sizes.
        steps: operations on either, in words; empty if the image sizes were equal.
    """

    a: Calibration
    b: Calibration
    steps: tuple[str, ...] = ()


def common_frame(a: Calibration, b: Calibration) -> CommonFrame:
    """Scale the larger image to the smaller size; if their aspect ratios differ, crop it about its centre first.

    The focal lengths show whether a crop is 1:1 or resampled, because a camera's focal length hardly changes.

    Raises:
        FrameError: one image is rotated by 90°, or neither contains the other.
    """
    size_a, size_b = a.intrinsics.image_size, b.intrinsics.image_size
    if size_a == size_b:
        return CommonFrame(a=a, b=b)
    if same_aspect(size_a, size_b[::-1]) and not same_aspect(size_a, size_b):
        raise FrameError(
            f"{frame_size(size_a)} and {frame_size(size_b)} are one frame turned by 90°, and K does not say which way; "
            "provide both original files from the camera"
        )
    zoom = axial(b).fx / axial(a).fx
    if size_b[0] * size_b[1] <= size_a[0] * size_a[1]:
        brought, steps = _brought(a, size_b, zoom, "A")
        return CommonFrame(a=brought, b=b, steps=steps)
    brought, steps = _brought(b, size_a, 1 / zoom, "B")
    return CommonFrame(a=a, b=brought, steps=steps)


def _brought(
    larger: Calibration, target: ImageSize, zoom: float, name: str
) -> tuple[Calibration, tuple[str, ...]]:
    """Convert ``larger`` to the image size ``target``; the new fx is ``zoom`` times the old one."""
    size = larger.intrinsics.image_size
    same = same_aspect(size, target)
    if same and abs(zoom * size[0] / target[0] - 1) < abs(zoom - 1):
        return larger.scaled(target), (f"{name} scaled {frame_size(size)} → {frame_size(target)}",)
    by = _resampling(size, target, zoom)
    part = (min(size[0], round(target[0] / by)), min(size[1], round(target[1] / by)))
    box = ((size[0] - part[0]) / 2, (size[1] - part[1]) / 2, *part)
    cropped = larger.cropped(box)
    steps = [f"{name} cropped {frame_size(size)} → {frame_size(part)} about its centre"]
    if part != target:
        if not same_aspect(part, target):
            raise FrameError(
                f"a {frame_size(target)} image is neither {frame_size(size)} scaled nor a crop of it; "
                "compare calibrations of the same sensor crop"
            )
        cropped = cropped.scaled(target)
        steps.append(f"scaled to {frame_size(target)}")
    return cropped, tuple(steps)


def _resampling(size: ImageSize, target: ImageSize, zoom: float) -> float:
    """Scale from ``size`` to ``target``: 1:1, or one side uncropped, whichever is closest to ``zoom``."""
    choices = [1.0, target[0] / size[0], target[1] / size[1]]
    held = [
        by
        for by in choices
        if abs(by / zoom - 1) <= FOCAL_SLACK
        and all(t / by <= s * 1.01 for s, t in zip(size, target, strict=True))
    ]
    if not held:
        raise FrameError(
            f"a {frame_size(target)} image is neither {frame_size(size)} scaled nor a crop of it; "
            "compare calibrations of the same sensor crop"
        )
    return min(held, key=lambda by: abs(by / zoom - 1))


def check_units(a: Calibration, b: Calibration) -> None:
    """Refuse a K with numbers that cannot be pixels of its image.

    Raises:
        InputError: the message names the likely unit and the factor.
    """
    for name, one, other in (("A", a, b), ("B", b, a)):
        K = one.intrinsics
        if axial(one).fx >= SHORTEST * K.image_size[0]:
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
    if abs(factor * math.pi / 180 - 1) <= NEAR_ANGLE:
        return (
            "it was probably multiplied by π/180, as if it were an angle in degrees: "
            f"× {180 / math.pi:.5g} gives pixels"
        )
    sensor_mm = width / factor
    if SENSORS_MM[0] <= sensor_mm <= SENSORS_MM[1]:
        return (
            f"it is probably in millimetres of a sensor {sensor_mm:.3g} mm wide, × {factor:.5g} gives pixels"
        )
    return None
