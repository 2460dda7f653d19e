"""JSON document of an audit (schemas/registry-audit-1.schema.json)."""

from __future__ import annotations

from datetime import date
from typing import Annotated, Literal, TypeAlias

from calibrary.calibration import CameraKey, Grade
from calibrary.jobs.audit.agreement import gaps
from calibrary.jobs.audit.answers import Answer, Use
from calibrary.jobs.audit.from_pixels import Verification
from calibrary.jobs.audit.groups import AuditedUnit
from calibrary.jobs.audit.run import LEVELS, Audit
from calibrary.jobs.images.folders import SkippedFile
from calibrary.policy import Policy
from calibrary.records import Meta, Record
from calibrary.registry.git.objects import ObjectId
from calibrary.validation import Finding, Severity

__all__ = ["AuditReport", "report_of"]

Count: TypeAlias = Annotated[int, Meta(ge=0)]


class FindingCounts(Record):
    """Numbers of findings.

    Attributes:
        error, warning, note: number of findings of this severity.
    """

    error: Count
    warning: Count
    note: Count


class FlownSource(Record):
    """Estimate of one source in the images, compared with the entry.

    Attributes:
        tag: of the source.
        grade: origin of its intrinsics.
        fx: px.
        difference: as a fraction of fx, or of the width for cx and cy.
        of: the parameter that differs most: fx, fy, cx or cy.
        limit: largest allowed difference.
        chosen: whether it is the best of the images' sources.
    """

    tag: str
    grade: Grade
    fx: float
    difference: float
    of: str
    limit: float
    chosen: bool


class FlownCamera(Record):
    """One unit with one firmware that flew.

    Attributes:
        camera: camera key; the serial number is a hash.
        images: number of images it took.
        first, last: first and last date of its images; None if none states a date.
        use: whether there is an entry to use.
        entry: id of the entry; None if there is none.
        why: reason for this entry.
        fx: of the entry at the images' size, px.
        sources: estimates of the images' sources, compared with the entry.
    """

    camera: CameraKey
    images: Annotated[int, Meta(ge=1)]
    first: date | None
    last: date | None
    use: Use
    entry: str | None
    why: str | None
    fx: float | None
    sources: tuple[FlownSource, ...]


class FlightLeg(Record):
    """Images of one unit on one flight.

    Attributes:
        flight: name of the folder.
        images: number of images.
        first, last: first and last date of the images; None if none states a date.
    """

    flight: str
    images: Annotated[int, Meta(ge=1)]
    first: date | None
    last: date | None


class UnitSummary(Record):
    """One unit and its findings.

    Attributes:
        name: label, camera and first digits of the hash of its serial number.
        label: label of the unit in the registry.
        serial: hash of its serial number.
        level: severity of its most severe finding; None without findings.
        next: what to do first; None if nothing needs attention.
        entries: ids of the entries that apply to it.
        images: number of images it took.
        flights: its images by flight.
        findings: of this unit, most severe first.
    """

    name: str
    label: str | None
    serial: str | None
    level: Severity | None
    next: str | None
    entries: tuple[str, ...]
    images: Count
    flights: tuple[FlightLeg, ...]
    findings: tuple[Finding, ...]


class FlightSummary(Record):
    """One flight: a folder of images, without the folders that cameras create.

    Attributes:
        name: of the folder.
        first, last: first and last date of its images; None if none states a date.
        images: number of images.
        units: names of the units that took them.
        without: names of those units without a usable entry.
        level: severity of the most severe finding on its units; None without findings.
    """

    name: str
    first: date | None
    last: date | None
    images: Count
    units: tuple[str, ...]
    without: tuple[str, ...]
    level: Severity | None


class AuditReport(Record, tag_field="schema", tag="calibrary/registry-audit-1"):
    """Output of ``calibrary registry audit --json``. It contains no positions, and serial numbers only as hashes.

    Attributes:
        verdict: clean if there are no findings other than notes.
        registry: folder of the registry.
        commit: of the registry; None for a plain folder.
        policy: name of the registry's policy.
        on: the date that counted as today.
        since: images of earlier days were skipped.
        stale_after_months: age in months from which a calibration is stale.
        folders: of the images.
        images: number of images that were read.
        images_before: number of images skipped because they are older than requested.
        images_undated: number of images without a date; they are included.
        entries: number of entries in the registry.
        counts: numbers of findings.
        cameras: each unit and firmware that flew.
        findings: most severe first.
        units: cameras and findings by unit, most urgent first.
        flights: cameras by flight, those with the most severe findings first.
        unreadable: images from which no camera can be identified.
        verification: K over time from the pixels of one flight per unit and date; None if not requested.
    """

    verdict: Literal["clean", "findings"]
    registry: str
    commit: ObjectId | None
    policy: str
    on: date
    since: date | None
    stale_after_months: Annotated[int, Meta(ge=1)]
    folders: tuple[str, ...]
    images: Count
    images_before: Count
    images_undated: Count
    entries: Count
    counts: FindingCounts
    cameras: tuple[FlownCamera, ...]
    findings: tuple[Finding, ...]
    units: tuple[UnitSummary, ...]
    flights: tuple[FlightSummary, ...]
    unreadable: tuple[SkippedFile, ...]
    verification: Verification | None = None


def report_of(done: Audit) -> AuditReport:
    """Make the report of an audit."""
    request, seen = done.request, done.flights
    return AuditReport(
        verdict="clean" if done.is_clean else "findings",
        registry=str(request.snapshot.place),
        commit=request.snapshot.commit,
        policy=done.policy.name,
        on=request.today,
        since=request.since,
        stale_after_months=request.stale_months,
        folders=tuple(map(str, request.folders)),
        images=seen.images,
        images_before=seen.before,
        images_undated=seen.undated,
        entries=done.entries,
        counts=FindingCounts(**{level.value: done.of(level) for level in LEVELS}),
        cameras=tuple(_camera(answer, done.policy) for answer in done.answers),
        findings=done.findings,
        units=tuple(map(_unit, done.units)),
        flights=tuple(
            FlightSummary(
                name=one.name,
                first=one.first,
                last=one.last,
                images=one.images,
                units=one.units,
                without=one.without,
                level=one.level,
            )
            for one in done.by_flight
        ),
        unreadable=tuple(seen.unreadable),
        verification=done.verification,
    )


def _unit(unit: AuditedUnit) -> UnitSummary:
    legs = (
        FlightLeg(flight=one.flight, images=one.images, first=one.first, last=one.last) for one in unit.legs
    )
    return UnitSummary(
        name=unit.name,
        label=unit.label,
        serial=unit.serial,
        level=unit.level,
        next=unit.next,
        entries=tuple(dict.fromkeys(one.entry_id for one in unit.answers if one.entry_id is not None)),
        images=unit.images,
        flights=tuple(legs),
        findings=unit.findings,
    )


def _camera(answer: Answer, policy: Policy) -> FlownCamera:
    flown, resolution = answer.flown, answer.resolution
    return FlownCamera(
        camera=flown.key,
        images=flown.images,
        first=flown.first,
        last=flown.last,
        use=answer.use,
        entry=answer.entry_id,
        why=resolution.why if resolution is not None else None,
        fx=resolution.calibration.intrinsics.fx if resolution is not None else None,
        sources=tuple(
            FlownSource(
                tag=gap.estimate.tag,
                grade=gap.estimate.grade,
                fx=gap.estimate.intrinsics.fx,
                difference=gap.share,
                of=gap.of,
                limit=gap.limit,
                chosen=gap.estimate is flown.camera.evidence.chosen,
            )
            for gap in gaps(answer, policy)
        ),
    )
