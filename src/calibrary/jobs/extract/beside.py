"""A calibration that someone is about to use, held against what the images state of their camera.

What the images measured decides by the policy's limits. A K that was derived from focal length and pixel pitch is
itself known to a few per cent only, and decides no more than that.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated, Final

from msgspec import Struct

from calibrary import parsers
from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import (
    CalibraryError,
    CalibrationError,
    FrameError,
    InputError,
    MissingTagError,
    UnknownFormatError,
)
from calibrary.jobs.diff.kinds import ALARMING, Kind
from calibrary.jobs.diff.wording import length, pixels
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.extraction import CameraReport
from calibrary.jobs.extract.fallback import MEASURED, StepName, fits
from calibrary.parsers.files import MAX_BYTES
from calibrary.parsers.format import Sure
from calibrary.policy import Policy
from calibrary.records import Meta, Record, replace
from calibrary.sfm.pixel_check import PixelCheck, PixelVerdict
from calibrary.validation import Verdict

if TYPE_CHECKING:
    from calibrary.jobs.diff.comparison import Comparison

__all__ = [
    "ALTITUDE_M",
    "Candidates",
    "CheckedFile",
    "Rightness",
    "check_candidates",
    "contradictions",
    "find_candidates",
    "may_be_calibration",
    "read_candidates",
]

USUAL: Final = frozenset(
    {".xml", ".yml", ".yaml", ".json", ".cal", ".txt", ".cam", ".opt", ".ini", ".toml", ".npy"}
)
"""Names under which a file that cannot be read is reported; under any other name its content has to claim it."""
LARGEST: Final = 4 << 20
LARGEST_OF_ANY_NAME: Final = 256 << 10
"""A file under another name; flight logs and the like, which are longer, are not opened."""
MOST_OF_A_NAME: Final = 50
"""More files of one unusual suffix are what a camera or a program writes for each image."""
SEED: Final = re.compile(r".*_(seed|unproven)(\..+)?\.npy")
"""What extract itself calls no valid K."""

ALTITUDE_M: Final = 100.0
CENTRED: Final = 0.1
"""How far from the middle of its frame the principal point of a K without an image size may lie."""
CONVENTIONS: Final = frozenset(
    {Kind.HALF_PIXEL, Kind.ORIGIN, Kind.FROM_CENTRE, Kind.DEWARP_ON, Kind.DEWARP_OFF}
)
"""Changes that show against a measured K only: the principal point of a derived one is assumed."""


class Rightness(StrEnum):
    """Whether a calibration may be used for a camera."""

    RIGHT = "right"
    OFF = "off"
    UNKNOWN = "unknown"


class CheckedFile(Record):
    """A calibration file, held against a camera of the images.

    Attributes:
        file: its name.
        verdict: whether its K is right for that camera; unknown where the images give no valid K.
        message: that and by how much, in one sentence.
        camera: name of the camera in file names; None where the file fits none of them.
        held_against: what the images state K by.
        fx, expected_fx: of the file and of the images, px.
        scale_change: of the image scale, as a share of f: what of the focal length's difference the distortion does
            not make up for.
        rms_px, max_px: of the difference of the projections over the frame, the camera free to turn.
        altitude_m: above ground, of the errors on the ground.
        height_cm, max_cm: error of heights there, and the largest in position.
        pixels: what the pixels of some images say of its K; None where they were not asked.
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


class Candidates(Struct, frozen=True, kw_only=True):
    """The calibrations of one file.

    Attributes:
        label: the file's name.
        calibrations: its cameras.
        states_size: whether it states the size of its images, which are the cameras' own else.
    """

    label: str
    calibrations: tuple[Calibration, ...]
    states_size: bool = True


def may_be_calibration(entry: os.DirEntry[str]) -> bool:
    """Whether a file beside the images is worth a look: by its name, or because it is short."""
    if _suffix(entry.name) in USUAL:
        return True
    try:
        return entry.stat().st_size <= LARGEST_OF_ANY_NAME
    except OSError:
        return False


def find_candidates(
    paths: Sequence[Path], root: Path, cameras: Sequence[CameraReport | Camera]
) -> tuple[list[Candidates], list[tuple[str, str]]]:
    """Every calibration file that lies with the images, and those that could not be read, with the reason.

    Args:
        paths: the files beside the images that may be such.
        root: names are relative to it.
        cameras: of the images.
    """
    found: list[Candidates] = []
    unreadable: list[tuple[str, str]] = []
    for path in _calibration_files(paths):
        name = path.relative_to(root).as_posix()
        try:
            found.append(read_candidates(path, name, cameras, max_bytes=LARGEST))
        except UnknownFormatError:
            continue
        except (CalibraryError, OSError) as error:
            unreadable.append((name, str(error)))
    return found, unreadable


def _calibration_files(paths: Sequence[Path]) -> Iterator[Path]:
    """What may be a calibration by its name, and what is one by its content whatever its name."""
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
    """Whether a format claims a file by more than its shape."""
    try:
        found = parsers.identify(path)
    except InputError:
        return False
    return found.sniff.sure is not Sure.WEAK and found.format.read is not None


def read_candidates(
    path: Path,
    label: str,
    cameras: Sequence[CameraReport | Camera],
    *,
    form: str | None = None,
    image_size: ImageSize | None = None,
    options: Mapping[str, str] | None = None,
    max_bytes: int = MAX_BYTES,
) -> Candidates:
    """Read a calibration file; one that states no image size is taken to be of the images' sizes.

    Args:
        path: of the file.
        label: what to call it.
        cameras: of the images.
        form: format of a file whose content does not settle it.
        image_size: (width, height) px, for a file that does not say it.
        options: answers to what only the file's owner knows.
        max_bytes: the longest file that is read.

    Raises:
        InputError: the file cannot be read.
    """

    def read(size: ImageSize | None) -> Sequence[Calibration]:
        return parsers.read(path, format=form, image_size=size, options=options, max_bytes=max_bytes)

    try:
        return Candidates(label=label, calibrations=tuple(read(image_size)))
    except MissingTagError:
        sizes = dict.fromkeys(_size(camera) for camera in cameras)
        found = [one for size in sizes for one in read(size)]
        if not found:
            raise
        centred = [one for one in found if _is_centred(one)]
        return Candidates(label=label, calibrations=tuple(centred or found), states_size=False)


def check_candidates(
    candidates: Candidates, cameras: Sequence[CameraReport], policy: Policy, altitude_m: float = ALTITUDE_M
) -> list[CheckedFile]:
    """Hold one file's calibrations against every camera that they can be of, the nearest of them against each."""
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
    """What is beside the images and would be wrong for them, each in one sentence."""
    valid = [camera for camera in cameras if _reference(camera) is not None]
    for candidates in files:
        if not any(one.grade.is_metric for one in candidates.calibrations):
            continue  # where another program starts its adjustment, such as COLMAP's 1.2 × the longer side
        for found in check_candidates(candidates, valid, policy) if valid else ():
            if found.verdict is Rightness.OFF and found.camera is not None:
                yield f"{found.file}, which is beside the images and is not used, is {found.message}"


def _size(camera: CameraReport | Camera) -> ImageSize:
    one = camera.camera if isinstance(camera, CameraReport) else camera
    return one.states[0].metadata.size


def _is_centred(calibration: Calibration) -> bool:
    K = calibration.intrinsics
    width, height = K.image_size
    return abs(K.cx / width - 0.5) < CENTRED and abs(K.cy / height - 0.5) < CENTRED


def _nearest(fitting: Sequence[Calibration], camera: CameraReport) -> Calibration:
    """Of a file's calibrations that fit a camera the one with the nearest focal length."""
    reference = _reference(camera)
    if reference is None:
        return fitting[0]
    over_width = reference.intrinsics.fx / reference.intrinsics.image_size[0]
    return min(fitting, key=lambda one: abs(one.intrinsics.fx / one.intrinsics.image_size[0] - over_width))


def _by_pixels(held: CheckedFile, K: Calibration, camera: CameraReport, policy: Policy) -> CheckedFile:
    """The same with what the pixels say: where they contradict the file it is off, whatever the tags state."""
    if camera.look is None:
        return held
    check = camera.look.check(K.scaled(_size(camera)), policy.source_agreement)
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
            message=f"the images give no valid K to hold it against: {camera.camera.reason}",
            camera=camera.slug,
            fx=nearest.intrinsics.fx,
            altitude_m=altitude_m,
        )
    by = reference.provenance.tag or reference.provenance.source or reference.provenance.kind
    from calibrary.jobs.diff.comparison import compare  # noqa: PLC0415  what few runs need

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
    """What a file is held against: a valid K of the images' own or of the registry, never one from another file."""
    steps = camera.fallback.steps if camera.fallback is not None else ()
    if steps and steps[-1].step is StepName.REGISTRY and camera.verdict is Verdict.VALID:
        return camera.calibration
    return camera.camera.calibration if camera.camera.verdict is Verdict.VALID else None


def _is_off(comparison: Comparison, camera: CameraReport, policy: Policy) -> tuple[bool, float | None]:
    """Whether it is wrong; and, where the images' K is derived, how near that K itself is."""
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
