"""Differences that are no drift but a change of kind: a crop, a swap, a convention, a tag taken for another.

Each signature is exact enough that noise does not wear it: two numbers that moved by just half a pixel while no other
did, focal lengths in the very ratio of the frames. How exact depends on what is compared: a focal length from EXIF
is no crop of a measured one for being 3 % off. A signature says what probably happened; it never repairs anything.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from enum import StrEnum

import numpy as np

from calibrary.calibration import Calibration, ImageSize, same_aspect
from calibrary.distortion import NoDistortion
from calibrary.jobs.diff.frames import FOCAL_SLACK
from calibrary.jobs.diff.priors import PRIORS
from calibrary.records import Record

__all__ = ["Kind", "Structural", "signatures"]

SAME_RATIO = 0.01
"""How near a ratio of focal lengths must lie to a ratio of sides to be explained by it, were both exact."""

SAME_FIELD = 0.02
"""A frame of the same shape whose fx over its width moved by more than this shows another part of the sensor."""

STRETCH = 0.01
"""A change of fx / fy by more than this is no lens: pixels that were square are not any more."""

SIGMAS = 3.0
"""Focal lengths that are not known to these limits are held to this many of their standard deviations."""

HALF_PIXEL_SLACK_PX = 0.02
SAME_FOCAL = 2e-5
"""One solve, written twice: another from other frames would not repeat a focal length to a tenth of its noise."""

LEAK_SLACK = 0.02
"""Of a sensor's nominal size and an EXIF focal length, each rounded; a 35 mm equivalent is, to whole millimetres."""

MEASURABLE_PX = 2.0
"""A lens that bends the corners by less may as well have none."""

CORRECTED_PX, CORRECTED_SHARE = 0.05, 0.05
"""What a camera that corrects its lens leaves of the bending, or a calibration of its frames makes up by noise."""

SWAPPED_EXACTLY = 1e-4
SWAPPED_ABOUT = 0.1
"""Of the difference between p1 and p2, where nothing says how well they are known."""
NOT_THE_SAME, AS_SWAPPED = 25.0, 9.21
"""χ² of two numbers: five sigmas off as they stand, and inside 99 % when they change places."""

FULL_FRAME_MM = (36.0, 24.0)


class Kind(StrEnum):
    """What changed."""

    RESIZE = "resize"
    CROP = "crop"
    PORTRAIT = "portrait"
    DEWARP_ON = "dewarp switched on"
    DEWARP_OFF = "dewarp switched off"
    HALF_PIXEL = "half-pixel convention"
    TANGENTIAL_SWAP = "p1 and p2 swapped"
    DIRECTION = "distortion the other way round"
    EQUIVALENT_LEAK = "35 mm equivalent"
    STRETCH = "transcode"


class Structural(Record):
    """One change of kind.

    Attributes:
        kind: which.
        reason: the numbers that show it, and what it means, in one sentence.
    """

    kind: Kind
    reason: str


def signatures(a: Calibration, b: Calibration) -> tuple[Structural, ...]:
    """Every change of kind that shows between ``a`` and the later ``b``, each in its own frame."""
    return (
        *_of_frames(a, b),
        *_of_focal_lengths(a, b),
        *_of_principal_points(a, b),
        *_of_distortions(a, b),
    )


def _of_frames(a: Calibration, b: Calibration) -> Iterator[Structural]:
    before, after = a.intrinsics, b.intrinsics
    size_a, size_b = before.image_size, after.image_size
    if size_a == size_b or _is_stretched(a, b):
        return
    sizes = f"{_x(size_a)} became {_x(size_b)}"
    if _is_turned(a, b):
        yield Structural(kind=Kind.PORTRAIT, reason=f"{sizes}: the frame was turned by 90°")
        return
    zoom, slack = after.fx / before.fx, _slack(a, b, SAME_RATIO)
    same = same_aspect(size_a, size_b)
    if same and abs(zoom * size_a[0] / size_b[0] - 1) <= slack:
        reason = f"{sizes} and fx went with it, × {zoom:.4g}: the frame was resampled"
        yield Structural(kind=Kind.RESIZE, reason=reason)
    elif _is_part(size_a, size_b, zoom, same=same) or _is_part(size_b, size_a, 1 / zoom, same=same):
        what = "unchanged" if abs(zoom - 1) <= slack else f"× {zoom:.4g}"
        reason = f"{sizes} with fx {what}: another part of the sensor is used"
        yield Structural(kind=Kind.CROP, reason=reason)


def _slack(a: Calibration, b: Calibration, least: float) -> float:
    """By how much focal lengths may differ, relative, without that meaning anything."""
    return max(least, SIGMAS * math.hypot(_focal_std(a), _focal_std(b)))


def _focal_std(calibration: Calibration) -> float:
    """Of fx, relative: as measured, else what its grade is worth."""
    quality = calibration.quality
    if quality is not None and "fx" in quality.std:
        return quality.std["fx"] * math.sqrt(quality.inflation) / calibration.intrinsics.fx
    return PRIORS[calibration.grade].focal


def _is_turned(a: Calibration, b: Calibration) -> bool:
    size_a, size_b = a.intrinsics.image_size, b.intrinsics.image_size
    return same_aspect(size_a, size_b[::-1]) and not same_aspect(size_a, size_b)


def _is_stretched(a: Calibration, b: Calibration) -> bool:
    before, after = a.intrinsics, b.intrinsics
    aspects = math.hypot(PRIORS[a.grade].aspect, PRIORS[b.grade].aspect)
    stretch = (after.fx / after.fy) / (before.fx / before.fy)
    return abs(stretch - 1) > max(STRETCH, SIGMAS * aspects) and not _is_turned(a, b)


def _is_part(whole: ImageSize, part: ImageSize, zoom: float, *, same: bool) -> bool:
    """Whether ``part``, enlarged ``zoom`` times, fits inside ``whole`` along both sides.

    A frame of another shape is another part of the sensor even where the focal length moved besides.
    """
    slack = SAME_RATIO if same else FOCAL_SLACK
    return all(small / zoom <= large * (1 + slack) for large, small in zip(whole, part, strict=True))


def _of_focal_lengths(a: Calibration, b: Calibration) -> Iterator[Structural]:
    before, after = a.intrinsics, b.intrinsics
    if _is_stretched(a, b):
        reason = (
            f"fx / fy was {before.fx / before.fy:.4f} and is {after.fx / after.fy:.4f}: a frame that was "
            "transcoded or stretched, or a wrong side of the sensor"
        )
        yield Structural(kind=Kind.STRETCH, reason=reason)
        return
    zoom = (after.fx / after.image_size[0]) / (before.fx / before.image_size[0])
    if abs(zoom - 1) <= _slack(a, b, SAME_FIELD) or not same_aspect(before.image_size, after.image_size):
        return
    leak = _equivalent(a, zoom) or _equivalent(b, 1 / zoom)
    if leak is not None:
        reason = (
            f"focal lengths differ × {max(zoom, 1 / zoom):.3f}, the crop factor of a sensor {leak:.1f} mm wide: "
            "a 35 mm equivalent stands where the focal length should"
        )
        yield Structural(kind=Kind.EQUIVALENT_LEAK, reason=reason)
    elif before.image_size == after.image_size:
        reason = f"fx × {zoom:.4f} in a frame of the same size: another part of the sensor fills it, or another lens"
        yield Structural(kind=Kind.CROP, reason=reason)


def _equivalent(true: Calibration, ratio: float) -> float | None:
    """The width in mm of the sensor whose crop factor ``ratio`` is, if ``true`` states its focal length."""
    focal_mm, K = true.camera.focal_mm, true.intrinsics
    if not focal_mm or ratio < 1.2:
        return None
    width_mm, height_mm = (focal_mm * side / f for side, f in zip(K.image_size, (K.fx, K.fy), strict=True))
    by_width = FULL_FRAME_MM[0] / width_mm
    by_diagonal = math.hypot(*FULL_FRAME_MM) / math.hypot(width_mm, height_mm)
    slack = LEAK_SLACK + 0.5 / (focal_mm * ratio)
    return width_mm if any(abs(ratio / factor - 1) <= slack for factor in (by_width, by_diagonal)) else None


def _of_principal_points(a: Calibration, b: Calibration) -> Iterator[Structural]:
    before, after = a.intrinsics, b.intrinsics
    dx, dy = after.cx - before.cx, after.cy - before.cy
    moved = abs(abs(dx) - 0.5) <= HALF_PIXEL_SLACK_PX and abs(dx - dy) <= HALF_PIXEL_SLACK_PX
    zooms = after.fx / before.fx, after.fy / before.fy
    if moved and before.image_size == after.image_size and all(abs(zoom - 1) <= SAME_FOCAL for zoom in zooms):
        reason = (
            f"cx and cy both moved by {dx:+.3f} px and the focal length did not: one of the two counts from "
            "the centre of the first pixel, the other from its corner"
        )
        yield Structural(kind=Kind.HALF_PIXEL, reason=reason)


def _of_distortions(a: Calibration, b: Calibration) -> Iterator[Structural]:
    if a.distortion is None or b.distortion is None:
        return
    bend_a, bend_b = _bend_px(a), _bend_px(b)
    if bend_a > MEASURABLE_PX and _is_corrected(b, bend_b, bend_a):
        reason = (
            f"a lens that bends the corners by {bend_a:.1f} px has {_left(bend_b)} now: "
            "the camera corrects it"
        )
        yield Structural(kind=Kind.DEWARP_ON, reason=reason)
        return
    if bend_b > MEASURABLE_PX and _is_corrected(a, bend_a, bend_b):
        reason = (
            f"distortion of {bend_b:.1f} px in the corners where there was {_left(bend_a)}: "
            "the camera corrects no more"
        )
        yield Structural(kind=Kind.DEWARP_OFF, reason=reason)
        return
    one, two = a.distortion.coefficients, b.distortion.coefficients
    # Where the frame was turned, the two change places by right.
    if {"p1", "p2"} <= one.keys() & two.keys() and _is_swapped(a, b, one, two) and not _is_turned(a, b):
        reason = f"p1 = {one['p1']:.4g} and p2 = {one['p2']:.4g} changed places: Metashape's order against OpenCV's"
        yield Structural(kind=Kind.TANGENTIAL_SWAP, reason=reason)
    k1, k2 = one.get("k1", 0.0), two.get("k1", 0.0)
    if k1 * k2 < 0 and min(bend_a, bend_b) > MEASURABLE_PX and 0.5 < -k1 / k2 < 2.0:
        reason = f"k1 was {k1:.4g} and is {k2:.4g}: one of the two maps observed to ideal, the other ideal to observed"
        yield Structural(kind=Kind.DIRECTION, reason=reason)


def _is_corrected(calibration: Calibration, bend_px: float, raw_px: float) -> bool:
    if isinstance(calibration.distortion, NoDistortion):
        return True
    return bend_px < CORRECTED_PX or bend_px < CORRECTED_SHARE * raw_px


def _left(bend_px: float) -> str:
    return "no distortion" if bend_px < CORRECTED_PX else f"{bend_px:.2g} px of distortion"


def _bend_px(calibration: Calibration) -> float:
    """How far the distortion moves what would be seen half way to the corners and in them, at most."""
    K = calibration.intrinsics
    (width, height), centre = K.image_size, (K.cx, K.cy)
    corners = np.array([(x * width, y * height) for x in (0, 1) for y in (0, 1)], dtype=float)
    seen = np.vstack([corners, (corners + centre) / 2])
    rays = calibration.unproject(seen)
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]
    straight = np.column_stack([K.fx * x + K.skew * y + K.cx, K.fy * y + K.cy])
    moved = np.hypot(*(straight - seen).T)[rays[:, 2] > 0]
    moved = moved[np.isfinite(moved)]
    return float(moved.max()) if moved.size else math.inf


def _is_swapped(a: Calibration, b: Calibration, one: Mapping[str, float], two: Mapping[str, float]) -> bool:
    apart = abs(one["p1"] - one["p2"])
    across = max(abs(one["p1"] - two["p2"]), abs(one["p2"] - two["p1"]))
    if not apart > 1e-5:
        return False
    stds = [_std(a, "p1"), _std(a, "p2"), _std(b, "p1"), _std(b, "p2")]
    if across <= SWAPPED_EXACTLY * apart or not all(stds):
        return across < SWAPPED_ABOUT * apart
    variance = sum(std**2 for std in stds) / 2
    as_it_is = ((one["p1"] - two["p1"]) ** 2 + (one["p2"] - two["p2"]) ** 2) / variance
    changed = ((one["p1"] - two["p2"]) ** 2 + (one["p2"] - two["p1"]) ** 2) / variance
    return as_it_is > NOT_THE_SAME and changed < AS_SWAPPED


def _std(calibration: Calibration, name: str) -> float:
    """0 where nothing is known."""
    quality = calibration.quality
    return quality.std.get(name, 0.0) * math.sqrt(quality.inflation) if quality is not None else 0.0


def _x(size: ImageSize) -> str:
    return f"{size[0]}×{size[1]}"
