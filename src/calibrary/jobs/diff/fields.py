"""Causes with numbers of their own: another field of view, pixels of another shape, a corrected lens, another camera.

Their numbers are fitted to the two, so they are asked after all that explains every number. The tolerance depends on
what is compared: an EXIF focal length that differs by 3 % from a measured one is not another zoom.
"""

from __future__ import annotations

import math
import re
from typing import Final

from calibrary.calibration import Calibration, CameraKey
from calibrary.distortion import NoDistortion
from calibrary.image_size import same_aspect
from calibrary.jobs.diff.lens_rays import MEASURABLE_PX, axial, bends_px, is_inverse, is_one_lens
from calibrary.jobs.diff.uncertainty import PRIORS, std_of
from calibrary.jobs.diff.verdicts import Kind, Structural
from calibrary.jobs.diff.wording import pixels
from calibrary.probability import two_digits

SAME_FIELD: Final = 0.02
"""Relative change of fx / W at equal aspect ratio above which the image shows another part of the sensor."""
STRETCH: Final = 0.01
"""A larger relative change of fx / fy is not due to the lens: square pixels became non-square."""
SIGMAS: Final = 3.0
"""Tolerance in standard deviations for numbers that are not known well enough for these limits."""
LEAK_SLACK: Final = 0.02
"""Relative tolerance for a sensor's nominal size and an EXIF focal length, both rounded (a 35 mm equivalent to whole
mm)."""
CORRECTED_PX: Final = 0.05
CORRECTED_SHARE: Final = 0.05
"""Distortion that remains after in-camera correction, or that a calibration of such images finds from noise: in px,
and as a fraction of the full distortion."""
FULL_FRAME_MM: Final = (36.0, 24.0)


def focal_slack(a: Calibration, b: Calibration, least: float) -> float:
    """Relative difference of focal lengths that is not significant."""
    stds = [std_of(one, "fx") / one.intrinsics.fx or PRIORS[one.grade].focal for one in (a, b)]
    return max(least, SIGMAS * math.hypot(*stds))


def is_stretched(a: Calibration, b: Calibration) -> bool:
    """Whether the pixels changed their shape by more than a lens or σ does."""
    before, after = axial(a), axial(b)
    aspects = math.hypot(PRIORS[a.grade].aspect, PRIORS[b.grade].aspect)
    stretch = (after.fx / after.fy) / (before.fx / before.fy)
    return abs(stretch - 1) > max(STRETCH, SIGMAS * aspects) and not is_on_its_side(a, b)


def stretched(a: Calibration, b: Calibration) -> Structural:
    """Another shape of the pixels."""
    before, after = (side.intrinsics.fx / side.intrinsics.fy for side in (a, b))
    return Structural(
        kind=Kind.STRETCH,
        reason=f"fx / fy was {before:.4f} and is {after:.4f}: a frame that was transcoded or stretched, or a wrong "
        "side of the sensor",
    )


def is_on_its_side(a: Calibration, b: Calibration) -> bool:
    """Whether one image is in portrait and the other in landscape format."""
    size_a, size_b = a.intrinsics.image_size, b.intrinsics.image_size
    return same_aspect(size_a, size_b[::-1]) and not same_aspect(size_a, size_b)


def of_names(a: Calibration, b: Calibration) -> Structural:
    """Another camera by its name."""
    reason = f"A is of {a.camera} and B of {b.camera}: another camera, or another lens"
    return Structural(kind=Kind.OTHER_CAMERA, reason=reason)


def names_differ(one: CameraKey, two: CameraKey) -> bool:
    """Whether both state a model, serial number or sub-camera and these differ, allowing for spellings of a model."""
    if one.model and two.model:
        mine, others = (set(re.findall(r"[a-z0-9]+", key.model.lower())) for key in (one, two) if key.model)
        if not mine & others:
            return True
    pairs = ((one.serial, two.serial), (one.sub_camera, two.sub_camera))
    return any(x is not None and y is not None and x != y for x, y in pairs)


def of_focal_lengths(a: Calibration, b: Calibration) -> Structural | None:
    """Another shape of the pixels or another field of view in frames of one size."""
    if is_stretched(a, b):
        return stretched(a, b)
    zoom = axial(b).fx / axial(a).fx
    if abs(zoom - 1) <= focal_slack(a, b, SAME_FIELD):
        return None
    if (leak := leaked(a, b)) is not None:
        return leak
    field = f"the focal length × {zoom:.4f} in a frame of the same size"
    if is_one_lens(a, b) is not False:
        reason = (
            f"{field}: another zoom or focus, another part of the sensor that fills it (crop or digital zoom), or "
            "another lens"
        )
        return Structural(kind=Kind.FIELD, reason=reason)
    corrected = of_correction(a, b)
    reason = f"{field}, and another distortion: another lens, or another camera" + (
        f"; or {corrected.reason}" if corrected is not None else ""
    )
    return Structural(kind=Kind.OTHER_CAMERA, reason=reason)


def leaked(a: Calibration, b: Calibration) -> Structural | None:
    """A 35 mm equivalent for the focal length: the fields of view differ by the crop factor of the sensor."""
    zoom = axial(b).fx / b.intrinsics.image_size[0] / (axial(a).fx / a.intrinsics.image_size[0])
    of_a, of_b = _equivalent(a, zoom), _equivalent(b, 1 / zoom)
    leak = of_a or of_b
    if leak is None:
        return None
    return Structural(
        kind=Kind.EQUIVALENT_LEAK,
        reason=f"focal lengths differ × {max(zoom, 1 / zoom):.3f}, the crop factor of a sensor {leak:.1f} mm wide: "
        "a 35 mm equivalent is written as the focal length",
        faulty="B" if of_a else "A",
    )


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


def of_correction(a: Calibration, b: Calibration) -> Structural | None:
    """A lens that the camera corrects in one of the two only."""
    bends = bends_px(a, b) if a.distortion is not None and b.distortion is not None else None
    if bends is None:
        return None
    bend_a, bend_b = bends
    if bend_a > MEASURABLE_PX and _is_corrected(b, bend_b, bend_a):
        reason = (
            f"a lens that bends the frame by {bend_a:.1f} px has {_left(bend_b)} now: the camera corrects it"
        )
        return Structural(kind=Kind.DEWARP_ON, reason=reason)
    if bend_b > MEASURABLE_PX and _is_corrected(a, bend_a, bend_b):
        reason = (
            f"distortion of {bend_b:.1f} px over the frame where there was {_left(bend_a)}: "
            "the camera corrects no more"
        )
        return Structural(kind=Kind.DEWARP_OFF, reason=reason)
    return None


def _is_corrected(calibration: Calibration, bend_px: float, raw_px: float) -> bool:
    if isinstance(calibration.distortion, NoDistortion):
        return True
    return bend_px < CORRECTED_PX or bend_px < CORRECTED_SHARE * raw_px


def _left(bend_px: float) -> str:
    return "no distortion" if bend_px < CORRECTED_PX else f"{two_digits(bend_px)} px of distortion"


def of_direction(a: Calibration, b: Calibration) -> Structural | None:
    """A distortion that undoes the other."""
    bends = bends_px(a, b) if a.distortion is not None and b.distortion is not None else None
    if bends is None or min(bends) <= MEASURABLE_PX or not is_inverse(a, b):
        return None
    return Structural(
        kind=Kind.DIRECTION,
        reason=f"the distortion of B undoes that of A ({pixels(bends[0])} over the frame): one of the two maps "
        "observed to ideal, the other ideal to observed",
    )
