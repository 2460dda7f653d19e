"""Conversion of two calibrations to a common image size, so that their numbers can be subtracted.

A K that is not in pixels (in millimetres, or divided by an image side) is refused first.
"""

from __future__ import annotations

import math
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import InputError
from calibrary.image_size import same_aspect
from calibrary.jobs.diff.fields import (
    SIGMAS,
    focal_slack,
    is_on_its_side,
    is_stretched,
    leaked,
    names_differ,
    of_names,
    stretched,
)
from calibrary.jobs.diff.lens_rays import axial, is_one_lens, pinholes
from calibrary.jobs.diff.turns import quarter_turn
from calibrary.jobs.diff.uncertainty import PRIORS, std_of
from calibrary.jobs.diff.verdicts import Kind, Structural
from calibrary.jobs.diff.wording import frame_size

SAME_RATIO: Final = 0.01
"""Relative tolerance between a ratio of focal lengths and a ratio of image sides, if both are exact."""
RESAMPLED: Final = (1.0, 1 / 2, 1 / 3, 1 / 4)
"""Factors by which cameras resample a part of the sensor, besides those that make it fill a side of the frame."""
USUAL: Final = 0.03
"""Relative tolerance of these."""
VERY_LENS: Final = 0.05
"""Relative difference of the distortion below which a part of the sensor may be resampled by any factor."""

SHORTEST: Final = 0.1
"""Smallest plausible fx / W: a perspective lens of 157°; a 360° fisheye has 0.16."""
NEAR: Final = 0.05
"""Relative tolerance at which an image side explains the ratio of two focal lengths."""
NEAR_ANGLE: Final = 0.005
"""The same for degrees and radians, which no other unit is that near to."""
SENSORS_MM: Final = (1.0, 70.0)


class CommonFrame(Struct, frozen=True, kw_only=True):
    """Two calibrations of images of any two sizes.

    Attributes:
        a, b: both at the smaller of the two image sizes, or as they are if nothing brings them there.
        cause: of the two sizes; None if they are equal.
        steps: operations on either, in words; empty if the image sizes were equal.
    """

    a: Calibration
    b: Calibration
    cause: Structural | None = None
    steps: tuple[str, ...] = ()

    @property
    def is_common(self) -> bool:
        """Whether both are at one image size, so that their numbers can be subtracted."""
        return self.a.intrinsics.image_size == self.b.intrinsics.image_size


def common_frame(a: Calibration, b: Calibration) -> CommonFrame:
    """Scale the larger image to the smaller size, or take the part of it that the smaller one shows.

    The focal lengths show whether a part is 1:1 or resampled, because a camera's focal length hardly changes.
    """
    size_a, size_b = a.intrinsics.image_size, b.intrinsics.image_size
    if size_a == size_b:
        return CommonFrame(a=a, b=b)
    one, two = (a, b) if a.distortion is not None and b.distortion is not None else pinholes(a, b)
    sizes = f"{frame_size(size_a)} became {frame_size(size_b)}"
    if is_stretched(one, two):
        return CommonFrame(a=a, b=b, cause=stretched(one, two))
    if is_on_its_side(a, b):
        return CommonFrame(
            a=a, b=b, cause=Structural(kind=Kind.TURNED, reason=f"{sizes}: {quarter_turn(one, two)}")
        )
    zoom, slack = axial(two).fx / axial(one).fx, focal_slack(a, b, SAME_RATIO)
    what = "unchanged" if abs(zoom - 1) <= slack else f"× {zoom:.4g}"
    is_scaled = same_aspect(size_a, size_b)
    if is_scaled and abs(zoom * size_a[0] / size_b[0] - 1) <= slack:
        reason = f"{sizes} and the focal length went with it, {what}: the frame was resampled"
        return _brought(a, b, Structural(kind=Kind.RESIZE, reason=reason), None)
    if is_scaled and (leak := leaked(one, two)) is not None:
        return _brought(a, b, leak, None)
    by = _resampling(one, two, zoom, slack) if _is_larger(a, b) else _resampling(two, one, 1 / zoom, slack)
    if names_differ(a.camera, b.camera):
        cause = of_names(a, b)
    elif by is not None:
        reason = f"{sizes} with the focal length {what}: another part of the sensor is used"
        cause = Structural(kind=Kind.CROP, reason=reason)
    else:
        is_lens = is_one_lens(one, two) is not False
        lens = "no usual crop explains it" if is_lens else "the distortion is another as well"
        reason = f"{sizes} with the focal length {what}, and {lens}: another camera or another lens"
        cause = Structural(kind=Kind.OTHER_CAMERA, reason=reason)
    return CommonFrame(a=a, b=b, cause=cause) if by is None else _brought(a, b, cause, by)


def _is_larger(a: Calibration, b: Calibration) -> bool:
    return math.prod(a.intrinsics.image_size) >= math.prod(b.intrinsics.image_size)


def _resampling(whole: Calibration, part: Calibration, zoom: float, slack: float) -> float | None:
    """Scale of a part of a frame: a usual one, or any of the very lens; None if it can be no part of it."""
    size, target = whole.intrinsics.image_size, part.intrinsics.image_size
    is_lens = is_one_lens(whole, part)
    usual = (*RESAMPLED, *(one / of for one, of in zip(target, size, strict=True)))
    near = [by for by in usual if abs(zoom / by - 1) <= max(USUAL, slack)]
    if not near and is_one_lens(whole, part, within=VERY_LENS):
        near = [zoom]
    fitting = [
        by for by in near if all(t / by <= s * (1 + SAME_RATIO) for s, t in zip(size, target, strict=True))
    ]
    return min(fitting, key=lambda by: abs(by / zoom - 1)) if fitting and is_lens is not False else None


def _brought(a: Calibration, b: Calibration, cause: Structural, by: float | None) -> CommonFrame:
    """The larger of the two at the size of the smaller: scaled, or its part that was resampled ``by`` as much."""
    name, larger, other = ("A", a, b) if _is_larger(a, b) else ("B", b, a)
    size, target = larger.intrinsics.image_size, other.intrinsics.image_size
    if by is None:
        found, steps = larger, [f"{name} scaled {frame_size(size)} → {frame_size(target)}"]
    else:
        part = (min(size[0], round(target[0] / by)), min(size[1], round(target[1] / by)))
        (left, top), where = _corner(larger, other, part)
        found = larger.cropped((left, top, *part))
        steps = [f"{name} cropped {frame_size(size)} → {frame_size(part)} {where}"]
        if part != target:
            steps.append(f"scaled to {frame_size(target)}")
    if found.intrinsics.image_size != target:
        found = found.scaled(target)
    sides = (found, b) if name == "A" else (a, found)
    return CommonFrame(a=sides[0], b=sides[1], cause=cause, steps=tuple(steps))


def _corner(whole: Calibration, part: Calibration, size: ImageSize) -> tuple[tuple[float, float], str]:
    """Corner of a part by the principal point, which is at one place of the sensor; of the middle if σ allows it."""
    K, seen = whole.intrinsics, part.intrinsics
    room = [side - cut for side, cut in zip(K.image_size, size, strict=True)]
    by = size[0] / seen.image_size[0]
    at = [K.cx - by * seen.cx, K.cy - by * seen.cy]
    slack = SIGMAS * math.hypot(*(scale * _centre_std(one) for one, scale in ((whole, 1.0), (part, by))))
    is_middle = all(abs(place - free / 2) <= max(slack, 1.0) for place, free in zip(at, room, strict=True))
    is_inside = all(-1.0 <= place <= free + 1.0 for place, free in zip(at, room, strict=True))
    # A K that was not moved with the crop does not show its corner.
    if is_middle or not is_inside or max(at) <= 1.0:
        return (room[0] / 2, room[1] / 2), "about its centre"
    left, top = (min(max(round(place), 0), free) for place, free in zip(at, room, strict=True))
    return (left, top), f"at ({left}, {top})"


def _centre_std(calibration: Calibration) -> float:
    usual = PRIORS[calibration.grade].centre * calibration.intrinsics.image_size[0]
    return max(std_of(calibration, "cx"), std_of(calibration, "cy")) or usual


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
