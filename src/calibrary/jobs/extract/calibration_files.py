"""The calibration files of a flight: those beside its images, or named; read, and compared with the K of the images.

A measured K of the images decides within the policy's limits. A K derived from focal length and pixel pitch
has an uncertainty of a few per cent and decides only within that.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from enum import StrEnum
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated, Final

from msgspec import Struct

from calibrary import parsers
from calibrary.admission import admission
from calibrary.arguments import Reading
from calibrary.calibration import Calibration, Grade, ImageSize, Intrinsics, Provenance
from calibrary.errors import (
    CalibraryError,
    CalibrationError,
    FrameError,
    InputError,
    MissingSizeError,
    MissingTagError,
    UnknownFormatError,
    first_of,
)
from calibrary.image_size import is_resized
from calibrary.jobs.diff.verdicts import ALARMING
from calibrary.jobs.diff.wording import length, pixels
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.extraction import JudgedCamera
from calibrary.jobs.extract.fallback import CHOICE, StepName, fits, may_be_part
from calibrary.jobs.files import choose, file_of, read_file
from calibrary.jobs.survey import Placed, Survey, Weighed, Who, limit_between, of_file
from calibrary.jobs.survey.limits import NOMINAL, foreign
from calibrary.jobs.survey.placing import Settled
from calibrary.jobs.survey.words import frame_unknown
from calibrary.parsers.format import Sure
from calibrary.policy import Policy
from calibrary.records import Meta, Record, replace
from calibrary.sfm.pixel_check import PixelCheck, PixelVerdict
from calibrary.validation import Severity, Verdict

if TYPE_CHECKING:
    from calibrary.jobs.diff.comparison import DiffReport
    from calibrary.jobs.diff.numbers import Numbers

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
OWN_REPORT: Final = re.compile(rb'\s*\{\s*"schema"\s*:\s*"calibrary/report-')

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
            unreadable.append((name, _reason(error)))
    return found, unreadable


def _reason(error: CalibraryError | OSError) -> str:
    """Why a file cannot be read, without its name."""
    if isinstance(error, InputError):
        return str(type(error)(error.message, place=error.place))
    return str(error)


def _calibration_files(paths: Sequence[Path]) -> Iterator[Path]:
    """The files that may be calibrations by suffix, and those that are by content."""
    counts = Counter(_suffix(path.name) for path in paths)
    for path in paths:
        suffix = _suffix(path.name)
        if SEED.fullmatch(path.name) or _is_own_report(path):
            continue
        if suffix in USUAL or (counts[suffix] <= MOST_OF_A_NAME and _is_claimed(path)):
            yield path


def _is_own_report(path: Path) -> bool:
    """Whether extract wrote it of these images, on which it is no other witness."""
    if path.suffix.lower() != ".json":
        return False
    try:
        with path.open("rb") as file:
            return OWN_REPORT.match(file.read(100)) is not None
    except OSError:
        return False


def _suffix(name: str) -> str:
    return PurePath(name).suffix.lower()


def _is_claimed(path: Path) -> bool:
    """Whether a format recognises a file by more than its layout."""
    try:
        found = parsers.identify(path)
    except InputError:
        return False
    return found.sniff.sure is not Sure.WEAK and found.format.read is not None


def read_given(
    path: Path, which: str | None = None
) -> tuple[str, Callable[[ImageSize], Sequence[Calibration]]]:
    """Read an explicit K of any format; one that states no image size is of the images' size.

    Args:
        path: of the file, or of the folder of a reconstruction.
        which: number or name of the camera in it.

    Raises:
        InputError: nothing there can be read, or has a K, or such a camera.
    """
    if path.is_dir() and file_of(path) is None:
        inside = sorted(one.name for one in path.iterdir() if _suffix(one.name) in USUAL)
        listed = f"; choose one of {first_of(inside)}" if inside else ""
        raise InputError(
            f"is a folder without a reconstruction, expected a file with a K{listed}", source=str(path)
        )
    if path.suffix.lower() != ".npy":
        return path.name, _of_any_format(path, which)
    [calibration] = parsers.read(path, format="k_npy", image_size=(1, 1))
    matrix = calibration.intrinsics.matrix
    made = Provenance(kind="matrix-file", source=path.name, assumptions=("the K given is this camera's",))

    def for_frame(size: ImageSize) -> Sequence[Calibration]:
        K = Intrinsics.from_matrix(matrix, size)
        return [replace(calibration, intrinsics=K, grade=Grade.CALIBRATED, provenance=made, notes=())]

    return path.name, for_frame


def _of_any_format(path: Path, which: str | None) -> Callable[[ImageSize], Sequence[Calibration]]:
    """The cameras of a file, read again with the size of the images if it states none."""

    def read(size: ImageSize | None) -> Sequence[Calibration]:
        found = read_file(path, Reading(image_size=size))
        return found if which is None else [choose(found, which, source=path.name, how=CHOICE)]

    try:
        found = read(None)
    except MissingSizeError:
        return read
    return lambda _: found


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


class Rightness(StrEnum):
    """Whether a calibration may be used for a camera."""

    RIGHT = "right"
    OFF = "off"
    UNKNOWN = "unknown"


class CheckedFile(Record):
    """A calibration file, compared with a camera of the images.

    Attributes:
        file: name of the file.
        verdict: whether its K is right for that camera; unknown if the images give no valid K, or the file but a start.
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
        answer: the verdict on the K in a few words, such as "is off by 1.57 %"; None if the message is all.
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
    answer: str | None = None


def check_candidates(
    candidates: CalibrationsOfFile,
    cameras: Sequence[JudgedCamera],
    policy: Policy,
    altitude_m: float = ALTITUDE_M,
) -> list[CheckedFile]:
    """Compare a file with every camera that it may belong to, using its calibration with the closest focal length.

    A camera whose images may be a part of the file's frame is asked only if no other has images of its shape.
    """
    for fitting in (fits, may_be_part):
        checked = [
            _checked(candidates.label, own, camera, policy, altitude_m)
            for camera in cameras
            if (own := _own(candidates, camera, fitting))
        ]
        if checked:
            return checked
    first = candidates.calibrations[0]
    named = next((why for one in cameras if (why := foreign(first, one.camera.key)) is not None), None)
    whose = f" of {first.camera.model}" if first.camera.model else ""
    sizes = ", ".join(sorted({"{}×{}".format(*one.camera.states[0].metadata.size) for one in cameras}))
    its = "{}×{}".format(*first.intrinsics.image_size)
    message = named or f"it is for images{whose} of {its}, and no camera here has such ({sizes})"
    if not cameras:
        message = "there are no images here to compare it with"
    held = CheckedFile(
        file=candidates.label,
        verdict=Rightness.OFF if cameras else Rightness.UNKNOWN,
        message=message,
        fx=first.intrinsics.fx,
        altitude_m=altitude_m,
    )
    return [_admitted(held, first)]


def _own(
    candidates: CalibrationsOfFile,
    camera: JudgedCamera,
    fitting: Callable[[Calibration, ImageSize], bool],
) -> list[Calibration]:
    """The calibrations of a file that may be of a camera, those that are more than a start if there are any."""
    size, key = size_of(camera), camera.camera.key
    own = [one for one in candidates.calibrations if fitting(one, size) and foreign(one, key) is None]
    return [one for one in own if one.grade.is_metric] or own


def _checked(
    label: str, own: Sequence[Calibration], camera: JudgedCamera, policy: Policy, altitude_m: float
) -> CheckedFile:
    nearest = _nearest(own, camera, policy)
    held = _held(label, nearest, camera, policy, altitude_m, of=len(own))
    return _admitted(_by_pixels(held, nearest, camera, policy), nearest)


def _admitted(held: CheckedFile, K: Calibration) -> CheckedFile:
    """The verdict on a file with what its K is by itself: what no camera has is off, whatever the images tell."""
    found = admission(K)
    if found is None:
        return held
    verdict = Rightness.OFF if found.severity is Severity.ERROR else held.verdict
    return replace(held, verdict=verdict, message=f"{held.message}; its K is unlikely: {found.message}")


def unused(
    files: Sequence[CalibrationsOfFile],
    unreadable: Sequence[tuple[str, str]],
    cameras: Sequence[JudgedCamera],
    policy: Policy,
) -> Iterator[str]:
    """Sentences on the files in the folders of the images that are not used, one for each cause.

    A file that was refused for a camera is in that camera's reason.
    """
    causes: dict[str, list[str]] = {}
    for name, why in unreadable:
        causes.setdefault(why, []).append(name)
    for candidates in files:
        for why in _why_unused(candidates, cameras, policy):
            causes.setdefault(why, []).append(candidates.label)
    for why, names in causes.items():
        yield f"beside the images, but not used: {first_of(names)}: {why}"


def _why_unused(
    candidates: CalibrationsOfFile, cameras: Sequence[JudgedCamera], policy: Policy
) -> Iterator[str]:
    valid = [camera for camera in cameras if _reference(camera) is not None]
    is_metric = any(one.grade.is_metric for one in candidates.calibrations)
    # Else the initial value of another program's adjustment, such as COLMAP's 1.2 × the longer side.
    checked = check_candidates(candidates, valid, policy) if valid and is_metric else []
    of_valid = [one for one in checked if one.camera is not None]
    off = [one.message for one in of_valid if one.verdict is Rightness.OFF]
    sizes = {one.intrinsics.image_size for one in candidates.calibrations}
    own = [camera for camera in cameras if any(is_resized(size, size_of(camera)) for size in sizes)]
    is_measured = any(one.grade.is_measured for one in candidates.calibrations)
    waiting = [camera for camera in cameras if camera.verdict is not Verdict.VALID]
    if off or not (is_measured or waiting):
        yield from off
    elif not own:
        its = first_of(sorted({"{}×{}".format(*size) for size in sizes}))
        found = admission(candidates.calibrations[0])
        unlikely = f"; its K is unlikely: {found.message}" if found is not None else ""
        yield f"it is for {its}, and no camera here has such images{unlikely}"
    elif any(one.verdict is Rightness.RIGHT for one in of_valid):
        if is_measured and candidates.states_size and any(one.uncalibrated for one in own):
            yield "the K of the images is valid without it, but not measured; a registry puts this one in its place"
    elif not candidates.states_size and any(camera in waiting for camera in own):
        yield "it states no image size; --fallback-k takes it as that of these images"


def _nearest(fitting: Sequence[Calibration], camera: JudgedCamera, policy: Policy) -> Calibration:
    """The calibration with the focal length closest to what the images state."""
    reference, stated = _reference(camera), camera.camera.survey(policy).claims
    known = reference or (stated[0].calibration if stated else None)
    if known is None:
        return fitting[0]
    over_width = known.intrinsics.fx / known.intrinsics.image_size[0]
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
        return replace(held, pixels=check, verdict=Rightness.OFF, message=message, answer=f"is {message}")
    text = f"; the pixels of {check.images} images agree: {check.figures}"
    if check.verdict is PixelVerdict.CANNOT_TELL:
        text = f"; the pixels cannot tell: {check.reason}"
    elif K.grade.is_metric and (held.verdict is Rightness.UNKNOWN or _is_far(held, camera, policy)):
        message = f"right by the pixels of {check.images} images: {check.figures}; {held.message}"
        return replace(held, pixels=check, verdict=Rightness.RIGHT, message=message)
    return replace(held, pixels=check, message=held.message + text)


def _is_far(held: CheckedFile, camera: JudgedCamera, policy: Policy) -> bool:
    """Whether a file is off by a nominal source from which it is too far for pixels that agree with both."""
    if held.verdict is not Rightness.OFF or held.fx is None or held.expected_fx is None or _reference(camera):
        return False
    return abs(held.fx / held.expected_fx - 1.0) > 2.0 * policy.source_agreement


def _held(
    label: str, nearest: Calibration, camera: JudgedCamera, policy: Policy, altitude_m: float, *, of: int
) -> CheckedFile:
    """Weigh a file, the nearest ``of`` so many, against everything that states a K for these images."""
    claim = of_file(label, nearest)
    survey = camera.camera.survey(policy, claim)
    found = survey.weigh(claim)
    stated = found.ways[0]
    # Of what speaks for or against it, that which says most: what was measured, then what is known best.
    copies = [one for one in found.copies if one.settled is not Settled.AMBIGUOUS]
    speaking = [one.one for one in found.believed] or [*copies, *found.confirmed_by]
    held_against = min(
        speaking or found.near,
        key=_says_least,
        default=None,
    )
    base = CheckedFile(
        file=label,
        verdict=Rightness.UNKNOWN,
        message=_undecided(found)
        or _untold(survey)
        or f"nothing in the images states a K to compare it with: {camera.camera.reason}",
        camera=camera.slug,
        fx=stated.fx,
        altitude_m=altitude_m,
    )
    if held_against is None:
        return base
    if not nearest.grade.is_metric:
        # A profile of a kind of lens, or a start of another program: near or far, it is no K of this camera.
        least = f", the nearest of {of} that fit" if of > 1 else ""
        message = (
            f"a start only, of grade {nearest.grade.value}{least}, and no K to use as it is: its fx is "
            f"{stated.fx:.2f} px, {_percent(stated.fx / held_against.fx - 1.0)} from the {held_against.fx:.2f} px by "
            f"{held_against.claim.name} of these images"
        )
        return replace(
            base, message=message, held_against=held_against.claim.name, expected_fx=held_against.fx
        )
    doubt = camera.camera.doubt(nearest)
    verdict = _rightness(found, survey, held_against if not speaking else None, doubt)
    base = replace(base, verdict=verdict, held_against=held_against.claim.name, expected_fx=held_against.fx)
    told = _in_numbers(base, held_against, found, policy)
    return told if doubt is None else replace(told, message=f"{told.message}; {doubt}")


def _says_least(one: Placed) -> tuple[bool, bool, float]:
    claim = one.claim
    return not claim.is_measured, claim.who is Who.CATALOGUE, claim.tolerance + claim.rounding


def _rightness(found: Weighed, survey: Survey, silent: Placed | None, doubt: str | None) -> Rightness:
    """Off if something shows it, right if something tells and nothing doubts it.

    Args:
        found: the file among all that states a K for the images.
        survey: all of these.
        silent: the nearest to say something, if nothing confirms it.
        doubt: what programs did to the images.
    """
    if found.verdict is Verdict.REJECTED or (found.believed and not _is_of_other_frame(found, survey)):
        return Rightness.OFF
    is_told = (
        silent is None
        or max(silent.claim.tolerance, silent.claim.engraved) + silent.claim.rounding <= NOMINAL
    )
    is_right = is_told and doubt is None and found.verdict is Verdict.VALID
    return Rightness.RIGHT if is_right else Rightness.UNKNOWN


def _is_of_other_frame(found: Weighed, survey: Survey) -> bool:
    """Whether what is stated of this very image confirms a K, and contradicts all of the whole frame that does not."""
    whole = [one.one for one in found.believed if not one.one.claim.is_framed]
    for one in found.confirmed_by:
        if one.claim.is_framed and len(whole) == len(found.believed):
            against = [other.one for other in survey.weigh(one.claim).against]
            if all(other in against for other in whole):
                return True
    return False


def _undecided(found: Weighed) -> str | None:
    """Why nothing tells, if that is not the other claims' part."""
    grave = [one.message for one in found.findings if one.severity is Severity.UNPROVEN]
    return grave[0] if grave and not found.believed else None


def _untold(survey: Survey) -> str | None:
    """Which claim is of these images by more than one reading, so that it neither confirms nor contradicts a file."""
    unclear = (one for one in survey.placed if one.settled is Settled.AMBIGUOUS)
    return next((frame_unknown(one, []).message for one in unclear), None)


def _in_numbers(held: CheckedFile, other: Placed, found: Weighed, policy: Policy) -> CheckedFile:
    """Add the difference in pixels and on the ground, and the sentence."""
    from calibrary.jobs.diff.comparison import compare  # noqa: PLC0415  rarely needed

    try:
        comparison = compare(other.calibration, found.ways[0].calibration, policy)
    except (FrameError, CalibrationError, InputError) as error:
        text = f"not comparable with {other.claim.name} of these images: {error.why}"
        return replace(held, verdict=Rightness.OFF, message=text)
    numbers = comparison.detail
    if numbers is None:
        reasons = [one.reason for one in comparison.structural if one.kind in ALARMING]
        message = f"{_word(held)}: {'; '.join(reasons) or comparison.reasons[-1]}"
        return replace(
            held, message=message, answer=f"is {message}" if held.verdict is Rightness.OFF else None
        )
    ground = numbers.ground(held.altitude_m)
    answer, detail = _told(held, numbers, comparison, other, found)
    return replace(
        held,
        message=f"{answer}: {detail}" if detail else answer,
        answer=f"cannot be used: {answer}" if held.verdict is Rightness.UNKNOWN else f"is {answer}",
        scale_change=numbers.scale.change,
        rms_px=numbers.difference.rms_px,
        max_px=numbers.difference.max_px,
        height_cm=ground.height_cm,
        max_cm=ground.max_cm,
    )


def _word(held: CheckedFile) -> str:
    return "the images do not tell" if held.verdict is Rightness.UNKNOWN else held.verdict.value


def _reference(camera: JudgedCamera) -> Calibration | None:
    """The K that is used for the images; None if it is another file's, or if there is none."""
    taken = camera.fallback.taken if camera.fallback is not None else None
    if taken is not None and taken.step is StepName.REGISTRY and camera.verdict is Verdict.VALID:
        return camera.calibration
    return camera.camera.calibration if camera.camera.verdict is Verdict.VALID else None


def _told(
    held: CheckedFile, numbers: Numbers, comparison: DiffReport, other: Placed, found: Weighed
) -> tuple[str, str]:
    """The verdict and the difference in a few words, and by what."""
    altitude_m, seen, ground = held.altitude_m, numbers.difference, numbers.ground(held.altitude_m)
    fx, expected = numbers.b.intrinsics.fx, numbers.a.intrinsics.fx
    focal = f"fx is {fx:.2f} px, and {expected:.2f} px by {other.claim.name} of these images"
    height = f"{length(abs(ground.height_cm) / 100)} of height at {altitude_m:g} m"
    off, most = _percent(numbers.scale.change), f"{pixels(seen.max_px)} at most"
    remarks = "".join(f"; {one}" for one in found.remarks)
    known = f"; they state it to ±{limit_between(found.claim, other.claim):.0%}"
    is_measured = other.claim.is_measured
    if held.verdict is Rightness.UNKNOWN:
        why = _undecided(found) or f"{focal}{known}, which does not contradict it"
        return "the images do not tell", f"{why}{remarks}"
    if held.verdict is Rightness.RIGHT:
        lens = "" if numbers.lens_compared or not is_measured else "; it does not state the distortion"
        return f"right to {off}, {height}", f"{focal}{f', {most}' if is_measured else known}{lens}{remarks}"
    if not found.believed:
        return f"off: {found.findings[0].message}, {most} over the frame", ""
    if not is_measured:
        return f"off by {off}, {height}", f"{focal}{known}{remarks}"
    kinds = "".join(f"; {one.reason}" for one in comparison.structural if one.kind in ALARMING)
    over = f"{most} over the frame, {length(ground.max_cm / 100)} on the ground"
    if abs(numbers.scale.change) >= numbers.policy.drift_focal:
        return f"off by {off}, {height}, and {over}", f"{focal}{kinds}{remarks}"
    return f"off by {over} at {altitude_m:g} m", f"{focal}{kinds}{remarks}"


def _percent(share: float) -> str:
    return f"{abs(share):.2%}".replace("%", " %")
