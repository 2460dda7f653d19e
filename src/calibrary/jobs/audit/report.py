"""What an audit reports, as one JSON document (schemas/registry-audit-1.schema.json)."""

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
    """How many findings there are.

    Attributes:
        error, warning, note: of this severity.
    """

    error: Count
    warning: Count
    note: Count


class FlownSource(Record):
    """What one source in the images says, against the entry.

    Attributes:
        tag: where it is from.
        grade: what such a K is good for.
        fx: px.
        difference: as a share of fx, or of the width for cx and cy.
        of: the number that differs most: fx, fy, cx or cy.
        limit: what the difference may be.
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
        camera: which; the serial number is a hash.
        images: how many it took.
        first, last: the days of its images; None where none of them states one.
        use: whether there is an entry to use.
        entry: its id; None where there is none.
        why: this entry.
        fx: of the entry, at the images' size, px.
        sources: what the images say, against the entry.
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
    """What one unit took on one flight.

    Attributes:
        flight: name of the folder.
        images: how many.
        first, last: the days of its images; None where none of them states one.
    """

    flight: str
    images: Annotated[int, Meta(ge=1)]
    first: date | None
    last: date | None


class UnitSummary(Record):
    """One unit and all that was found of it.

    Attributes:
        name: its label, camera and the beginning of its serial number's hash.
        label: what its keeper calls it.
        serial: hash of its serial number.
        level: of its most severe finding; None where nothing was found.
        next: what to do first; None where nothing needs attention.
        entries: ids of the entries that answer for it.
        images: how many it took.
        flights: where it flew.
        findings: of this unit, the most severe first.
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
    """One flight: a folder of images, without those that cameras make by themselves.

    Attributes:
        name: of the folder.
        first, last: the days of its images; None where none of them states one.
        images: how many.
        units: names of those that took them.
        without: of these, the units that no entry can be used for.
        level: of the most severe finding of what flew; None where nothing was found.
    """

    name: str
    first: date | None
    last: date | None
    images: Count
    units: tuple[str, ...]
    without: tuple[str, ...]
    level: Severity | None


class AuditReport(Record, tag_field="schema", tag="calibrary/registry-audit-1"):
    """What ``calibrary registry audit --json`` prints: no position, no serial number, but hashes of them.

    Attributes:
        verdict: clean where there are notes at most.
        registry: its folder.
        commit: of the registry; None for a plain folder.
        policy: of the registry, by its name.
        on: what counted as today.
        since: images of earlier days were not counted.
        stale_after_months: from this age on a calibration is stale.
        folders: of the images.
        images: how many were looked at.
        images_before: how many were not counted, being older than asked for.
        images_undated: how many state no day; they count.
        entries: how many the registry has.
        counts: of the findings.
        cameras: each unit with each firmware that flew.
        findings: the most severe first.
        units: what flew and what was found by unit, the most urgent first.
        flights: what flew by flight, those with the most severe findings first.
        unreadable: images that no camera can be identified from.
        verification: K over time by the pixels of one flight of each unit and date; None where they were not asked.
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
    """The whole audit."""
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
