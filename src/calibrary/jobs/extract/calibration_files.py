"""The calibration files of a flight: those beside its images, or named; read, and compared with the K of the images.

A measured K of the images decides within the policy's limits. A K derived from focal length and pixel pitch
has an uncertainty of a few per cent and decides only within that.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from enum import StrEnum
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated, Final

from msgspec import Struct

from calibrary import parsers
from calibrary.arguments import Reading
from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import (
    CalibraryError,
    CalibrationError,
    FrameError,
    InputError,
    MissingTagError,
    UnknownFormatError,
)
from calibrary.jobs.diff.verdicts import ALARMING, Kind
from calibrary.jobs.diff.wording import length, pixels
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.extraction import JudgedCamera
from calibrary.jobs.extract.fallback import MEASURED, StepName, fits
from calibrary.jobs.files import choose, read_file
from calibrary.jobs.weigh import NOMINAL, Source, foreign, of_tags, weigh
from calibrary.parsers.format import Sure
from calibrary.policy import Policy
from calibrary.records import Meta, Record, replace
from calibrary.sfm.pixel_check import PixelCheck, PixelVerdict
from calibrary.validation import Verdict

if TYPE_CHECKING:
    from calibrary.jobs.diff.comparison import DiffReport

__all__ = [
    "ALTITUDE_M",
    "CalibrationsOfFile",
    "CheckedFile",
    "Rightness",
    "check_candidates",
    "contradictions",
    "may_be_calibration",
    "read_calibration_files",
    "read_candidates",
    "size_of",
]

USUAL: Final = frozenset(
    {".xml", ".yml", ".yaml", ".json", ".cal", ".txt", ".cam", ".opt", ".ini", ".toml", ".npy"}
)
"""Suffixes of calibration files: an unreadable one is reported. Any other file is one only if its content shows it."""
LARGEST_MIB: Final = 4
LARGEST_OF_ANY_NAME: Final = 256 << 10
"""Files with another suffix that are larger than this many bytes are not opened, such as flight logs."""
MOST_OF_A_NAME: Final = 50
"""More files than this with one unusual suffix are files that a camera or program writes for each image."""
SEED: Final = re.compile(r".*_(seed|unproven)(\..+)?\.npy")
"""Names of files that extract itself writes for a K that is not valid."""

CENTRED: Final = 0.1
"""Largest distance of the principal point from the image centre, as a fraction, for a K without an image size."""


class CalibrationsOfFile(Struct, frozen=True, kw_only=True):
    """The calibrations of one file.

    Attributes:
        label: file name.
        calibrations: its cameras.
        states_size: whether the file states image sizes; otherwise those of the images' cameras are used.
    """

    label: str
    calibrations: tuple[Calibration, ...]
    states_size: bool = True


def may_be_calibration(entry: os.DirEntry[str]) -> bool:
    """Whether a file may be a calibration, by its suffix or because it is small."""
    if _suffix(entry.name) in USUAL:
        return True
    try:
        return entry.stat().st_size <= LARGEST_OF_ANY_NAME
    except OSError:
        return False


def read_calibration_files(
    paths: Sequence[Path], root: Path, cameras: Sequence[JudgedCamera | Camera]
) -> tuple[list[CalibrationsOfFile], list[tuple[str, str]]]:
    """Read all calibration files in the folders of the images; also returns the unreadable ones, with the reason.

    Args:
        paths: candidate files in the folders of the images.
        root: folder that names are relative to.
        cameras: of the images.
    """
    found: list[CalibrationsOfFile] = []
    unreadable: list[tuple[str, str]] = []
    for path in _calibration_files(paths):
        name = path.relative_to(root).as_posix()
        try:
            found.append(read_candidates(path, name, cameras, Reading(max_size_mib=LARGEST_MIB)))
        except UnknownFormatError:
            continue
        except (CalibraryError, OSError) as error:
            unreadable.append((name, str(error)))
    return found, unreadable


def _calibration_files(paths: Sequence[Path]) -> Iterator[Path]:
    """The files that may be calibrations by suffix, and those that are by content."""
    counts = Counter(_suffix(path.name) for path in paths)
    for path in paths:
        suffix = _suffix(path.name)
        if SEED.fullmatch(path.name):
            continue
        if suffix in USUAL or (counts[suffix] <= MOST_OF_A_NAME and _is_claimed(path)):
            yield path


def _suffix(name: str) -> str:
    return PurePath(name).suffix.lower()


def _is_claimed(path: Path) -> bool:
    """Whether a format recognises a file by more than its layout."""
    try:
        found = parsers.identify(path)
    except InputError:
        return False
    return found.sniff.sure is not Sure.WEAK and found.format.read is not None


def read_candidates(
    path: Path, label: str, cameras: Sequence[JudgedCamera | Camera], reading: Reading
) -> CalibrationsOfFile:
    """Read a calibration file; if it states no image size, those of the images are used.

    Args:
        path: of the file.
        label: name of the file in messages.
        cameras: of the images.
        reading: what the file does not state itself.

    Raises:
        InputError: the file cannot be read.
    """

    def read(size: ImageSize | None) -> Sequence[Calibration]:
        found = read_file(path, replace(reading, image_size=size))
        return found if reading.camera is None else [choose(found, reading.camera, source=label)]

    try:
        return CalibrationsOfFile(label=label, calibrations=tuple(read(reading.image_size)))
    except MissingTagError:
        sizes = dict.fromkeys(size_of(camera) for camera in cameras)
        found = [one for size in sizes for one in read(size)]
        if not found:
            raise
        centred = [one for one in found if _is_centred(one)]
        return CalibrationsOfFile(label=label, calibrations=tuple(centred or found), states_size=False)


def size_of(camera: JudgedCamera | Camera) -> ImageSize:
    """Width and height in px of a camera's images."""
    one = camera.camera if isinstance(camera, JudgedCamera) else camera
    return one.states[0].metadata.size


def _is_centred(calibration: Calibration) -> bool:
    K = calibration.intrinsics
    width, height = K.image_size
    return abs(K.cx / width - 0.5) < CENTRED and abs(K.cy / height - 0.5) < CENTRED


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
    candidates: CalibrationsOfFile,
    cameras: Sequence[JudgedCamera],
    policy: Policy,
    altitude_m: float = ALTITUDE_M,
) -> list[CheckedFile]:
    """Compare a file with every camera that it may belong to, using its calibration with the closest focal length."""
    checked: list[CheckedFile] = []
    for camera in cameras:
        size = camera.camera.states[0].metadata.size
        sized = [one for one in candidates.calibrations if fits(one, size)]
        fitting = [one for one in sized if foreign(one, camera.camera.key) is None]
        if fitting:
            nearest = _nearest(fitting, camera)
            held = _against_reference(candidates.label, nearest, camera, policy, altitude_m)
            checked.append(_by_pixels(held, nearest, camera, policy))
    if checked:
        return checked
    first = candidates.calibrations[0]
    named = next((why for one in cameras if (why := foreign(first, one.camera.key)) is not None), None)
    whose = f" of {first.camera.model}" if first.camera.model else ""
    sizes = ", ".join(sorted({"{}×{}".format(*one.camera.states[0].metadata.size) for one in cameras}))
    own = "{}×{}".format(*first.intrinsics.image_size)
    message = named or f"it is for images{whose} of {own}, and no camera here has such ({sizes})"
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
    files: Sequence[CalibrationsOfFile], cameras: Sequence[JudgedCamera], policy: Policy
) -> Iterator[str]:
    """Sentences on the files in the folders of the images that are wrong for these images."""
    valid = [camera for camera in cameras if _reference(camera) is not None]
    for candidates in files:
        if not any(one.grade.is_metric for one in candidates.calibrations):
            continue  # the initial value of another program's adjustment, such as COLMAP's 1.2 × the longer side
        for found in check_candidates(candidates, valid, policy) if valid else ():
            if found.verdict is Rightness.OFF and found.camera is not None:
                yield f"{found.file}, which is beside the images and is not used, is {found.message}"


def _nearest(fitting: Sequence[Calibration], camera: JudgedCamera) -> Calibration:
    """The calibration with the focal length closest to that of the camera."""
    reference = _reference(camera)
    if reference is None:
        return fitting[0]
    over_width = reference.intrinsics.fx / reference.intrinsics.image_size[0]
    return min(fitting, key=lambda one: abs(one.intrinsics.fx / one.intrinsics.image_size[0] - over_width))


def _by_pixels(held: CheckedFile, K: Calibration, camera: JudgedCamera, policy: Policy) -> CheckedFile:
    """Add the check against the pixels: if they contradict the file it is off, whatever the tags state.

    If they agree, K and the pixels are two witnesses: against tags that give no valid K, and against a nominal one that
    is so far away that it cannot agree with the pixels too.
    """
    if camera.look is None:
        return held
    check = camera.look.check(K.scaled(size_of(camera)), policy.source_agreement)
    if check.verdict is PixelVerdict.CONTRADICTS:
        message = f"off by the pixels of {check.images} images: {check.figures}; {check.reason}"
        return replace(held, pixels=check, verdict=Rightness.OFF, message=message)
    text = f"; the pixels of {check.images} images agree: {check.figures}"
    if check.verdict is PixelVerdict.CANNOT_TELL:
        text = f"; the pixels cannot tell: {check.reason}"
    elif held.verdict is Rightness.UNKNOWN or _is_far(held, camera, policy):
        message = f"right by the pixels of {check.images} images: {check.figures}; {held.message}"
        return replace(held, pixels=check, verdict=Rightness.RIGHT, message=message)
    return replace(held, pixels=check, message=held.message + text)


def _is_far(held: CheckedFile, camera: JudgedCamera, policy: Policy) -> bool:
    """Whether a file is off by a nominal source from which it is too far for pixels that agree with both."""
    if held.verdict is not Rightness.OFF or held.fx is None or held.expected_fx is None or _reference(camera):
        return False
    return abs(held.fx / held.expected_fx - 1.0) > 2.0 * policy.source_agreement


def _against_reference(
    label: str, nearest: Calibration, camera: JudgedCamera, policy: Policy, altitude_m: float
) -> CheckedFile:
    reference = _reference(camera)
    if reference is None:
        return _weighed(label, nearest, camera, policy, altitude_m)
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
    numbers = comparison.detail
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


def _weighed(
    label: str, nearest: Calibration, camera: JudgedCamera, policy: Policy, altitude_m: float
) -> CheckedFile:
    """Weigh a file against sources of which none gives a valid K by itself."""
    sources = list(of_tags(camera.camera.evidence.estimates, camera.camera.key))
    stated = Source.measured(label, nearest.scaled(size_of(camera)))
    found = weigh(stated, sources, camera.camera.key, policy)
    focal = f"fx is {stated.fx:.2f} px"
    near = (*found.confirmed_by, *sorted(sources, key=lambda one: one.tolerance))
    expected = near[0] if near else None
    if not found.may_be_used:
        expected = found.contradicted_by[0].source if found.contradicted_by else None
        verdict, message = Rightness.OFF, f"off: {focal}, and {found.reason}"
    elif expected is None:
        verdict = Rightness.UNKNOWN
        message = f"nothing in the images states a K to compare it with: {camera.camera.reason}"
    elif found.confirmed_by or expected.tolerance <= NOMINAL:
        verdict = Rightness.RIGHT
        message = f"right as far as the images tell: {focal}, and {_by(expected)}; the principal point was not judged"
    else:
        verdict = Rightness.UNKNOWN
        message = f"the images do not tell: {focal}, and {_by(expected)}, which does not contradict it"
    return CheckedFile(
        file=label,
        verdict=verdict,
        message=message,
        camera=camera.slug,
        held_against=expected.name if expected is not None else None,
        fx=nearest.intrinsics.fx,
        expected_fx=expected.fx if expected is not None else None,
        altitude_m=altitude_m,
    )


def _by(source: Source) -> str:
    within = f"±{source.tolerance:.0%}" if source.tolerance else "as measured"
    return f"{source.fx:.2f} px {within} by {source.name} of these images"


def _reference(camera: JudgedCamera) -> Calibration | None:
    """The K that files are compared with: a valid one from the images or the registry, never one from another file."""
    steps = camera.fallback.steps if camera.fallback is not None else ()
    if steps and steps[-1].step is StepName.REGISTRY and camera.verdict is Verdict.VALID:
        return camera.calibration
    return camera.camera.calibration if camera.camera.verdict is Verdict.VALID else None


def _is_off(comparison: DiffReport, camera: JudgedCamera, policy: Policy) -> tuple[bool, float | None]:
    """Whether the file is wrong; and, if the images' K is derived, the uncertainty of that K."""
    numbers = comparison.detail
    kinds = {one.kind for one in comparison.structural} & ALARMING
    if comparison.a.calibration.grade in MEASURED:
        if numbers is None or kinds:
            return True, None
        excused = numbers.is_measured and numbers.significance is not None and numbers.significance.explains
        return numbers.matters and not excused, None
    known = camera.camera.states[0].known.camera is not None
    limit = (policy.known_camera_tolerance if known else None) or policy.source_agreement
    if numbers is None or kinds - CONVENTIONS:
        return True, limit
    K = numbers.b.intrinsics
    width, height = K.image_size
    drift = max(abs(K.cx / width - 0.5), abs(K.cy / height - 0.5))
    return abs(numbers.focal_change) > limit or drift > policy.principal_point_drift_max, limit


def _message(comparison: DiffReport, by: str, limit: float | None, altitude_m: float, *, is_off: bool) -> str:
    numbers = comparison.detail
    reasons = [one.reason for one in comparison.structural if one.kind in ALARMING]
    if numbers is None:
        return f"off: {'; '.join(reasons) or comparison.reasons[-1]}"
    ground, seen = numbers.ground(altitude_m), numbers.difference
    focal = f"fx is {numbers.b.intrinsics.fx:.2f} px, and {numbers.a.intrinsics.fx:.2f} px by {by} of these images"
    height = length(abs(ground.height_cm) / 100)
    if not is_off:
        within = (
            f"; they state it to ±{limit:.0%}, and the principal point was not judged"
            if limit is not None
            else f", {pixels(seen.max_px)} at most"
        )
        lens = "" if numbers.lens_compared or limit is not None else "; it does not state the distortion"
        near = f"right to {_percent(numbers.scale.change)}, {height} of height at {altitude_m:g} m"
        return f"{near}: {focal}{within}{lens}"
    more = f"; {'; '.join(reasons)}" if reasons else ""
    over = f"{pixels(seen.max_px)} at most over the frame, {length(ground.max_cm / 100)} on the ground"
    if abs(numbers.scale.change) >= numbers.policy.drift_focal:
        by_height = f"off by {_percent(numbers.scale.change)}, {height} of height at {altitude_m:g} m"
        return f"{by_height}, and {over}: {focal}{more}"
    return f"off by {over} at {altitude_m:g} m: {focal}{more}"


def _percent(share: float) -> str:
    return f"{abs(share):.2%}".replace("%", " %")
