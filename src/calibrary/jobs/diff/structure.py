"""Structural changes, as opposed to drift: a crop, swapped values, another convention, a confused tag.

Each test is strict enough that noise cannot pass it: two numbers moved by exactly half a pixel while the
others did not change, or focal lengths in the exact ratio of the image sizes. The tolerance depends on what
is compared: an EXIF focal length that differs by 3 % from a measured one is not a crop. A test states what
probably happened; it never repairs anything.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Literal

import numpy as np

from calibrary.calibration import Calibration, CameraKey, ImageSize
from calibrary.distortion import NoDistortion
from calibrary.image_size import same_aspect
from calibrary.jobs.diff.frames import FOCAL_SLACK
from calibrary.jobs.diff.numbers import Numbers
from calibrary.jobs.diff.orientation import (
    is_turned,
    is_turned_square,
    of_orientation,
    of_origin,
    quarter_turn,
)
from calibrary.jobs.diff.origin import Common, common_numbers, is_same
from calibrary.jobs.diff.priors import PRIORS, std_of
from calibrary.jobs.diff.scale import of_scale
from calibrary.jobs.diff.verdicts import Kind, Structural
from calibrary.jobs.diff.wording import frame_size, listed, pixels

__all__ = ["other_camera", "signatures"]

SAME_RATIO = 0.01
"""Relative tolerance between a ratio of focal lengths and a ratio of image sides, if both are exact."""

SAME_FIELD = 0.02
"""Relative change of fx / W at equal aspect ratio above which the image shows another part of the sensor."""

STRETCH = 0.01
"""A larger relative change of fx / fy is not due to the lens: square pixels became non-square."""

SIGMAS = 3.0
"""Tolerance in standard deviations for focal lengths that are not known well enough for these limits."""

LEAK_SLACK = 0.02
"""Relative tolerance for a sensor's nominal size and an EXIF focal length, both rounded (a 35 mm equivalent to whole
mm)."""

MEASURABLE_PX = 2.0
"""A lens that displaces the corners by less counts as free of distortion."""

OTHER_LENS = 0.01
"""RMS difference over the image after the best rotation, as a fraction of the longer side, above which it is another
lens."""

ONE_LENS = 0.3
"""Relative difference of the distortion at one angle below which both belong to one lens."""

CORRECTED_PX, CORRECTED_SHARE = 0.05, 0.05
"""Distortion that remains after in-camera correction, or that a calibration of such images finds from noise: in px,
and as a fraction of the full distortion."""

SWAPPED_EXACTLY = 1e-4
SWAPPED_ABOUT = 0.1
"""Tolerance of swapped values, as a fraction of the difference between p1 and p2, if no uncertainty is known."""
NOT_THE_SAME, AS_SWAPPED = 25.0, 9.21
"""χ² of two values: at least 5 σ apart as stated, and within 99 % after swapping."""

FULL_FRAME_MM = (36.0, 24.0)


def signatures(a: Calibration, b: Calibration) -> tuple[Structural, ...]:
    """All structural changes between ``a`` and the later ``b``, each at its own image size."""
    scale = tuple(of_scale(a, b))
    if scale:
        return scale
    return (
        *_of_frames(a, b),
        *_of_focal_lengths(a, b),
        *of_orientation(a, b),
        *of_origin(a, b),
        *_of_distortions(a, b),
    )


def other_camera(
    a: Calibration, b: Calibration, numbers: Numbers, named: tuple[Structural, ...], *, matters: bool
) -> Iterator[Structural]:
    """Report another camera or lens if the projections or stated names differ and nothing else explains it."""
    if numbers.common.is_one_measurement or not matters or any(one.kind is not Kind.RESIZE for one in named):
        return
    seen = numbers.difference
    one, two = (side.camera for side in (a, b))
    if _names_differ(one, two):
        yield Structural(
            kind=Kind.OTHER_CAMERA, reason=f"A is of {one} and B of {two}: two cameras, or two lenses"
        )
    elif seen.rms_px >= OTHER_LENS * max(seen.image_size) and numbers.lens_compared:
        yield Structural(
            kind=Kind.OTHER_CAMERA,
            reason=f"projections differ by {pixels(seen.rms_px)} rms, more than any drift: another lens, or another "
            "camera",
        )


def _names_differ(one: CameraKey, two: CameraKey) -> bool:
    """Whether both state a model, serial number or sub-camera and these differ, allowing for spellings of a model."""
    if one.model and two.model:
        mine, others = (set(re.findall(r"[a-z0-9]+", key.model.lower())) for key in (one, two) if key.model)
        if not mine & others:
            return True
    pairs = ((one.serial, two.serial), (one.sub_camera, two.sub_camera))
    return any(x is not None and y is not None and x != y for x, y in pairs)


def _of_frames(a: Calibration, b: Calibration) -> Iterator[Structural]:
    before, after = a.intrinsics, b.intrinsics
    size_a, size_b = before.image_size, after.image_size
    if size_a == size_b or _is_stretched(a, b):
        return
    sizes = f"{frame_size(size_a)} became {frame_size(size_b)}"
    if is_turned(a, b):
        yield Structural(kind=Kind.TURNED, reason=f"{sizes}: {quarter_turn(a, b)}")
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
    """Relative difference of focal lengths that is not significant."""
    return max(least, SIGMAS * math.hypot(_focal_std(a), _focal_std(b)))


def _focal_std(calibration: Calibration) -> float:
    """Relative standard deviation of fx: measured, else typical for the grade."""
    return std_of(calibration, "fx") / calibration.intrinsics.fx or PRIORS[calibration.grade].focal


def _is_stretched(a: Calibration, b: Calibration) -> bool:
    before, after = a.intrinsics, b.intrinsics
    aspects = math.hypot(PRIORS[a.grade].aspect, PRIORS[b.grade].aspect)
    stretch = (after.fx / after.fy) / (before.fx / before.fy)
    return abs(stretch - 1) > max(STRETCH, SIGMAS * aspects) and not is_turned(a, b)


def _is_part(whole: ImageSize, part: ImageSize, zoom: float, *, same: bool) -> bool:
    """Whether ``part``, enlarged ``zoom`` times, fits into ``whole`` along both sides.

    An image with another aspect ratio shows another part of the sensor, even if the focal length changed as
    well.
    """
    slack = SAME_RATIO if same else FOCAL_SLACK
    return all(small / zoom <= large * (1 + slack) for large, small in zip(whole, part, strict=True))


def _of_focal_lengths(a: Calibration, b: Calibration) -> Iterator[Structural]:
    before, after = a.intrinsics, b.intrinsics
    if is_turned_square(a, b):
        return
    if before.image_size == after.image_size and _is_swapped_focal(a, b):
        was, now = (f"{K.fx:.6g}, {K.fy:.6g}" for K in (before, after))
        reason = f"fx, fy were {was} and are {now} px: they changed places"
        yield Structural(kind=Kind.FOCAL_SWAP, reason=reason)
        return
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
    of_a, of_b = _equivalent(a, zoom), _equivalent(b, 1 / zoom)
    leak = of_a or of_b
    if leak is not None:
        reason = (
            f"focal lengths differ × {max(zoom, 1 / zoom):.3f}, the crop factor of a sensor {leak:.1f} mm wide: "
            "a 35 mm equivalent is written as the focal length"
        )
        yield Structural(kind=Kind.EQUIVALENT_LEAK, reason=reason, faulty="B" if of_a else "A")
    elif before.image_size == after.image_size:
        field = f"fx × {zoom:.4f} in a frame of the same size"
        if _is_same_lens(a, b):
            reason = f"{field}: another part of the sensor fills it, or another lens"
            yield Structural(kind=Kind.CROP, reason=reason)
        else:
            reason = f"{field}, and another distortion: another lens, or another camera"
            yield Structural(kind=Kind.OTHER_CAMERA, reason=reason)


def _is_swapped_focal(a: Calibration, b: Calibration) -> bool:
    before, after = a.intrinsics, b.intrinsics
    return is_same(before.fx, after.fy) and is_same(before.fy, after.fx) and not is_same(before.fx, before.fy)


def _is_same_lens(a: Calibration, b: Calibration) -> bool:
    """Whether both displace rays at one angle equally, as one lens does whatever the crop."""
    if a.distortion is None or b.distortion is None:
        return True
    radius = 0.4 * min(one.image_size[0] / one.fx for one in (a.intrinsics, b.intrinsics))
    xy = np.array([(radius, 0.0), (0.0, radius), (-radius, 0.0), (0.0, -radius)])
    with np.errstate(all="ignore"):
        bends = [one.distort(xy) - xy for one in (a.distortion, b.distortion)]
    largest = max(float(np.nanmax(np.abs(bend), initial=0.0)) for bend in bends)
    apart = float(np.nanmax(np.abs(bends[1] - bends[0]), initial=0.0))
    return apart <= max(ONE_LENS * largest, MEASURABLE_PX / a.intrinsics.fx)


def _equivalent(true: Calibration, ratio: float) -> float | None:
    """Width in mm of a sensor with the crop factor ``ratio``, if ``true`` states its focal length."""
    focal_mm, K = true.camera.focal_mm, true.intrinsics
    if not focal_mm or ratio < 1.2:
        return None
    width_mm, height_mm = (focal_mm * side / f for side, f in zip(K.image_size, (K.fx, K.fy), strict=True))
    by_width = FULL_FRAME_MM[0] / width_mm
    by_diagonal = math.hypot(*FULL_FRAME_MM) / math.hypot(width_mm, height_mm)
    slack = LEAK_SLACK + 0.5 / (focal_mm * ratio)
    return width_mm if any(abs(ratio / factor - 1) <= slack for factor in (by_width, by_diagonal)) else None


def _of_distortions(a: Calibration, b: Calibration) -> Iterator[Structural]:
    if a.distortion is None or b.distortion is None:
        return
    bend_a, bend_b = _bend_px(a), _bend_px(b)
    common = common_numbers(*_of_one_size(a, b))
    lost = next(_lost(a, b, common, (bend_a, bend_b)), None)
    if lost is not None:
        yield lost
        return
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
    # In a rotated image the two are swapped legitimately.
    if {"p1", "p2"} <= one.keys() & two.keys() and not is_turned(a, b):
        yield from _of_tangential(a, b, one, two)
    k1, k2 = one.get("k1", 0.0), two.get("k1", 0.0)
    if k1 * k2 < 0 and min(bend_a, bend_b) > MEASURABLE_PX and 0.5 < -k1 / k2 < 2.0:
        reason = f"k1 was {k1:.4g} and is {k2:.4g}: one of the two maps observed to ideal, the other ideal to observed"
        yield Structural(kind=Kind.DIRECTION, reason=reason)


def _of_one_size(a: Calibration, b: Calibration) -> tuple[Calibration, Calibration]:
    size_a, size_b = a.intrinsics.image_size, b.intrinsics.image_size
    if size_a == size_b or not same_aspect(size_a, size_b):
        return a, b
    return (a.scaled(size_b), b) if size_a > size_b else (a, b.scaled(size_a))


def _lost(
    a: Calibration, b: Calibration, common: Common, bends_px: tuple[float, float]
) -> Iterator[Structural]:
    """Coefficients that one of the two lacks although K is equal to the last digit: a file lost them."""
    if common.changed or not {"fx", "fy"} <= set(common.same) or bool(common.lost) is bool(common.gained):
        return
    name: Literal["A", "B"] = "B" if common.lost else "A"
    missing, whole = (common.lost, a) if common.lost else (common.gained, b)
    if whole.distortion is None:
        return
    stated = [coefficient for coefficient, value in whole.distortion.coefficients.items() if value]
    if set(missing) < set(stated):
        verb = "is" if len(missing) == 1 else "are"
        yield Structural(
            kind=Kind.COEFFICIENT_LOST,
            reason=f"{listed(missing)} {verb} missing in {name}; every other number is the same to the last digit",
            faulty=name,
        )
    elif not any(_is_of_images(one) for one in (a, b)):
        yield Structural(
            kind=Kind.DISTORTION_LOST,
            reason=f"{name} has no distortion where the other has {pixels(max(bends_px))} of it in the corners, and "
            "its K is the same to the last digit: it was lost on the way, or set to 0",
            faulty=name,
        )


def _is_of_images(calibration: Calibration) -> bool:
    """Whether the camera may have corrected the image but written the K of the uncorrected image into its tags."""
    return calibration.provenance.kind == "image-metadata" or calibration.camera.capture_mode is not None


def _of_tangential(
    a: Calibration, b: Calibration, one: Mapping[str, float], two: Mapping[str, float]
) -> Iterator[Structural]:
    if _is_swapped(a, b, one, two):
        reason = f"p1 = {one['p1']:.4g} and p2 = {one['p2']:.4g} changed places: Metashape's order against OpenCV's"
        yield Structural(kind=Kind.TANGENTIAL_SWAP, reason=reason)
    same_centre = is_same(a.intrinsics.cx, b.intrinsics.cx) and is_same(a.intrinsics.cy, b.intrinsics.cy)
    if same_centre and any(one[p] and is_same(one[p], -two[p]) for p in ("p1", "p2")):
        reason = (
            f"p1, p2 were {one['p1']:.4g}, {one['p2']:.4g} and are {two['p1']:.4g}, {two['p2']:.4g}: "
            "the opposite sign of the tangential terms"
        )
        if all(is_same(one[p], -two[p]) or is_same(one[p], two[p]) for p in ("p1", "p2")):
            yield Structural(kind=Kind.TANGENTIAL_SIGN, reason=reason)


def _is_corrected(calibration: Calibration, bend_px: float, raw_px: float) -> bool:
    if isinstance(calibration.distortion, NoDistortion):
        return True
    return bend_px < CORRECTED_PX or bend_px < CORRECTED_SHARE * raw_px


def _left(bend_px: float) -> str:
    return "no distortion" if bend_px < CORRECTED_PX else f"{bend_px:.2g} px of distortion"


def _bend_px(calibration: Calibration) -> float:
    """Largest displacement in px by the distortion, at the corners and half way to them."""
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
    stds = [std_of(side, name) for side in (a, b) for name in ("p1", "p2")]
    if across <= SWAPPED_EXACTLY * apart or not all(stds):
        return across < SWAPPED_ABOUT * apart
    variance = sum(std**2 for std in stds) / 2
    as_it_is = ((one["p1"] - two["p1"]) ** 2 + (one["p2"] - two["p2"]) ** 2) / variance
    changed = ((one["p1"] - two["p2"]) ** 2 + (one["p2"] - two["p1"]) ** 2) / variance
    return as_it_is > NOT_THE_SAME and changed < AS_SWAPPED
