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
from collections.abc import Iterator
from typing import Final, Literal

import numpy as np

from calibrary.calibration import Calibration, CameraKey, ImageSize, Intrinsics
from calibrary.distortion import NoDistortion
from calibrary.image_size import same_aspect
from calibrary.jobs.diff.common_numbers import (
    K_NAMES,
    Common,
    common_numbers,
    in_one_model,
    is_same,
    values_of,
)
from calibrary.jobs.diff.frames import FOCAL_SLACK
from calibrary.jobs.diff.lens_rays import (
    MEASURABLE_PX,
    axial,
    bends_px,
    is_inverse,
    is_one_lens,
    moves_px,
    pinholes,
)
from calibrary.jobs.diff.numbers import Numbers
from calibrary.jobs.diff.uncertainty import PRIORS, std_of
from calibrary.jobs.diff.verdicts import Kind, Structural
from calibrary.jobs.diff.wording import frame_size, listed, pixels
from calibrary.probability import two_digits

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

OTHER_LENS = 0.01
"""RMS difference over the image after the best rotation, as a fraction of the longer side, above which it is another
lens."""

RESAMPLED: Final = (1.0, 1 / 2, 1 / 3, 1 / 4)
"""Factors by which cameras resample a part of the sensor, besides those that make it fill a side of the frame."""
USUAL = 0.03
"""Relative tolerance of these."""
VERY_LENS = 0.05
"""Relative difference of the distortion below which a part of the sensor may be resampled by any factor."""
CORRECTED_PX, CORRECTED_SHARE = 0.05, 0.05
"""Distortion that remains after in-camera correction, or that a calibration of such images finds from noise: in px,
and as a fraction of the full distortion."""

SAME_PX: Final = 5e-4
"""Pixels that differ by less are shown as 0: two models of one map."""

SWAPPED_EXACTLY = 1e-4
SWAPPED_ABOUT = 0.1
"""Tolerance of swapped values, as a fraction of the difference between p1 and p2, if no uncertainty is known."""
NOT_THE_SAME, AS_SWAPPED = 25.0, 9.21
"""χ² of two values: at least 5 σ apart as stated, and within 99 % after swapping."""

TANGENTIAL: Final = (("p1", "p2"), ("p0", "p1"))
"""Names of the tangential terms, by model."""
FEWEST_TERMS: Final = 2
"""Coefficients that have to agree before equal numbers in other places are no coincidence."""

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
    if type(a.distortion) is not type(b.distortion):
        a, b = in_one_model(a, b)
    if type(a.distortion) is not type(b.distortion) and _is_one_map(a, b):
        return ()
    # These also look like a crop, a swap or a lost lens: the cause alone is named.
    alone = (*_of_scale(a, b), *_of_places(a, b))
    if alone:
        return alone[:1]
    one, two = (a, b) if a.distortion is not None and b.distortion is not None else pinholes(a, b)
    return (
        *_of_frames(one, two),
        *_of_focal_lengths(one, two),
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
        yield _of_names(a, b)
    elif seen.rms_px >= OTHER_LENS * max(seen.image_size) and numbers.lens_compared:
        yield Structural(
            kind=Kind.OTHER_CAMERA,
            reason=f"projections differ by {pixels(seen.rms_px)} rms, more than any drift: another lens, or another "
            "camera",
        )


def _of_names(a: Calibration, b: Calibration) -> Structural:
    reason = f"A is of {a.camera} and B of {b.camera}: another camera, or another lens"
    return Structural(kind=Kind.OTHER_CAMERA, reason=reason)


def _names_differ(one: CameraKey, two: CameraKey) -> bool:
    """Whether both state a model, serial number or sub-camera and these differ, allowing for spellings of a model."""
    if one.model and two.model:
        mine, others = (set(re.findall(r"[a-z0-9]+", key.model.lower())) for key in (one, two) if key.model)
        if not mine & others:
            return True
    pairs = ((one.serial, two.serial), (one.sub_camera, two.sub_camera))
    return any(x is not None and y is not None and x != y for x, y in pairs)


def _is_one_map(a: Calibration, b: Calibration) -> bool:
    """Whether two models give each ray the same pixel."""
    if a.distortion is None or b.distortion is None or a.intrinsics.image_size != b.intrinsics.image_size:
        return False
    moved = moves_px(a, b)
    return bool(moved.size) and float(np.abs(moved).max()) < SAME_PX


def _of_frames(a: Calibration, b: Calibration) -> Iterator[Structural]:
    size_a, size_b = a.intrinsics.image_size, b.intrinsics.image_size
    if size_a == size_b or _is_stretched(a, b):
        return
    sizes = f"{frame_size(size_a)} became {frame_size(size_b)}"
    if _is_turned(a, b):
        yield Structural(kind=Kind.TURNED, reason=f"{sizes}: {_quarter_turn(a, b)}")
        return
    zoom, slack = axial(b).fx / axial(a).fx, _slack(a, b, SAME_RATIO)
    same = same_aspect(size_a, size_b)
    what = "unchanged" if abs(zoom - 1) <= slack else f"× {zoom:.4g}"
    if same and abs(zoom * size_a[0] / size_b[0] - 1) <= slack:
        reason = f"{sizes} and the focal length went with it, {what}: the frame was resampled"
        yield Structural(kind=Kind.RESIZE, reason=reason)
    elif _names_differ(a.camera, b.camera):
        yield _of_names(a, b)
    elif _is_crop(a, b, zoom, same=same):
        reason = f"{sizes} with the focal length {what}: another part of the sensor is used"
        yield Structural(kind=Kind.CROP, reason=reason)
    else:
        lens = (
            "the distortion is another as well" if is_one_lens(a, b) is False else "no usual crop explains it"
        )
        reason = f"{sizes} with the focal length {what}, and {lens}: another camera or another lens"
        yield Structural(kind=Kind.OTHER_CAMERA, reason=reason)


def _is_crop(a: Calibration, b: Calibration, zoom: float, *, same: bool) -> bool:
    """Whether one frame is a part of the other: resampled by a usual factor, or by any if it is the very lens."""
    size_a, size_b = a.intrinsics.image_size, b.intrinsics.image_size
    ways = ((size_a, size_b, zoom), (size_b, size_a, 1 / zoom))
    fitting = [(whole, part, by) for whole, part, by in ways if _is_part(whole, part, by, same=same)]
    if not fitting or is_one_lens(a, b) is False:
        return False
    slack = max(USUAL, _slack(a, b, SAME_RATIO))
    return is_one_lens(a, b, within=VERY_LENS) is True or any(
        abs(by / usual - 1) <= slack
        for whole, part, by in fitting
        for usual in (*RESAMPLED, *(one / of for one, of in zip(part, whole, strict=True)))
    )


def _slack(a: Calibration, b: Calibration, least: float) -> float:
    """Relative difference of focal lengths that is not significant."""
    return max(least, SIGMAS * math.hypot(_focal_std(a), _focal_std(b)))


def _focal_std(calibration: Calibration) -> float:
    """Relative standard deviation of fx: measured, else typical for the grade."""
    return std_of(calibration, "fx") / calibration.intrinsics.fx or PRIORS[calibration.grade].focal


def _is_stretched(a: Calibration, b: Calibration) -> bool:
    before, after = axial(a), axial(b)
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
    zoom = (axial(b).fx / after.image_size[0]) / (axial(a).fx / before.image_size[0])
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
        field = f"the focal length × {zoom:.4f} in a frame of the same size"
        if is_one_lens(a, b) is not False:
            reason = (
                f"{field}: another zoom or focus, another part of the sensor that fills it (crop or digital zoom), or "
                "another lens"
            )
            yield Structural(kind=Kind.FIELD, reason=reason)
        else:
            reason = f"{field}, and another distortion: another lens, or another camera"
            yield Structural(kind=Kind.OTHER_CAMERA, reason=reason)


def _is_swapped_focal(a: Calibration, b: Calibration) -> bool:
    before, after = a.intrinsics, b.intrinsics
    return is_same(before.fx, after.fy) and is_same(before.fy, after.fx) and not is_same(before.fx, before.fy)


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
    bends = bends_px(a, b)
    if bends is None:
        return
    bend_a, bend_b = bends
    common = common_numbers(*_of_one_size(a, b))
    lost = next(_lost(a, b, common, (bend_a, bend_b)), None)
    if lost is not None:
        yield lost
        return
    # A crop sees the middle of the lens, which bends less.
    if not same_aspect(a.intrinsics.image_size, b.intrinsics.image_size):
        return
    if bend_a > MEASURABLE_PX and _is_corrected(b, bend_b, bend_a):
        reason = (
            f"a lens that bends the frame by {bend_a:.1f} px has {_left(bend_b)} now: the camera corrects it"
        )
        yield Structural(kind=Kind.DEWARP_ON, reason=reason)
        return
    if bend_b > MEASURABLE_PX and _is_corrected(a, bend_a, bend_b):
        reason = (
            f"distortion of {bend_b:.1f} px over the frame where there was {_left(bend_a)}: "
            "the camera corrects no more"
        )
        yield Structural(kind=Kind.DEWARP_OFF, reason=reason)
        return
    # In a rotated image the two are swapped legitimately.
    if not _is_turned(a, b):
        yield from _of_tangential(a, b)
    if min(bend_a, bend_b) > MEASURABLE_PX and is_inverse(a, b):
        reason = (
            f"the distortion of B undoes that of A ({pixels(bend_a)} over the frame): one of the two maps observed to "
            "ideal, the other ideal to observed"
        )
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
    if (affinity := _lost_affinity(*_of_one_size(a, b), common)) is not None:
        yield affinity
        return
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


def _lost_affinity(a: Calibration, b: Calibration, common: Common) -> Structural | None:
    """What makes pixels square and upright, or puts the principal point into the middle, was lost on the way."""
    if common.lost or common.gained or not common.is_one_measurement:
        return None
    if a.intrinsics.image_size != b.intrinsics.image_size:
        return None
    for name, bare, whole in (("B", b.intrinsics, a.intrinsics), ("A", a.intrinsics, b.intrinsics)):
        faulty: Literal["A", "B"] = "B" if name == "B" else "A"
        gone = []
        if len({"fx", "fy"} & {*common.changed}) == 1 and bare.fx == bare.fy and whole.fx != whole.fy:
            gone.append(f"the difference of fx and fy (b1 = {whole.fx - whole.fy:.4g})")
        if "skew" in common.changed and not bare.skew:
            gone.append(f"the skew (b2 = {whole.skew:.4g})")
        middle = (bare.cx, bare.cy) == (bare.image_size[0] / 2, bare.image_size[1] / 2)
        if {"cx", "cy"} & {*common.changed} and middle:
            gone.append(f"the principal point ({whole.cx:.2f}, {whole.cy:.2f})")
        told = {"fx", "fy"} if gone and "fx and fy" in gone[0] else set[str]()
        told |= {"skew"} if not bare.skew else set()
        told |= {"cx", "cy"} if middle else set()
        if gone and {*common.changed} <= told:
            verb = "is" if len(gone) == 1 else "are"
            reason = (
                f"{listed(gone)} {verb} missing in {name}; every other number is the same to the last digit"
            )
            return Structural(kind=Kind.COEFFICIENT_LOST, reason=reason, faulty=faulty)
    return None


def _is_of_images(calibration: Calibration) -> bool:
    """Whether the camera may have corrected the image but written the K of the uncorrected image into its tags."""
    return calibration.provenance.kind == "image-metadata" or calibration.camera.capture_mode is not None


def _of_tangential(a: Calibration, b: Calibration) -> Iterator[Structural]:
    names = _tangential_names(a, b)
    if names is None or a.distortion is None or b.distortion is None:
        return
    one, two = a.distortion.coefficients, b.distortion.coefficients
    first, second = names
    if _is_swapped(a, b, names):
        reason = (
            f"{first} = {one[first]:.4g} and {second} = {one[second]:.4g} changed places: Metashape's order against "
            "OpenCV's"
        )
        yield Structural(kind=Kind.TANGENTIAL_SWAP, reason=reason)
    same_centre = is_same(a.intrinsics.cx, b.intrinsics.cx) and is_same(a.intrinsics.cy, b.intrinsics.cy)
    if same_centre and any(one[p] and is_same(one[p], -two[p]) for p in names):
        reason = (
            f"{first}, {second} were {one[first]:.4g}, {one[second]:.4g} and are {two[first]:.4g}, {two[second]:.4g}: "
            "the opposite sign of the tangential terms"
        )
        if all(is_same(one[p], -two[p]) or is_same(one[p], two[p]) for p in names):
            yield Structural(kind=Kind.TANGENTIAL_SIGN, reason=reason)


def _tangential_names(a: Calibration, b: Calibration) -> tuple[str, str] | None:
    """Names of the tangential terms that both have, by one meaning: their models share it, as OpenCV's do."""
    if a.distortion is None or b.distortion is None:
        return None
    one, two = a.distortion.coefficients, b.distortion.coefficients
    return next((pair for pair in TANGENTIAL if {*pair} <= one.keys() & two.keys()), None)


def _of_places(a: Calibration, b: Calibration) -> Iterator[Structural]:
    """The same numbers in other places: cx and cy, the coefficients, or the model that they are read for."""
    if a.intrinsics.image_size != b.intrinsics.image_size:
        return
    K, after = a.intrinsics, b.intrinsics
    if (
        is_same(K.cx, after.cy)
        and is_same(K.cy, after.cx)
        and not is_same(K.cx, K.cy)
        and not _is_turned_square(a, b)
    ):
        reason = f"cx, cy were {K.cx:.2f}, {K.cy:.2f} and are {after.cx:.2f}, {after.cy:.2f} px: they changed places"
        yield Structural(kind=Kind.CENTRE_SWAP, reason=reason)
    if a.distortion is None or b.distortion is None:
        return
    if not all(is_same(getattr(K, name), getattr(after, name)) for name in K_NAMES):
        return
    one, two = (
        [value for value in lens.coefficients.values() if value] for lens in (a.distortion, b.distortion)
    )
    if len(one) < FEWEST_TERMS or len(one) != len(two):
        return
    if type(a.distortion) is not type(b.distortion):
        if all(map(is_same, one, two)):
            models = f"{a.distortion.model} in A and {b.distortion.model} in B"
            reason = (
                f"the coefficients are the same to the last digit but of another model, {models}: one of the two was "
                "exported or read as what it is not"
            )
            yield Structural(kind=Kind.OTHER_MODEL, reason=reason)
        return
    before, now = a.distortion.coefficients, b.distortion.coefficients
    is_moved = before.keys() == now.keys() and not all(map(is_same, one, two))
    if is_moved and all(map(is_same, sorted(one), sorted(two))):
        moved = [name for name in before if not is_same(before[name], now[name])]
        names = _tangential_names(a, b)
        if names is None or set(moved) != {*names}:
            reason = f"{listed(moved)} have each other's values: the coefficients were read or written in another order"
            yield Structural(kind=Kind.ORDER, reason=reason)


def _is_corrected(calibration: Calibration, bend_px: float, raw_px: float) -> bool:
    if isinstance(calibration.distortion, NoDistortion):
        return True
    return bend_px < CORRECTED_PX or bend_px < CORRECTED_SHARE * raw_px


def _left(bend_px: float) -> str:
    return "no distortion" if bend_px < CORRECTED_PX else f"{two_digits(bend_px)} px of distortion"


def _is_swapped(a: Calibration, b: Calibration, names: tuple[str, str]) -> bool:
    one, two = values_of(a), values_of(b)
    p, q = names
    apart = abs(one[p] - one[q])
    across = max(abs(one[p] - two[q]), abs(one[q] - two[p]))
    if not apart > 1e-5:
        return False
    stds = [std_of(side, name) for side in (a, b) for name in names]
    if across <= SWAPPED_EXACTLY * apart or not all(stds):
        return across < SWAPPED_ABOUT * apart
    variance = sum(std**2 for std in stds) / 2
    as_it_is = ((one[p] - two[p]) ** 2 + (one[q] - two[q]) ** 2) / variance
    changed = ((one[p] - two[q]) ** 2 + (one[q] - two[p]) ** 2) / variance
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
