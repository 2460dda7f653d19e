"""Detection of rotated or mirrored images, and of principal points with another origin.

Rotating or mirroring an image moves the principal point to the other side of the centre and changes the sign
of the tangential terms (OpenCV's p1 belongs to y, p2 to x). Another origin only moves the principal point.
For exact numbers a hundredth of a pixel decides; for measured numbers the tangential terms must agree as
well, because noise and drift also move a principal point.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, Literal

from calibrary.calibration import Calibration, Intrinsics
from calibrary.image_size import same_aspect
from calibrary.jobs.diff.priors import std_of
from calibrary.jobs.diff.verdicts import Kind, Structural
from calibrary.jobs.diff.wording import frame_size

__all__ = ["is_turned", "is_turned_square", "of_orientation", "of_origin", "quarter_turn"]

EXACT_PX: Final = 0.02
SAME_FOCAL: Final = 2e-5
"""Relative difference of focal lengths below which both are from one solve: a second solve from other frames would
not repeat a focal length to a tenth of its noise."""
SIGMAS: Final = 4.0
LEAST_PX: Final = 1.0
"""A principal point closer to the centre than this does not show a mirroring."""
FLIPPED: Final = 0.02
NEAR_CENTRE: Final = 0.1
FROM_CENTRE: Final = 0.01
"""Tolerance, as a fraction of the image side, at which a principal point counted from the centre matches A's."""

WAYS: Final = {
    (True, True): (Kind.TURNED, "the frame was turned by 180°"),
    (True, False): (Kind.MIRRORED, "the frame was mirrored left to right"),
    (False, True): (Kind.MIRRORED, "the frame was mirrored top to bottom"),
}
FROM_THE_OTHER_SIDE: Final = {
    (True, True): "both count from the opposite corner",
    (True, False): "cx counts from the right edge",
    (False, True): "cy counts from the bottom edge",
}


def is_turned(a: Calibration, b: Calibration) -> bool:
    """Whether one image is in portrait and the other in landscape format."""
    size_a, size_b = a.intrinsics.image_size, b.intrinsics.image_size
    return same_aspect(size_a, size_b[::-1]) and not same_aspect(size_a, size_b)


def is_turned_square(a: Calibration, b: Calibration) -> bool:
    """Whether a square image was rotated by 90° or 270°; requires exactly matching numbers."""
    K, after = a.intrinsics, b.intrinsics
    side = K.image_size[0]
    if K.image_size != (side, side) or after.image_size != K.image_size or abs(K.cx - K.cy) < LEAST_PX:
        return False
    swapped = all(abs(x / y - 1) <= SAME_FOCAL for x, y in ((after.fx, K.fy), (after.fy, K.fx)))
    ways = ((side - K.cy, K.cx), (K.cy, side - K.cx))
    return swapped and any(math.hypot(after.cx - x, after.cy - y) <= EXACT_PX for x, y in ways)


def quarter_turn(a: Calibration, b: Calibration) -> str:
    """Direction of a quarter turn, as far as the principal point shows it, in words."""
    K, after = a.intrinsics, b.intrinsics
    scale = after.image_size[0] / K.image_size[1]
    clockwise = math.hypot(
        after.cx - scale * (K.image_size[1] - K.cy),
        after.cy - scale * K.cx,
    )
    other = math.hypot(after.cx - scale * K.cy, after.cy - scale * (K.image_size[0] - K.cx))
    if max(clockwise, other) < LEAST_PX or 0.5 < (clockwise + EXACT_PX) / (other + EXACT_PX) < 2.0:
        return "the frame was turned by 90°, one way or the other"
    return (
        "the frame was turned by 90° clockwise"
        if clockwise < other
        else "the frame was turned by 270° clockwise"
    )


def of_orientation(a: Calibration, b: Calibration) -> Iterator[Structural]:
    """Rotations by 180°, mirrorings, and principal points counted from another side, at equal image sizes."""
    K, after = a.intrinsics, b.intrinsics
    if is_turned_square(a, b):
        yield Structural(kind=Kind.TURNED, reason=quarter_turn(a, b))
        return
    if K.image_size != after.image_size or not _same_focal(a, b, SIGMAS):
        return
    width, height = K.image_size
    for sides, (kind, reason) in WAYS.items():
        centre = (width - K.cx if sides[0] else K.cx, height - K.cy if sides[1] else K.cy)
        moved = [abs(before - now) for before, now in zip((K.cx, K.cy), centre, strict=True)]
        if not any(moved) or min(way for way, side in zip(moved, sides, strict=True) if side) < LEAST_PX:
            continue
        off = math.hypot(after.cx - centre[0], after.cy - centre[1])
        slack = SIGMAS * math.hypot(std_of(a, "cx"), std_of(a, "cy"), std_of(b, "cx"), std_of(b, "cy"))
        flips = _tangential(a, b, sides)
        change = f"cx, cy were {K.cx:.2f}, {K.cy:.2f} and are {after.cx:.2f}, {after.cy:.2f} px"
        if off <= max(EXACT_PX, slack) and flips is True:
            yield Structural(kind=kind, reason=f"{change}, and p1, p2 changed sign with them: {reason}")
            return
        if off <= EXACT_PX and flips is None:
            yield Structural(
                kind=kind,
                reason=f"{change}: {reason}, or {FROM_THE_OTHER_SIDE[sides].replace('both', 'they')}",
            )
            return
        if off <= EXACT_PX and flips is False:
            yield Structural(kind=Kind.ORIGIN, reason=f"{change}: {FROM_THE_OTHER_SIDE[sides]}")
            return


def of_origin(a: Calibration, b: Calibration) -> Iterator[Structural]:
    """Offsets between origins of half a pixel, one pixel, or half the image."""
    K, after = a.intrinsics, b.intrinsics
    if K.image_size != after.image_size:
        return
    dx, dy = after.cx - K.cx, after.cy - K.cy
    if abs(dx - dy) <= EXACT_PX and _same_focal(a, b, 0.0):
        if abs(abs(dx) - 0.5) <= EXACT_PX:
            reason = (
                f"cx and cy both moved by {dx:+.3f} px and the focal length did not: one of the two counts from "
                "the centre of the first pixel, the other from its corner"
            )
            yield Structural(kind=Kind.HALF_PIXEL, reason=reason)
        elif abs(abs(dx) - 1.0) <= EXACT_PX:
            reason = (
                f"cx and cy both moved by {dx:+.3f} px and the focal length did not: one of the two counts pixels "
                "from 1, the other from 0"
            )
            yield Structural(kind=Kind.ORIGIN, reason=reason)
    sides: tuple[tuple[Literal["A", "B"], Intrinsics, Intrinsics], ...] = (("A", K, after), ("B", after, K))
    for name, counted, whole in sides:
        if _is_from_centre((counted.cx, counted.cy), (whole.cx, whole.cy), K.image_size):
            is_share = all(0.0 < centre < 1.0 for centre in (counted.cx, counted.cy))
            what = (
                "are probably shares of its width and height"
                if is_share
                else "count from the centre of the image, not from its corner"
            )
            reason = (
                f"cx, cy of {name} are {counted.cx:.2f}, {counted.cy:.2f} in a {frame_size(K.image_size)} frame: they "
                f"{what}"
            )
            yield Structural(kind=Kind.FROM_CENTRE, reason=reason, faulty=name)


def _is_from_centre(
    counted: tuple[float, float], whole: tuple[float, float], image_size: tuple[int, int]
) -> bool:
    near = []
    for offset, other, side in zip(counted, whole, image_size, strict=True):
        if abs(offset) > NEAR_CENTRE * side or abs(other - side / 2) > NEAR_CENTRE * side:
            return False
        near.append(abs(abs(offset) - abs(other - side / 2)) <= FROM_CENTRE * side)
    return all(near)


def _same_focal(a: Calibration, b: Calibration, sigmas: float) -> bool:
    K, after = a.intrinsics, b.intrinsics
    for name in ("fx", "fy"):
        slack = sigmas * math.hypot(std_of(a, name), std_of(b, name)) / getattr(K, name)
        if abs(getattr(after, name) / getattr(K, name) - 1) > max(SAME_FOCAL, slack):
            return False
    return True


def _tangential(a: Calibration, b: Calibration, sides: tuple[bool, bool]) -> bool | None:
    """Whether p1 and p2 changed sign in accordance with ``sides``; None if they are 0 or unknown."""
    lenses = [one.distortion.coefficients if one.distortion is not None else {} for one in (a, b)]
    if type(a.distortion) is not type(b.distortion) or not all(
        {"p1", "p2"} <= lens.keys() for lens in lenses
    ):
        return None
    said = []
    for name, flips in (("p2", sides[0]), ("p1", sides[1])):
        before, after = (lens[name] for lens in lenses)
        slack = max(FLIPPED * abs(before), SIGMAS * math.hypot(std_of(a, name), std_of(b, name)))
        if not flips or abs(before) <= slack:
            continue
        said.append(True if abs(after + before) <= slack else False if abs(after - before) <= slack else None)
    return said[0] if said and len(set(said)) == 1 else None
