"""Structural changes, as opposed to drift: a crop, swapped values, another convention, a confused tag.

Each test is strict enough that noise cannot pass it: two numbers moved by exactly half a pixel while the
others did not change, or focal lengths in the exact ratio of the image sizes. The tolerance depends on what
is compared: an EXIF focal length that differs by 3 % from a measured one is not a crop. A test states what
probably happened; it never repairs anything.

Rotating or mirroring an image moves the principal point to the other side of the centre and changes the sign
of the tangential terms (OpenCV's p1 belongs to y, p2 to x). Another origin only moves the principal point.
For exact numbers a hundredth of a pixel decides; for measured numbers the tangential terms must agree as
well, because noise and drift also move a principal point.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Final, Literal

import numpy as np

from calibrary.calibration import Calibration, CameraKey, ImageSize, Intrinsics
from calibrary.distortion import NoDistortion
from calibrary.image_size import same_aspect
from calibrary.jobs.diff.common_numbers import K_NAMES, Common, common_numbers, is_same
from calibrary.jobs.diff.frames import FOCAL_SLACK
from calibrary.jobs.diff.numbers import Numbers
from calibrary.jobs.diff.uncertainty import PRIORS, std_of
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

EXACT_PX: Final = 0.02
SAME_FOCAL: Final = 2e-5
"""Relative difference of focal lengths below which both are from one solve: a second solve from other frames would
not repeat a focal length to a tenth of its noise."""
TURN_SIGMAS: Final = 4.0
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

ONE_RATIO: Final = 1e-3
"""Relative tolerance at which the ratios of fx, fy, cx and cy count as one common factor."""
OTHER_RATIO: Final = 0.02
"""Relative difference between that factor and the ratio of the image sizes above which K was not scaled with them."""
OFF_CENTRE: Final = 0.05
"""Fraction of a side: a principal point farther from the image centre belongs to another image size."""

ONE_UNIT: Final = 0.01
"""Relative tolerance at which the ratios of k1, k2 and k3 count as powers of one factor."""
LEAST_FACTOR: Final = 2.0
NEAR_FOCAL_MM: Final = 0.05
"""Relative tolerance between the nominal and the calibrated focal length in mm."""
POWERS: Final = {"k1": 2, "k2": 4, "k3": 6}


def signatures(a: Calibration, b: Calibration) -> tuple[Structural, ...]:
    """All structural changes between ``a`` and the later ``b``, each at its own image size."""
    # Numbers for another image size or unit also look like a crop, a swap or a lost lens: the cause alone is named.
    scale = tuple(_of_scale(a, b))
    if scale:
        return scale
    return (
        *_of_frames(a, b),
        *_of_focal_lengths(a, b),
        *_of_orientation(a, b),
        *_of_origin(a, b),
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
    if _is_turned(a, b):
        yield Structural(kind=Kind.TURNED, reason=f"{sizes}: {_quarter_turn(a, b)}")
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
    return abs(stretch - 1) > max(STRETCH, SIGMAS * aspects) and not _is_turned(a, b)


def _is_part(whole: ImageSize, part: ImageSize, zoom: float, *, same: bool) -> bool:
    """Whether ``part``, enlarged ``zoom`` times, fits into ``whole`` along both sides.

    An image with another aspect ratio shows another part of the sensor, even if the focal length changed as
    well.
    """
    slack = SAME_RATIO if same else FOCAL_SLACK
    return all(small / zoom <= large * (1 + slack) for large, small in zip(whole, part, strict=True))


def _of_focal_lengths(a: Calibration, b: Calibration) -> Iterator[Structural]:
    before, after = a.intrinsics, b.intrinsics
    if _is_turned_square(a, b):
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
    # Inside both frames, in coordinates without a focal length: a crop or a zoom of the sensor leaves them as they are.
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
    # Makers count the 35 mm equivalent by the diagonal, some by the width; EXIF rounds it to whole mm, hence ± 0.5 mm.
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
    if {"p1", "p2"} <= one.keys() & two.keys() and not _is_turned(a, b):
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


def _is_turned(a: Calibration, b: Calibration) -> bool:
    """Whether one image is in portrait and the other in landscape format."""
    size_a, size_b = a.intrinsics.image_size, b.intrinsics.image_size
    return same_aspect(size_a, size_b[::-1]) and not same_aspect(size_a, size_b)


def _is_turned_square(a: Calibration, b: Calibration) -> bool:
    """Whether a square image was rotated by 90° or 270°; requires exactly matching numbers."""
    K, after = a.intrinsics, b.intrinsics
    side = K.image_size[0]
    if K.image_size != (side, side) or after.image_size != K.image_size or abs(K.cx - K.cy) < LEAST_PX:
        return False
    swapped = all(abs(x / y - 1) <= SAME_FOCAL for x, y in ((after.fx, K.fy), (after.fy, K.fx)))
    ways = ((side - K.cy, K.cx), (K.cy, side - K.cx))
    return swapped and any(math.hypot(after.cx - x, after.cy - y) <= EXACT_PX for x, y in ways)


def _quarter_turn(a: Calibration, b: Calibration) -> str:
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


def _of_orientation(a: Calibration, b: Calibration) -> Iterator[Structural]:
    """Rotations by 180°, mirrorings, and principal points counted from another side, at equal image sizes."""
    K, after = a.intrinsics, b.intrinsics
    if _is_turned_square(a, b):
        yield Structural(kind=Kind.TURNED, reason=_quarter_turn(a, b))
        return
    if K.image_size != after.image_size or not _same_focal(a, b, TURN_SIGMAS):
        return
    width, height = K.image_size
    for sides, (kind, reason) in WAYS.items():
        centre = (width - K.cx if sides[0] else K.cx, height - K.cy if sides[1] else K.cy)
        moved = [abs(before - now) for before, now in zip((K.cx, K.cy), centre, strict=True)]
        if not any(moved) or min(way for way, side in zip(moved, sides, strict=True) if side) < LEAST_PX:
            continue
        off = math.hypot(after.cx - centre[0], after.cy - centre[1])
        slack = TURN_SIGMAS * math.hypot(std_of(a, "cx"), std_of(a, "cy"), std_of(b, "cx"), std_of(b, "cy"))
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


def _of_origin(a: Calibration, b: Calibration) -> Iterator[Structural]:
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
        slack = max(FLIPPED * abs(before), TURN_SIGMAS * math.hypot(std_of(a, name), std_of(b, name)))
        if not flips or abs(before) <= slack:
            continue
        said.append(True if abs(after + before) <= slack else False if abs(after - before) <= slack else None)
    return said[0] if said and len(set(said)) == 1 else None


def _of_scale(a: Calibration, b: Calibration) -> Iterator[Structural]:
    """Structural changes where the numbers of one calibration refer to another image size or unit."""
    yield from _of_another_size(a, b)
    yield from _of_another_unit(a, b)


def _of_another_size(a: Calibration, b: Calibration) -> Iterator[Structural]:
    """All four numbers of K changed by one factor, not that of the image sizes; a crop would move the centre."""
    before, after = a.intrinsics, b.intrinsics
    if not all(getattr(before, name) > 0 and getattr(after, name) > 0 for name in K_NAMES):
        return
    ratios = [getattr(after, name) / getattr(before, name) for name in K_NAMES]
    frames = [now / was for was, now in zip(before.image_size, after.image_size, strict=True)]
    follows = all(abs(ratios[0] / frame - 1) <= OTHER_RATIO for frame in frames)
    if follows or max(ratios) / min(ratios) - 1 > ONE_RATIO:
        return
    off = [_off_centre(one) for one in (a, b)]
    if not min(off) <= OFF_CENTRE < max(off):
        return
    faulty: Literal["A", "B"] = "B" if off[1] > off[0] else "A"
    wrong, other, factor = (b, "A", ratios[0]) if faulty == "B" else (a, "B", 1 / ratios[0])
    K = wrong.intrinsics
    same = "the very numbers" if abs(factor - 1) <= ONE_RATIO else f"{factor:.4g} times the numbers"
    size = frame_size(K.image_size)
    yield Structural(
        kind=Kind.OTHER_SIZE,
        reason=f"fx, fy, cx and cy of {faulty} are {same} of {other}, and its principal point ({K.cx:.0f}, "
        f"{K.cy:.0f}) is not near the middle of its {size} frame: K counts in an image of another size",
        faulty=faulty,
    )


def _off_centre(calibration: Calibration) -> float:
    K = calibration.intrinsics
    return max(abs(K.cx / K.image_size[0] - 0.5), abs(K.cy / K.image_size[1] - 0.5))


def _of_another_unit(a: Calibration, b: Calibration) -> Iterator[Structural]:
    """Radial coefficients for radii in pixels or millimetres instead of in focal lengths."""
    if a.distortion is None or b.distortion is None or type(a.distortion) is not type(b.distortion):
        return
    if not all(is_same(getattr(a.intrinsics, name), getattr(b.intrinsics, name)) for name in ("fx", "fy")):
        return
    one, two = a.distortion.coefficients, b.distortion.coefficients
    names = [name for name in POWERS if one.get(name) and two.get(name)]
    ratios = [one[name] / two[name] for name in names]
    if len(names) < 2 or min(ratios) <= 0:
        return
    factors = [ratio ** (1 / POWERS[name]) for name, ratio in zip(names, ratios, strict=True)]
    factor = factors[0]
    if max(factors) / min(factors) - 1 > ONE_UNIT or 1 / LEAST_FACTOR < factor < LEAST_FACTOR:
        return
    faulty: Literal["A", "B"] = "B" if factor > 1 else "A"
    other = "A" if faulty == "B" else "B"
    by = max(factor, 1 / factor)
    divisors = listed([f"{by:.5g}^{POWERS[name]}" for name in names])
    yield Structural(
        kind=Kind.OTHER_UNIT,
        reason=f"{listed(names)} of {faulty} are those of {other} divided by {divisors}{_unit(a, b, by)}: they are for "
        "lengths in another unit than the focal length",
        faulty=faulty,
    )


def _unit(a: Calibration, b: Calibration, by: float) -> str:
    if abs(by / a.intrinsics.fx - 1) <= ONE_UNIT:
        return ", the focal length in pixels"
    focals = [one.camera.focal_mm for one in (a, b) if one.camera.focal_mm]
    if any(math.isclose(by, focal, rel_tol=NEAR_FOCAL_MM) for focal in focals):
        return ", about the focal length in millimetres"
    return ""
