"""The extract job: from a directory of images to one validated K per camera."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct

from calibrary.calibration import CameraKey, ImageSize, Intrinsics
from calibrary.errors import InputError, ValidationError
from calibrary.evidence.metadata import ImageMetadata, TagFault
from calibrary.extras import SFM, require
from calibrary.jobs.extract.calibration_files import contradictions, find_candidates, may_be_calibration
from calibrary.jobs.extract.cameras import (
    DEFAULT_SENSOR_MM,
    Camera,
    Sensor,
    State,
    group_cameras,
    sort_images,
)
from calibrary.jobs.extract.extraction import CameraReport, Extraction, slugs_of
from calibrary.jobs.extract.fallback import Fallback, Sources, fall_back, outranking, read_matrix
from calibrary.jobs.extract.judging import judge
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.images.accumulator import ByDay, Names
from calibrary.jobs.images.cluster import MERGED, PIECE, connected
from calibrary.jobs.images.listing import LISTED, Listing
from calibrary.jobs.images.observation import path_order
from calibrary.jobs.images.places import shown
from calibrary.jobs.images.reading import Engine, Question, Reading, here, read_images
from calibrary.policy import FLEET, Policy
from calibrary.progress import Progress, counted, log, stage
from calibrary.validation import Finding, Report, Severity, Verdict

if TYPE_CHECKING:
    from calibrary.jobs.resolve.layers import Place

__all__ = ["Request", "run"]

PACKETS = ("XMP", "GDAL_METADATA")
"""Tags that can contain a calibration."""


class Request(Struct, frozen=True, kw_only=True):
    """Arguments of an extraction.

    Attributes:
        images: a folder, an archive or a URL; or images and any number of these.
        lines: more images, one per line.
        sensor_mm: sensor (width, height) stated by the user; a side that was not stated is None.
        policy: with the limits.
        fallback_k: .npy with a K to use if the images give none.
        registry: folder of a fleet registry, address of a published one, or several in order of precedence.
        lock: file that pins registry entries; no others are used then.
        recursive: whether to read sub-folders.
        workers: processes; 0 for automatic.
        strict: whether to stop at the first violation of the policy.
        verify: whether to check K against the pixels of a dozen images per camera.
        partials: folder for the results of each shard; shards with a result there are not read again.
        scheduler: address of a Dask scheduler; its workers read the images.
        cluster: "local:N" to start a Dask cluster with N workers on this machine.
        list_images: whether to list every image; otherwise, from more than 10 000 images, only a few per state.
        days: whether to read the dates of the images; with a registry they are always read.
        progress: called with (images read, total, "images"); during the check against pixels also with
            "features", "pairs" and "placed".
    """

    images: tuple[Path | str, ...]
    sensor_mm: tuple[float | None, float | None] = (None, None)
    policy: Policy = FLEET
    fallback_k: Path | None = None
    registry: Place | Sequence[Place] | None = None
    lock: Path | None = None
    recursive: bool = False
    workers: int = 0
    strict: bool = False
    verify: bool = False
    list_images: bool = False
    days: bool = False
    partials: Path | None = None
    lines: Iterable[str] | None = None
    scheduler: str | None = None
    cluster: str | None = None
    progress: Progress | None = None


def run(request: Request) -> Extraction:
    """Extract one K per camera.

    Raises:
        InputError: a folder, the fallback K or the lock cannot be read, or there is no image.
        RegistryError: the registry cannot be read, or differs from the lock.
        ValidationError: ``strict`` is set and the policy is violated.
        MissingExtraError: pixels are to be looked at, and pycolmap is not installed.
    """
    if request.verify:
        require(SFM, "comparing K with the pixels")
    knowledge = Knowledge.load(request.registry, request.lock)
    matrix = read_matrix(request.fallback_k) if request.fallback_k is not None else None
    listing = Listing(
        request.images,
        recursive=request.recursive,
        lines=request.lines,
        keep=may_be_calibration,
        versions=request.partials is not None,
    )
    if listing.known == 0:
        # All of a bucket's prefix and of an archive is gone through in any case.
        missed = not request.recursive and any(Path(one).is_dir() for one in request.images)
        hint = "; if they are in sub-folders, add --recursive" if missed else ""
        source = ", ".join(shown(one) if isinstance(one, str) else str(one) for one in request.images)
        raise InputError(
            f"contains no images (JPEG, TIFF, DNG, HEIF, PNG){hint}", source=source or "the list"
        )
    reading = _read(listing, request, days=request.days or knowledge.has_registry)
    with stage("derived and judged K"):
        return judge_images(reading, listing, request, knowledge=knowledge, matrix=matrix)


def _read(listing: Listing, request: Request, *, days: bool) -> Reading:
    many = f"more than {LISTED}" if listing.known is None else str(listing.known)
    with stage(f"read the heads of {many} images"):
        question = Question(days=days, list_all=request.list_images or listing.known is not None)
        with _engine(listing, request) as (engine, shard):
            return read_images(
                listing,
                question,
                engine=engine,
                shard=shard,
                partials=request.partials,
                progress=counted(request.progress, listing.known or 0, "images"),
                stop_at_first=request.strict,
            )


@contextmanager
def _engine(listing: Listing, request: Request) -> Iterator[tuple[Engine, int | None]]:
    """The engine that reads the images, and the number of images in a shard."""
    if request.scheduler is None and request.cluster is None:
        yield here(request.workers, known=listing.known), None
        return
    merged = MERGED if request.partials is None else 1
    with connected(request.scheduler, request.cluster, merged=merged) as engine:
        yield engine, PIECE


def judge_images(
    reading: Reading,
    listing: Listing,
    request: Request,
    *,
    knowledge: Knowledge,
    matrix: tuple[str, Callable[[ImageSize], Intrinsics]] | None = None,
) -> Extraction:
    """Determine one validated K per camera from the metadata of all images, independent of the reading order.

    Raises:
        RegistryError: two entries fit a camera equally well, or one that may fit cannot be read.
        ValidationError: ``strict`` is set and the policy is violated.
    """
    images = sort_images(reading.images.settled())
    rejected = sorted((*images.unread.listed, *listing.unreadable), key=lambda one: path_order(one.name))
    for skipped in (*rejected, *images.pictures.listed):
        log.info("skipped %s: %s", skipped.name, skipped.reason)
    if request.strict and rejected:
        raise _breach(request.policy, "image", f"{rejected[0].name}: {rejected[0].reason}")
    states = group_cameras(images.states, knowledge)
    sensor, warnings = _sensor(request, states)
    cameras = [one for key, group in states.items() for one in _judged(key, group, request, sensor)]
    beside, unreadable = find_candidates(listing.beside, listing.root, cameras)
    sources = Sources(
        matrix=matrix,
        files=tuple((one.label, K) for one in beside if one.states_size for K in one.calibrations),
        unreadable=tuple(unreadable),
        knowledge=knowledge,
        rivals=_rivals(cameras),
    )
    reports = tuple(
        _report(slug, camera, request, sources, listing)
        for slug, camera in zip(slugs_of(cameras), cameras, strict=True)
    )
    contradicting = contradictions(beside, reports, request.policy)
    return Extraction(
        policy=request.policy,
        cameras=reports,
        rejected=tuple(rejected),
        skipped=images.pictures.listed,
        more_rejected=images.unread.count - len(images.unread.listed),
        more_skipped=images.pictures.count - len(images.pictures.listed),
        lost=reading.lost,
        warnings=(
            *knowledge.warnings,
            *_of_layers(knowledge, states),
            *_unread(images.states),
            *warnings,
            *contradicting,
        ),
        beside=tuple(beside),
        beside_unread=tuple(unreadable),
        root=listing.root,
        sources=tuple(shown(one) if isinstance(one, str) else one.resolve().name for one in request.images),
        days=_days(images.states),
    )


def _days(states: Mapping[ImageMetadata, ByDay]) -> tuple[date, date] | None:
    days = [day for by_day in states.values() for day in by_day if day is not None]
    return (min(days), max(days)) if days else None


def _of_layers(knowledge: Knowledge, states: Mapping[CameraKey, tuple[State, ...]]) -> Iterator[str]:
    """Warnings on contradictions between registries, and on the registries themselves."""
    yield from knowledge.warnings_of_layers
    found = (state.known.resolution for group in states.values() for state in group)
    yield from dict.fromkeys(text for one in found if one is not None for text in one.disagreements)


def _unread(states: Mapping[ImageMetadata, ByDay]) -> Iterator[str]:
    """Warnings on metadata packets that could not be read, because they may contain a calibration."""
    found: dict[TagFault, list[Names]] = {}
    for metadata, days in states.items():
        for fault in metadata.faults:
            if fault.tag.startswith(PACKETS):
                found.setdefault(fault, []).extend(days.values())
    for fault, parts in found.items():
        names = Names.joined(parts)
        first, more = names.listed[0], names.count - 1
        named = f"{first} and {more} more images" if more else first
        yield f"{named}: {fault.tag} is not read: {fault.found}; expected {fault.expected}"


def _sensor(
    request: Request, states: Mapping[CameraKey, tuple[State, ...]]
) -> tuple[Sensor, tuple[str, ...]]:
    """The sensor size for this run; a stated size is used only if there is a single camera."""
    default = Sensor(size_mm=DEFAULT_SENSOR_MM, given=False)
    if request.sensor_mm == (None, None):
        return default, ()
    # A file without metadata has no focal length, so it does not count as a second camera here.
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


def _report(slug: str, camera: Camera, request: Request, sources: Sources, listing: Listing) -> CameraReport:
    """Report a camera with its fallback, checked against the pixels if requested."""

    def fall_back(one: Camera) -> Fallback | None:
        return _fallback(one, request.policy, sources)

    if not request.verify:
        return CameraReport(slug=slug, camera=camera, fallback=fall_back(camera))
    from calibrary.jobs.extract.pixels import verified  # noqa: PLC0415  loads the solver

    camera, fallback, check, found = verified(
        camera, fall_back, listing=listing, policy=request.policy, progress=request.progress
    )
    return CameraReport(slug=slug, camera=camera, fallback=fallback, pixels=check, look=found)


def _rivals(cameras: list[Camera]) -> dict[ImageSize, int]:
    counts: dict[ImageSize, int] = {}
    for camera in cameras:
        size = camera.key.image_size
        if size is not None and camera.verdict is not Verdict.VALID:
            counts[size] = counts.get(size, 0) + 1
    return counts


def _fallback(camera: Camera, policy: Policy, sources: Sources) -> Fallback | None:
    """Run the fallback steps unless the camera's own K is valid; an unproven K is replaced only by a valid one.

    A valid but derived K is replaced by a measured registry entry that agrees with it.
    """
    if camera.verdict is Verdict.VALID:
        return outranking(camera, policy, sources)
    fallback = fall_back(camera, policy, sources)
    if camera.verdict is Verdict.REJECTED:
        return fallback
    better = fallback.report is not None and fallback.report.verdict is Verdict.VALID
    return fallback if better else Fallback(steps=fallback.steps)
