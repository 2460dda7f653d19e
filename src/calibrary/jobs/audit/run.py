"""The audit job: from flights to findings, by unit and by flight. It is read-only."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import date
from functools import partial
from pathlib import Path
from typing import Final

from calibrary.calibration import CameraKey
from calibrary.extras import SFM, require
from calibrary.jobs.audit.age import Rule
from calibrary.jobs.audit.findings import (
    Answer,
    answer_to,
    camera_words,
    compared,
    disagreements,
    entry_findings,
    tolerance_of,
    unit_findings,
    unit_name,
)
from calibrary.jobs.audit.flights import Flights, flights
from calibrary.jobs.audit.other_statements import file_statements, proposal_statements
from calibrary.jobs.audit.report import (
    LEVELS,
    AuditedCamera,
    AuditedFlight,
    AuditedUnit,
    AuditReport,
    FindingCounts,
    Leg,
    NotCompared,
    Use,
    Verification,
)
from calibrary.jobs.survey import Survey
from calibrary.jobs.survey.placing import Settled
from calibrary.known_camera import match_key
from calibrary.policy import Policy
from calibrary.progress import Progress, labelled
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.paths import ROOT, SUFFIX
from calibrary.registry.resolution import RegistryIndex
from calibrary.registry.snapshot import Snapshot
from calibrary.validation import Finding, Severity

RULES: Final = tuple(Rule)


def audit(
    snapshot: Snapshot,
    folders: Sequence[Path],
    *,
    since: date | None = None,
    stale_after_months: int,
    verify_minutes: float | None,
    workers: int = 0,
    progress: Progress | None = None,
) -> AuditReport:
    """Compare the registry with the cameras that flew; for arguments and errors see :meth:`calibrary.Fleet.audit`.

    ``verify_minutes`` is None if K is not to be checked against the pixels.
    """
    if verify_minutes is not None:
        require(SFM, "comparing K with the pixels")
    today, policy, index = date.today(), snapshot.policy, snapshot.index()
    seen = flights(folders, policy, since=since, workers=workers, progress=labelled(progress, "images"))
    parsed = dict(snapshot.parsed(sorted(snapshot.paths)))
    entries = {path: entry for path, entry in parsed.items() if isinstance(entry, Entry)}
    seen = _labelled(seen, entries.values())
    answers = tuple(answer_to(flown, index, today) for flown in seen.flown)
    cameras = []
    findings = [answer.finding for answer in answers if answer.finding is not None]
    for answer in answers:
        survey = answer.survey(policy)
        findings += disagreements(answer, survey)
        cameras.append(_camera(answer, survey, policy))
    units_apart = [*unit_findings(answers, policy)]
    # Where several units differ from one another, that says more than how each differs from their one entry.
    told = {one.place for one in units_apart}
    findings = [one for one in findings if one.rule != Rule.UNITS or one.place not in told] + units_apart
    flew = {answer.resolution.path for answer in answers if answer.resolution is not None}
    rules = partial(snapshot.configuration.repeat_of, months=stale_after_months)
    findings += entry_findings(parsed, flew, today, rules)
    statements = [
        *proposal_statements(snapshot, parsed, answers, policy),
        *file_statements(folders, snapshot.place, answers, policy),
    ]
    findings += [one for one in statements if isinstance(one, Finding)]
    not_compared = [*_silent(cameras), *(one for one in statements if isinstance(one, NotCompared))]
    verification = None
    if verify_minutes is not None:
        verification, by_pixels = _verified(seen, index, policy, today, verify_minutes, progress)
        findings += by_pixels
    findings.sort(key=_gravity)
    units = _units(answers, findings, entries)
    counts = {level.value: sum(one.severity is level for one in findings) for level in LEVELS}
    return AuditReport(
        verdict="findings"
        if any(one.severity is not Severity.NOTE for one in findings)
        else "incomplete"
        if not_compared or seen.unreadable
        else "clean",
        registry=str(snapshot.place),
        commit=snapshot.commit,
        policy=policy.name,
        on=today,
        since=since,
        stale_after_months=stale_after_months,
        folders=tuple(map(str, folders)),
        images=seen.images,
        images_before=seen.before,
        images_undated=seen.undated,
        entries=len(parsed),
        counts=FindingCounts(**counts),
        cameras=tuple(cameras),
        findings=tuple(findings),
        units=units,
        flights=_flights(answers, findings, units),
        unreadable=seen.unreadable,
        not_compared=tuple(not_compared),
        verification=verification,
    )


def _verified(
    seen: Flights,
    index: RegistryIndex,
    policy: Policy,
    today: date,
    minutes: float,
    progress: Progress | None,
) -> tuple[Verification, Iterator[Finding]]:
    # It loads what reconstructs flights, which an audit without --verify does not need.
    from calibrary.jobs.audit.over_time import pixel_findings, verify_flights  # noqa: PLC0415  the reason above

    done = verify_flights(seen.flown, index, policy, today, minutes=minutes, progress=progress)
    return done, pixel_findings(done, seen.flown)


def _silent(cameras: Sequence[AuditedCamera]) -> Iterator[NotCompared]:
    """The cameras whose images state nothing that their entry can be compared with."""
    for one in cameras:
        if one.use is Use.USED and one.fx is not None and not one.sources:
            yield NotCompared(
                what=one.name,
                reason=f"nothing in its images states a K to compare {one.entry} with; --verify asks the pixels",
            )


def _labelled(seen: Flights, entries: Iterable[Entry]) -> Flights:
    """The cameras that flew, with the registry's labels of their units."""
    labels = {unit: one.label for one in entries if one.label and (unit := _unit(one.calibration.camera))}
    flown = (replace(one, label=labels.get(_unit(one.key) or ())) for one in seen.flown)
    return replace(seen, flown=tuple(flown))


def _unit(camera: CameraKey) -> tuple[str, ...] | None:
    if camera.serial is None:
        return None
    return tuple(match_key(text or "") for text in (camera.make, camera.model, camera.serial))


def _camera(answer: Answer, survey: Survey | None, policy: Policy) -> AuditedCamera:
    flown, found, chosen = answer.flown, answer.resolution, answer.flown.camera.evidence.chosen
    weighed = survey.weigh(survey.claims[0]) if survey is not None else None
    is_placed = weighed is not None and weighed.settled is not Settled.AMBIGUOUS
    return AuditedCamera(
        name=camera_words(flown),
        unit=unit_name(flown.key, flown.label),
        camera=flown.key,
        images=flown.images,
        first=flown.first,
        last=flown.last,
        use=answer.use,
        entry=answer.entry_id,
        why=found.why if found is not None else None,
        fx=weighed.ways[0].fx if weighed is not None and is_placed else None,
        tolerance=tolerance_of(found.entry, policy) if found is not None else None,
        sources=compared(survey, chosen.tag if chosen is not None else None),
    )


def _units(
    answers: Sequence[Answer], findings: Sequence[Finding], entries: Mapping[str, Entry]
) -> tuple[AuditedUnit, ...]:
    """The units that flew or have findings, most urgent first.

    Args:
        answers: for all cameras that flew.
        findings: all findings, most severe first.
        entries: entries by path.
    """
    names = {
        camera_words(answer.flown): unit_name(answer.flown.key, answer.flown.label) for answer in answers
    }
    flew: dict[str, list[Answer]] = {}
    for answer in answers:
        flew.setdefault(unit_name(answer.flown.key, answer.flown.label), []).append(answer)
    found: dict[str, list[Finding]] = {name: [] for name in flew}
    said = {name: (own[0].flown.label, own[0].flown.key.serial) for name, own in flew.items()}
    for finding in findings:
        name = names.get(finding.camera or "") or finding.camera
        # What is said of an entry alone is said of its unit, which may have flown.
        entry = entries.get(f"{ROOT}{finding.place}{SUFFIX}") if name is None else None
        if entry is not None:
            camera = entry.calibration.camera
            name = unit_name(camera, entry.label)
            said.setdefault(name, (entry.label, camera.serial))
        found.setdefault(name or finding.place or "", []).append(finding)
    units = (
        _audited(name, *said.get(name, (None, None)), flew.get(name, ()), own) for name, own in found.items()
    )
    return tuple(sorted(units, key=_urgency))


def _audited(
    name: str, label: str | None, serial: str | None, answers: Sequence[Answer], findings: Sequence[Finding]
) -> AuditedUnit:
    due = [one for one in findings if one.severity is not Severity.NOTE]
    return AuditedUnit(
        name=name,
        label=label,
        serial=serial,
        level=findings[0].severity if findings else None,
        next=next((one.remedy for one in due if one.remedy is not None), None),
        entries=tuple(dict.fromkeys(one.entry_id for one in answers if one.entry_id is not None)),
        images=sum(one.flown.images for one in answers),
        flights=tuple(leg for one in answers for leg in one.flown.legs),
        findings=tuple(findings),
    )


def _flights(
    answers: Sequence[Answer], findings: Sequence[Finding], units: Sequence[AuditedUnit]
) -> tuple[AuditedFlight, ...]:
    """The flights, sorted by the severity of findings, then newest first; their units as in ``units``."""
    place = {unit.name: n for n, unit in enumerate(units)}
    flew = [(place[unit_name(one.flown.key, one.flown.label)], one) for one in answers]
    legs: dict[str, list[tuple[Leg, Answer, str]]] = {}
    for n, answer in sorted(flew, key=lambda one: one[0]):
        for leg in answer.flown.legs:
            legs.setdefault(leg.flight, []).append((leg, answer, units[n].name))
    done = []
    for name, own in legs.items():
        days = [day for leg, _, _ in own for day in (leg.first, leg.last) if day is not None]
        cameras = {camera_words(answer.flown) for _, answer, _ in own}
        done.append(
            AuditedFlight(
                name=name,
                first=min(days, default=None),
                last=max(days, default=None),
                images=sum(leg.images for leg, _, _ in own),
                units=tuple(dict.fromkeys(unit for _, _, unit in own)),
                without=tuple(dict.fromkeys(unit for _, one, unit in own if one.use is not Use.USED)),
                # Findings are sorted: the first one is the most severe.
                level=next((one.severity for one in findings if one.camera in cameras), None),
            )
        )
    return tuple(
        sorted(done, key=lambda one: (_rank(one.level), -(one.last or date.min).toordinal(), one.name))
    )


def _rank(level: Severity | None) -> int:
    return LEVELS.index(level) if level is not None else len(LEVELS)


def _gravity(finding: Finding) -> tuple[int, int, str, str]:
    return _rank(finding.severity), RULES.index(Rule(finding.rule)), finding.place or "", finding.camera or ""


def _urgency(unit: AuditedUnit) -> tuple[int, int, int, str]:
    """Sort key: most severe finding first, then most images."""
    first = RULES.index(Rule(unit.findings[0].rule)) if unit.findings else len(RULES)
    return _rank(unit.level), first, -unit.images, match_key(unit.name)
