"""The extract job: from a directory of images to one validated K per camera."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import date
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from msgspec import Struct

from calibrary.arguments import Place, PolicyLike
from calibrary.calibration import Calibration, CameraKey, ImageSize
from calibrary.errors import InputError, RegistryError, UsageError, ValidationError
from calibrary.evidence.metadata import ImageMetadata, TagFault, as_float
from calibrary.evidence.originality import Pixels
from calibrary.extras import SFM, require
from calibrary.jobs.extract.calibration_files import (
    may_be_calibration,
    read_calibration_files,
    read_given,
    unused,
)
from calibrary.jobs.extract.cameras import (
    ASSUMED,
    Camera,
    Sensor,
    State,
    group_cameras,
    sort_images,
    without_refused,
)
from calibrary.jobs.extract.extraction import JudgedCamera, slugs_of
from calibrary.jobs.extract.fallback import (
    Fallback,
    Sources,
    fall_back,
    outranking,
    proposed_against,
)
from calibrary.jobs.extract.judging import NO_K, judge
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.extract.report import ExtractReport, camera_document
from calibrary.jobs.extract.stated import Stated
from calibrary.jobs.images.accumulator import ByDay, Names
from calibrary.jobs.images.listing import LISTED, Listing
from calibrary.jobs.images.observation import path_order
from calibrary.jobs.images.places import shown
from calibrary.jobs.images.reading import (
    BATCH,
    PIECE,
    Engine,
    Question,
    Reading,
    connected,
    here,
    read_images,
)
from calibrary.jobs.use import Allowed, allowed
from calibrary.policy import FLEET, Policy
from calibrary.policy_file import policy_of
from calibrary.progress import Progress, counted, log, stage
from calibrary.records import replace
from calibrary.validation import EDITED, Finding, Report, Severity, Verdict

PACKETS = ("XMP", "GDAL_METADATA")
"""Tags that can contain a calibration."""


class Judging(Struct, frozen=True, kw_only=True):
    """By what the cameras of a run are judged.

    Attributes:
        policy: with the limits.
        sensors: sensor sizes by camera.
        sensor_mm: sensor (width, height) stated by the user; a side that was not stated is None.
        stated: what the user states of images that do not state it.
        strict: whether to stop at the first violation of the policy.
        verify: whether to check K against the pixels of a dozen images per camera, or per camera without a valid K.
        knowledge: the catalogue and the registries.
        matrix: name of a file with a K stated by the user, and its cameras by image size, if the images give none.
        progress: of the check against pixels, called with "features", "pairs" and "placed".
    """

    policy: Policy = FLEET
    sensor_mm: tuple[float | None, float | None] = (None, None)
    sensors: Mapping[str, Sensor] = MappingProxyType({})
    stated: Stated = Stated()
    strict: bool = False
    verify: bool | Literal["unproven"] = False
    knowledge: Knowledge
    matrix: tuple[str, Callable[[ImageSize], Sequence[Calibration]]] | None = None
    progress: Progress | None = None


def limits(
    policy: PolicyLike, max_focal_deviation_pct: float | None, principal_point_tolerance: float | None
) -> Policy:
    """Return the policy that an argument names, with the limits that were stated in place of its own."""
    found = policy_of(policy)
    if max_focal_deviation_pct is not None:
        found = replace(found, focal_symmetry_max=max_focal_deviation_pct / 100.0)
    if principal_point_tolerance is not None:
        found = replace(found, principal_point_drift_max=principal_point_tolerance)
    return found


def run(  # noqa: PLR0913, D417  as many and the same as the job has
    *images: Path | str,
    lines: Iterable[str] | None = None,
    recursive: bool = False,
    workers: int = 0,
    cluster: str | None = None,
    policy: Policy = FLEET,
    sensor_mm: tuple[float | None, float | None] = (None, None),
    sensors: Mapping[str, str] = MappingProxyType({}),
    camera: str | None = None,
    focal_mm: float | None = None,
    registry: Sequence[Place] | Place | None = None,
    lock: Path | None = None,
    fallback_k: Path | None = None,
    fallback_camera: str | None = None,
    strict: bool = False,
    verify: bool | Literal["unproven"] = False,
    list_images: bool = False,
    days: bool = False,
    progress: Progress | None = None,
) -> ExtractReport:
    """Read the images and judge their cameras; arguments and errors as of :func:`calibrary.jobs.extract.extract`.

    Args:
        images: a folder, an archive or a URL; or images and any number of these.
        lines: as of the job, like all that are not here.
        registry: the registries to use, and no other.
        days: whether to read the dates of the images; with a registry they are always read.
    """
    if verify:
        require(SFM, "comparing K with the pixels")
    knowledge = Knowledge.load(registry, lock)
    matrix = read_given(fallback_k, fallback_camera) if fallback_k is not None else None
    listing = Listing(images, recursive=recursive, lines=lines, keep=may_be_calibration)
    if listing.known == 0:
        # All of a bucket's prefix and of an archive is gone through in any case.
        missed = not recursive and any(Path(one).is_dir() for one in images)
        hint = "; if they are in sub-folders, add --recursive" if missed else ""
        source = ", ".join(shown(one) if isinstance(one, str) else str(one) for one in images)
        raise InputError(
            f"contains no images (JPEG, TIFF, DNG, HEIF, PNG){hint}", source=source or "the list"
        )
    question = Question(
        days=days or knowledge.has_registry, list_all=list_images or listing.known is not None
    )
    many = f"more than {LISTED}" if listing.known is None else str(listing.known)
    with (
        stage(f"read the heads of {many} images"),
        _engine(cluster, workers, listing.known) as (engine, batch),
    ):
        reading = read_images(
            listing,
            question,
            engine=engine,
            batch=batch,
            progress=counted(progress, listing.known or 0, "images"),
            stop_at_first=strict,
        )
    with stage("derived and judged K"):
        by = Judging(
            policy=policy,
            sensor_mm=sensor_mm,
            sensors={name: _sensor_stated(name, text) for name, text in sensors.items()},
            stated=Stated(camera=camera, focal_mm=focal_mm, sensor=sensor_mm != (None, None)),
            strict=strict,
            verify=verify,
            knowledge=knowledge,
            matrix=matrix,
            progress=progress,
        )
        outcome = judge_images(reading, listing, by)
    places = tuple(shown(one) if isinstance(one, str) else one.resolve().name for one in images)
    return replace(outcome, places=places)


@contextmanager
def _engine(cluster: str | None, workers: int, known: int | None) -> Iterator[tuple[Engine, int]]:
    """The engine that reads the images, and the number of images that it reads at a time."""
    if cluster is None:
        yield here(workers, known=known), BATCH
        return
    with connected(cluster) as engine:
        yield engine, PIECE


def judge_images(reading: Reading, listing: Listing, by: Judging) -> ExtractReport:
    """Determine one validated K per camera from the metadata of all images, independent of the reading order.

    Raises:
        RegistryError: of each camera, two entries fit equally well, or one that may fit cannot be read.
        ValidationError: ``strict`` is set and the policy is violated.
    """
    images, refused = sort_images(reading.images.settled()), dict[ImageMetadata, RegistryError]()
    images = replace(images, states=by.stated.added(images.states))
    states = group_cameras(images.states, by.knowledge, refused)
    if refused and not states:
        raise next(iter(refused.values()))
    images = without_refused(images, refused)
    rejected = sorted((*images.unread.listed, *listing.unreadable), key=lambda one: path_order(one.name))
    for skipped in (*rejected, *images.pictures.listed):
        log.info("skipped %s: %s", skipped.name, skipped.reason)
    if by.strict and rejected:
        raise _breach(by.policy, "image", f"{rejected[0].name}: {rejected[0].reason}")
    sensor = _sensor(by.sensor_mm, states)
    of_cameras = _sensors(by.sensors, [*states])
    cameras: list[Camera] = []
    for key, group in states.items():
        cameras += judge(key, group, policy=by.policy, sensor=of_cameras.get(key, sensor), root=listing.root)
        if by.strict:
            _require_valid(cameras, by.policy)
    by.stated.check(cameras)
    files, unreadable = read_calibration_files(listing.other_files, listing.root, cameras)
    sources = Sources(
        matrix=by.matrix,
        files=tuple((one.label, K) for one in files if one.states_size for K in one.calibrations),
        knowledge=by.knowledge,
        rivals=_rivals(cameras),
    )
    judged = (
        _report(slug, camera, by, sources, listing)
        for slug, camera in zip(slugs_of(cameras), cameras, strict=True)
    )
    reports = tuple(replace(one, use=_use(one, by.policy)) for one in judged)
    is_good = bool(reports) and not rejected and all(one.verdict is Verdict.VALID for one in reports)
    more_rejected = images.unread.count - len(images.unread.listed)
    return ExtractReport(
        policy=by.policy.name,
        uncalibrated=any(one.uncalibrated for one in reports),
        images=sum(one.camera.count for one in reports)
        + len(rejected)
        + more_rejected
        + images.pictures.count,
        cameras=tuple(camera_document(one) for one in reports),
        rejected=tuple(rejected),
        warnings=(
            *by.knowledge.warnings,
            *_of_layers(by.knowledge, states),
            *_unread(images.states),
            *unused(files, unreadable, reports, by.policy),
            *_proposed(reports, by.policy),
        ),
        exit_code=3 if reading.lost else 0 if is_good else 1,
        skipped=images.pictures.listed,
        more_rejected=more_rejected,
        more_skipped=images.pictures.count - len(images.pictures.listed),
        limits=by.policy,
        judged=reports,
        calibration_files=tuple(files),
        unreadable_files=tuple(unreadable),
        root=listing.root,
        days=_days(images.states),
    )


def _proposed(reports: Sequence[JudgedCamera], policy: Policy) -> Iterator[str]:
    """Warnings on what is proposed in the registry and contradicts a K that is used."""
    found = (proposed_against(one.camera, one.calibration, policy) for one in reports)
    yield from (text for text in found if text is not None)


def _days(states: Mapping[ImageMetadata, ByDay]) -> tuple[date, date] | None:
    days = [day for by_day in states.values() for day in by_day if day is not None]
    return (min(days), max(days)) if days else None


def _of_layers(knowledge: Knowledge, states: Mapping[CameraKey, tuple[State, ...]]) -> Iterator[str]:
    """Warnings on contradictions between registries, and on the registries themselves."""
    known = (state.known.resolution for group in states.values() for state in group)
    used = [one for one in known if one is not None]
    yield from knowledge.warnings_on(used)
    yield from dict.fromkeys(text for one in used for text in one.disagreements)


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
    sensor_mm: tuple[float | None, float | None], states: Mapping[CameraKey, tuple[State, ...]]
) -> Sensor:
    """The sensor size for this run.

    Raises:
        UsageError: a size is stated, and there are several cameras.
    """
    if sensor_mm == (None, None):
        return ASSUMED
    # A file without metadata has no focal length, so it does not count as a second camera here.
    cameras = [key for key, group in states.items() if any(state.metadata.focal_mm for state in group)]
    if len(cameras) <= 1:
        return Sensor(size_mm=sensor_mm, given=True)
    names = ", ".join(str(key) for key in cameras[:4]) + (", …" if len(cameras) > 4 else "")
    raise UsageError(
        f"one sensor size cannot apply to {len(cameras)} cameras ({names}); give each its own by --sensor CAMERA=WxH"
    )


def _sensor_stated(name: str, text: str) -> Sensor:
    """The sensor size in a text such as "13.2x8.8".

    Raises:
        UsageError: it is none.
    """
    sides = [as_float(side) for side in text.lower().replace("×", "x").split("x")]
    if len(sides) != 2 or not all(side is not None and 0.1 <= side <= 1000 for side in sides):
        raise UsageError(
            f"--sensor {name}={text}: expected CAMERA=WxH, the width and height in mm, such as {name}=13.2x8.8"
        )
    return Sensor(size_mm=(sides[0], sides[1]), given=True)


def _sensors(stated: Mapping[str, Sensor], keys: Sequence[CameraKey]) -> dict[CameraKey, Sensor]:
    """The sensor size stated for each camera: by the name with most words, all of which are words of the camera's.

    Raises:
        UsageError: a name is of no camera.
    """
    words = {name: frozenset(name.casefold().split()) for name in stated}
    found: dict[CameraKey, Sensor] = {}
    unused = dict.fromkeys(stated)
    for key in keys:
        own = frozenset(str(key).casefold().split())
        for name in sorted(stated, key=lambda one: len(words[one])):
            if words[name] <= own:
                found[key] = stated[name]
                unused.pop(name, None)
    if unused:
        names = ", ".join(str(key) for key in keys)
        raise UsageError(f"--sensor {next(iter(unused))}=…: no camera of these images; there are {names}")
    return found


def _require_valid(cameras: Sequence[Camera], policy: Policy) -> None:
    for camera in cameras:
        if camera.verdict is not Verdict.VALID:
            rule = camera.report.failures[0].rule if camera.report is not None else NO_K
            raise _breach(policy, rule, f"{camera.key}: {camera.reason}; {camera.remedy}")


def _breach(policy: Policy, rule: str, message: str) -> ValidationError:
    finding = Finding(rule=rule, severity=Severity.ERROR, message=message)
    return ValidationError(message, Report(policy=policy.name, findings=(finding,)))


def _report(slug: str, camera: Camera, by: Judging, sources: Sources, listing: Listing) -> JudgedCamera:
    """Report a camera with its fallback, checked against the pixels if requested."""

    def fall_back(one: Camera) -> Fallback | None:
        return _fallback(one, by.policy, sources)

    plain = JudgedCamera(slug=slug, camera=camera, fallback=fall_back(camera))
    if not by.verify or (by.verify == "unproven" and plain.verdict is Verdict.VALID):
        return plain
    from calibrary.jobs.extract.pixels import verified  # noqa: PLC0415  loads the solver

    camera, fallback, check, found = verified(
        camera, fall_back, listing=listing, policy=by.policy, progress=by.progress
    )
    return JudgedCamera(slug=slug, camera=camera, fallback=fallback, pixels=check, look=found)


def _use(one: JudgedCamera, policy: Policy) -> Allowed:
    """What a solver may do with the K that is used."""
    fallback = one.fallback.use if one.fallback is not None else None
    if fallback is not None and one.verdict is Verdict.VALID:
        return fallback
    return allowed(one.calibration, policy, is_valid=one.verdict is Verdict.VALID, resaved=_is_resaved(one))


def _is_resaved(one: JudgedCamera) -> bool:
    """Whether nothing speaks against a K but that a program saved the images again, which mostly changes no frame."""
    if one.report is None or any(finding.rule != EDITED for finding in one.report.failures):
        return False
    return all(state.original.pixels is not Pixels.ALTERED for state in one.camera.states)


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
    if not camera.has_k:
        return fallback
    better = fallback.report is not None and fallback.report.verdict is Verdict.VALID
    return fallback if better else Fallback(steps=fallback.steps)
