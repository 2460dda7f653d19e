"""The gate from end to end: a directory of images in, one judged K per camera out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from calibrary.calibration import CameraKey, ImageSize
from calibrary.errors import InputError, ValidationError
from calibrary.evidence.frame import exif_contradiction
from calibrary.evidence.metadata import TagFault
from calibrary.jobs.extract.beside import contradictions, find_candidates
from calibrary.jobs.extract.cameras import DEFAULT_SENSOR_MM, Camera, Sensor, State, group_cameras
from calibrary.jobs.extract.extraction import CameraReport, Extraction, slugs_of
from calibrary.jobs.extract.fallback import Fallback, Sources, fall_back, outranking, read_matrix
from calibrary.jobs.extract.gather import Gathered, SkippedFile, collect_images, gather
from calibrary.jobs.extract.judging import judge
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.extract.pictures import set_aside_pictures
from calibrary.policy import FLEET, Policy
from calibrary.progress import Progress, counted, log, stage
from calibrary.validation import Finding, Report, Severity, Verdict

__all__ = ["Request", "run"]

PACKETS = ("XMP", "GDAL_METADATA")
"""Tags that carry calibrations of their own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What to do.

    Attributes:
        images: a folder, or images and folders.
        sensor_mm: (width, height) the user stated; a side or both None where not stated.
        policy: what K is held against.
        fallback_k: a .npy with K for when the images yield none.
        registry: a fleet registry's folder.
        lock: the file that pins entries of it; no others are used then.
        recursive: go into sub-folders.
        workers: processes; 0 decides by itself.
        strict: stop at the first breach.
        progress: called with (images read, images in all, "images").
    """

    images: tuple[Path, ...]
    sensor_mm: tuple[float | None, float | None] = (None, None)
    policy: Policy = FLEET
    fallback_k: Path | None = None
    registry: Path | None = None
    lock: Path | None = None
    recursive: bool = False
    workers: int = 0
    strict: bool = False
    progress: Progress | None = field(default=None, compare=False)


def run(request: Request) -> Extraction:
    """Extract one K per camera.

    Raises:
        InputError: a folder, the fallback K or the lock cannot be read, or there is no image.
        RegistryError: the registry cannot be read, or has drifted from the lock.
        ValidationError: ``strict`` and something breached the policy.
    """
    knowledge = Knowledge.load(request.registry, request.lock)
    matrix = read_matrix(request.fallback_k) if request.fallback_k is not None else None
    found = collect_images(request.images, recursive=request.recursive)
    if not found.paths:
        hint = "" if request.recursive else "; if they lie in sub-folders, add --recursive"
        source = ", ".join(map(str, request.images))
        raise InputError(f"contains no images (JPEG, TIFF, DNG, HEIF, PNG){hint}", source=source)
    with stage(f"read the heads of {len(found.paths)} images"):
        gathered = gather(
            found.paths,
            found.root,
            workers=request.workers,
            progress=counted(request.progress, len(found.paths), "images"),
            stop_at_first=request.strict,
        )
    gathered.rejected.extend(found.unreadable)
    _skip_contradictions(gathered)
    pictures = set_aside_pictures(gathered)
    for skipped in (*gathered.rejected, *pictures):
        log.info("skipped %s: %s", skipped.name, skipped.reason)
    if request.strict and gathered.rejected:
        first = gathered.rejected[0]
        raise _breach(request.policy, "image", f"{first.name}: {first.reason}")

    with stage("derived and judged K"):
        states = group_cameras(gathered.states, knowledge, found.root)
        sensor, warnings = _sensor(request, states)
        cameras = [one for key, group in states.items() for one in _judged(key, group, request, sensor)]
    rivals = _rivals(cameras)
    beside, unreadable = find_candidates(found.folders, found.root, cameras, recursive=request.recursive)
    sources = Sources(
        matrix=matrix,
        files=tuple((one.label, K) for one in beside if one.states_size for K in one.calibrations),
        unreadable=tuple(unreadable),
        knowledge=knowledge,
        rivals=rivals,
    )
    names = slugs_of(cameras)
    reports = tuple(
        CameraReport(slug=slug, camera=camera, fallback=_fallback(camera, request.policy, sources))
        for slug, camera in zip(names, cameras, strict=True)
    )
    contradicting = contradictions(beside, reports, request.policy)
    return Extraction(
        policy=request.policy,
        cameras=reports,
        rejected=tuple(gathered.rejected),
        skipped=pictures,
        warnings=(*knowledge.warnings, *_unread(gathered), *warnings, *contradicting),
    )


def _unread(gathered: Gathered) -> Iterator[str]:
    """What an image carries of its camera and could not be read: a calibration may have been in it."""
    found: dict[TagFault, list[str]] = {}
    for metadata, names in gathered.states.items():
        for fault in metadata.faults:
            if fault.tag.startswith(PACKETS):
                found.setdefault(fault, []).extend(names)
    for fault, names in found.items():
        named = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more images"
        yield f"{named}: {fault.tag} is not read: {fault.found}; expected {fault.expected}"


def _skip_contradictions(gathered: Gathered) -> None:
    """An image whose EXIF is of another frame is no evidence of any camera."""
    for metadata in list(gathered.states):
        contradiction = exif_contradiction(metadata)
        if contradiction is not None:
            names = gathered.states.pop(metadata)
            gathered.rejected.extend(SkippedFile(name=name, reason=contradiction) for name in names)
    gathered.rejected.sort(key=lambda rejected: rejected.name)


def _sensor(
    request: Request, states: Mapping[CameraKey, tuple[State, ...]]
) -> tuple[Sensor, tuple[str, ...]]:
    """The sensor size that counts for this run: stated sizes hold for one camera, never for several."""
    default = Sensor(size_mm=DEFAULT_SENSOR_MM, given=False)
    if request.sensor_mm == (None, None):
        return default, ()
    # A stripped file has no focal length to divide by a sensor: it is no second camera here.
    cameras = [key for key, group in states.items() if any(state.metadata.focal_mm for state in group)]
    if len(cameras) <= 1:
        return Sensor(size_mm=request.sensor_mm, given=True), ()
    names = ", ".join(str(key) for key in cameras[:4]) + (", …" if len(cameras) > 4 else "")
    warning = (
        f"the sensor size given is not used: the images are of {len(cameras)} cameras ({names}), and one "
        "sensor size cannot apply to all of them; state it for a folder with one camera"
    )
    return default, (warning,)


def _judged(key: CameraKey, group: tuple[State, ...], request: Request, sensor: Sensor) -> tuple[Camera, ...]:
    cameras = judge(key, group, policy=request.policy, sensor=sensor)
    for camera in cameras:
        if request.strict and camera.verdict is not Verdict.VALID:
            rule = camera.report.failures[0].rule if camera.report is not None else "intrinsics"
            raise _breach(request.policy, rule, f"{camera.key}: {camera.reason}; {camera.remedy}")
    return cameras


def _breach(policy: Policy, rule: str, message: str) -> ValidationError:
    finding = Finding(rule=rule, severity=Severity.ERROR, message=message)
    return ValidationError(message, Report(policy=policy.name, findings=(finding,)))


def _rivals(cameras: list[Camera]) -> dict[ImageSize, int]:
    counts: dict[ImageSize, int] = {}
    for camera in cameras:
        size = camera.key.image_size
        if size is not None and camera.verdict is not Verdict.VALID:
            counts[size] = counts.get(size, 0) + 1
    return counts


def _fallback(camera: Camera, policy: Policy, sources: Sources) -> Fallback | None:
    """Go through the chain unless the camera's own K is valid; an unproven K yields to a valid one only.

    A valid K that was only derived yields to a measured entry of the registry that agrees with it.
    """
    if camera.verdict is Verdict.VALID:
        return outranking(camera, policy, sources)
    fallback = fall_back(camera, policy, sources)
    if camera.verdict is Verdict.REJECTED:
        return fallback
    better = fallback.report is not None and fallback.report.verdict is Verdict.VALID
    return fallback if better else Fallback(steps=fallback.steps)
