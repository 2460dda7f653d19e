"""Comparison of calibration files with the K from the images.

A measured K of the images decides within the policy's limits. A K derived from focal length and pixel pitch
has an uncertainty of a few per cent and decides only within that.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Final

from calibrary.calibration import Calibration
from calibrary.errors import (
    CalibrationError,
    FrameError,
    InputError,
)
from calibrary.jobs.diff.kinds import ALARMING, Kind
from calibrary.jobs.diff.wording import length, pixels
from calibrary.jobs.extract.candidates import Candidates, size_of
from calibrary.jobs.extract.extraction import CameraReport
from calibrary.jobs.extract.fallback import MEASURED, StepName, fits
from calibrary.policy import Policy
from calibrary.records import Meta, Record, replace
from calibrary.sfm.pixel_check import PixelCheck, PixelVerdict
from calibrary.validation import Verdict

if TYPE_CHECKING:
    from calibrary.jobs.diff.comparison import Comparison

__all__ = [
    "ALTITUDE_M",
    "CheckedFile",
    "Rightness",
    "check_candidates",
    "contradictions",
]

ALTITUDE_M: Final = 100.0
CONVENTIONS: Final = frozenset(
    {Kind.HALF_PIXEL, Kind.ORIGIN, Kind.FROM_CENTRE, Kind.DEWARP_ON, Kind.DEWARP_OFF}
)
"""Structural changes that only a measured K can show, because the principal point of a derived K is assumed."""


class Rightness(StrEnum):
    """Whether a calibration may be used for a camera."""

    RIGHT = "right"
    OFF = "off"
    UNKNOWN = "unknown"


class CheckedFile(Record):
    """A calibration file, compared with a camera of the images.

    Attributes:
        file: name of the file.
        verdict: whether its K is right for that camera; unknown if the images give no valid K.
        message: the verdict and the difference, in one sentence.
        camera: name of the camera in file names; None if the file fits no camera.
        held_against: source of the images' K.
        fx, expected_fx: of the file and of the images, px.
        scale_change: relative change of the image scale: the part of the focal length's difference that the
            distortion does not compensate.
        rms_px, max_px: difference of the projections over the image, after the best rotation of the camera.
        altitude_m: altitude above ground at which errors on the ground are stated.
        height_cm, max_cm: error of heights, and the largest error in position.
        pixels: check of its K against the pixels of some images; None if not requested.
    """

    file: str
    verdict: Rightness
    message: str
    camera: str | None = None
    held_against: str | None = None
    fx: float | None = None
    expected_fx: float | None = None
    scale_change: float | None = None
    rms_px: float | None = None
    max_px: float | None = None
    altitude_m: Annotated[float, Meta(gt=0)] = ALTITUDE_M
    height_cm: float | None = None
    max_cm: float | None = None
    pixels: PixelCheck | None = None


def check_candidates(
    candidates: Candidates, cameras: Sequence[CameraReport], policy: Policy, altitude_m: float = ALTITUDE_M
) -> list[CheckedFile]:
    """Compare a file with every camera that it may belong to, using its calibration with the closest focal length."""
    checked: list[CheckedFile] = []
    for camera in cameras:
        size = camera.camera.states[0].metadata.size
        fitting = [one for one in candidates.calibrations if fits(one, camera.camera.key, size)]
        if fitting:
            nearest = _nearest(fitting, camera)
            held = _held(candidates.label, nearest, camera, policy, altitude_m)
            checked.append(_by_pixels(held, nearest, camera, policy))
    if checked:
        return checked
    first = candidates.calibrations[0]
    whose = f" of {first.camera.model}" if first.camera.model else ""
    sizes = ", ".join(sorted({"{}×{}".format(*one.camera.states[0].metadata.size) for one in cameras}))
    own = "{}×{}".format(*first.intrinsics.image_size)
    message = f"it is for images{whose} of {own}, and no camera here has such ({sizes})"
    return [
        CheckedFile(
            file=candidates.label,
            verdict=Rightness.OFF,
            message=message,
            fx=first.intrinsics.fx,
            altitude_m=altitude_m,
        )
    ]


def contradictions(
    files: Sequence[Candidates], cameras: Sequence[CameraReport], policy: Policy
) -> Iterator[str]:
    """Sentences on the files in the folders of the images that are wrong for these images."""
    valid = [camera for camera in cameras if _reference(camera) is not None]
    for candidates in files:
        if not any(one.grade.is_metric for one in candidates.calibrations):
            continue  # the initial value of another program's adjustment, such as COLMAP's 1.2 × the longer side
        for found in check_candidates(candidates, valid, policy) if valid else ():
            if found.verdict is Rightness.OFF and found.camera is not None:
                yield f"{found.file}, which is beside the images and is not used, is {found.message}"


def _nearest(fitting: Sequence[Calibration], camera: CameraReport) -> Calibration:
    """The calibration with the focal length closest to that of the camera."""
    reference = _reference(camera)
    if reference is None:
        return fitting[0]
    over_width = reference.intrinsics.fx / reference.intrinsics.image_size[0]
    return min(fitting, key=lambda one: abs(one.intrinsics.fx / one.intrinsics.image_size[0] - over_width))


def _by_pixels(held: CheckedFile, K: Calibration, camera: CameraReport, policy: Policy) -> CheckedFile:
    """Add the check against the pixels: if they contradict the file it is off, whatever the tags state."""
    if camera.look is None:
        return held
    check = camera.look.check(K.scaled(size_of(camera)), policy.source_agreement)
    if check.verdict is PixelVerdict.CONTRADICTS:
        message = f"off by the pixels of {check.images} images: {check.figures}; {check.reason}"
        return replace(held, pixels=check, verdict=Rightness.OFF, message=message)
    text = f"; the pixels of {check.images} images agree: {check.figures}"
    if check.verdict is PixelVerdict.CANNOT_TELL:
        text = f"; the pixels cannot tell: {check.reason}"
    return replace(held, pixels=check, message=held.message + text)


def _held(
    label: str, nearest: Calibration, camera: CameraReport, policy: Policy, altitude_m: float
) -> CheckedFile:
    reference = _reference(camera)
    if reference is None:
        return CheckedFile(
            file=label,
            verdict=Rightness.UNKNOWN,
            message=f"the images give no valid K to compare it with: {camera.camera.reason}",
            camera=camera.slug,
            fx=nearest.intrinsics.fx,
            altitude_m=altitude_m,
        )
    by = reference.provenance.tag or reference.provenance.source or reference.provenance.kind
    from calibrary.jobs.diff.comparison import compare  # noqa: PLC0415  rarely needed

    try:
        comparison = compare(reference, nearest, policy)
    except (FrameError, CalibrationError, InputError) as error:
        message = error.message if isinstance(error, InputError) else str(error)
        verdict, text = Rightness.OFF, f"not comparable with {by} of these images: {message}"
        return CheckedFile(
            file=label,
            verdict=verdict,
            message=text,
            camera=camera.slug,
            held_against=by,
            altitude_m=altitude_m,
        )
    is_off, limit = _is_off(comparison, camera, policy)
    numbers = comparison.numbers
    ground = numbers.ground(altitude_m) if numbers is not None else None
    return CheckedFile(
        file=label,
        verdict=Rightness.OFF if is_off else Rightness.RIGHT,
        message=_message(comparison, by, limit, altitude_m, is_off=is_off),
        camera=camera.slug,
        held_against=by,
        fx=numbers.b.intrinsics.fx if numbers is not None else nearest.intrinsics.fx,
        expected_fx=reference.intrinsics.fx,
        scale_change=numbers.scale.change if numbers is not None else None,
        rms_px=numbers.difference.rms_px if numbers is not None else None,
        max_px=numbers.difference.max_px if numbers is not None else None,
        altitude_m=altitude_m,
        height_cm=ground.height_cm if ground is not None else None,
        max_cm=ground.max_cm if ground is not None else None,
    )


def _reference(camera: CameraReport) -> Calibration | None:
    """The K that files are compared with: a valid one from the images or the registry, never one from another file."""
    steps = camera.fallback.steps if camera.fallback is not None else ()
    if steps and steps[-1].step is StepName.REGISTRY and camera.verdict is Verdict.VALID:
        return camera.calibration
    return camera.camera.calibration if camera.camera.verdict is Verdict.VALID else None


def _is_off(comparison: Comparison, camera: CameraReport, policy: Policy) -> tuple[bool, float | None]:
    """Whether the file is wrong; and, if the images' K is derived, the uncertainty of that K."""
    numbers = comparison.numbers
    kinds = {one.kind for one in comparison.structural} & ALARMING
    if comparison.a.grade in MEASURED:
        if numbers is None or kinds:
            return True, None
        excused = numbers.is_measured and numbers.significance is not None and numbers.significance.explains
        return numbers.matters(policy) and not excused, None
    known = camera.camera.states[0].known.camera is not None
    limit = (policy.known_camera_tolerance if known else None) or policy.source_agreement
    if numbers is None or kinds - CONVENTIONS:
        return True, limit
    K = numbers.b.intrinsics
    width, height = K.image_size
    drift = max(abs(K.cx / width - 0.5), abs(K.cy / height - 0.5))
    return abs(numbers.focal_change) > limit or drift > policy.principal_point_drift_max, limit


def _message(comparison: Comparison, by: str, limit: float | None, altitude_m: float, *, is_off: bool) -> str:
    numbers = comparison.numbers
    reasons = [one.reason for one in comparison.structural if one.kind in ALARMING]
    if numbers is None:
        return f"off: {'; '.join(reasons) or comparison.reasons[-1]}"
    ground, seen = numbers.ground(altitude_m), numbers.difference
    focal = f"fx is {numbers.b.intrinsics.fx:.2f} px, and {numbers.a.intrinsics.fx:.2f} px by {by} of these images"
    height = length(abs(ground.height_cm) / 100)
    if not is_off:
        within = (
            f"; they state it to ±{limit:.0%}" if limit is not None else f", {pixels(seen.max_px)} at most"
        )
        lens = "" if numbers.lens_compared or limit is not None else "; it does not state the distortion"
        near = f"right to {_percent(numbers.scale.change)}, {height} of height at {altitude_m:g} m"
        return f"{near}: {focal}{within}{lens}"
    more = f"; {'; '.join(reasons)}" if reasons else ""
    over = f"{pixels(seen.max_px)} at most over the frame, {length(ground.max_cm / 100)} on the ground"
    if abs(numbers.scale.change) >= comparison.policy.drift_focal:
        by_height = f"off by {_percent(numbers.scale.change)}, {height} of height at {altitude_m:g} m"
        return f"{by_height}, and {over}: {focal}{more}"
    return f"off by {over} at {altitude_m:g} m: {focal}{more}"


def _percent(share: float) -> str:
    return f"{abs(share):.2%}".replace("%", " %")
