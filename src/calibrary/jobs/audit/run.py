"""The audit job: from flights to findings. It is read-only."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from datetime import date
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.calibration import CameraKey
from calibrary.errors import InputError
from calibrary.extras import SFM, require
from calibrary.jobs.audit.age import age_finding
from calibrary.jobs.audit.agreement import disagreements, unit_findings
from calibrary.jobs.audit.answers import Answer, answer_to
from calibrary.jobs.audit.flights import Flights, flights
from calibrary.jobs.audit.from_pixels import MINUTES, Verification, pixel_findings, verify_flights
from calibrary.jobs.audit.groups import AuditedFlight, AuditedUnit, flights_of, units_of
from calibrary.jobs.audit.rules import Rule
from calibrary.policy import Policy
from calibrary.progress import Progress, labelled
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.paths import id_of, match_key, proposal_path
from calibrary.registry.snapshot import Snapshot
from calibrary.validation import Finding, Severity

__all__ = ["LEVELS", "STALE_MONTHS", "Audit", "Request", "audit"]

STALE_MONTHS: Final = 24
LEVELS: Final = (Severity.ERROR, Severity.WARNING, Severity.NOTE)
"""Severities of an audit's findings, most severe first."""
RULES: Final = tuple(rule.value for rule in Rule)


class Request(Struct, frozen=True, kw_only=True):
    """Arguments of an audit.

    Attributes:
        folders: of images, with their sub-folders.
        snapshot: of the registry.
        today: the date that counts as today.
        since: skip images of earlier days.
        stale_months: calibrations of at least this age in months are reported.
        workers: processes that read images; 0 for automatic.
        verify: whether to check K against the pixels of one flight per unit and date.
        minutes: time after which no further flight is checked.
        progress: called with (done, total, what).
    """

    folders: tuple[Path, ...]
    snapshot: Snapshot
    today: date
    since: date | None = None
    stale_months: int = STALE_MONTHS
    workers: int = 0
    verify: bool = False
    minutes: float = MINUTES
    progress: Progress | None = None


class Audit(Struct, frozen=True, kw_only=True):
    """Result of an audit.

    Attributes:
        request: the arguments.
        policy: of the registry.
        flights: all cameras that flew.
        answers: all cameras that flew, each with its entry.
        entries: number of entries in the registry.
        findings: most severe first.
        units: cameras and findings by unit, most urgent first.
        by_flight: cameras by flight, those with the most severe findings first.
        verification: check against the pixels; None if not requested.
    """

    request: Request
    policy: Policy
    flights: Flights
    answers: tuple[Answer, ...]
    entries: int
    findings: tuple[Finding, ...]
    units: tuple[AuditedUnit, ...] = ()
    by_flight: tuple[AuditedFlight, ...] = ()
    verification: Verification | None = None

    @property
    def is_clean(self) -> bool:
        """Whether no finding needs attention; there may be notes."""
        return all(finding.severity is Severity.NOTE for finding in self.findings)

    def of(self, level: Severity) -> int:
        """Number of findings of a severity."""
        return sum(finding.severity is level for finding in self.findings)


def audit(request: Request) -> Audit:
    """Compare the registry with the cameras that flew.

    Raises:
        InputError: a folder cannot be read or there is no image.
        RegistryError: the registry cannot be listed.
        MissingExtraError: ``verify`` is set and pycolmap is not installed.
    """
    if request.verify:
        require(SFM, "comparing K with the pixels")
    policy = request.snapshot.configuration.policy
    index, files = request.snapshot.index(), dict(request.snapshot.files())
    seen = flights(
        request.folders,
        policy,
        since=request.since,
        workers=request.workers,
        progress=labelled(request.progress, "images"),
    )
    parsed = {path: _parsed(path, data) for path, data in sorted(files.items())}
    entries = {path: entry for path, entry in parsed.items() if isinstance(entry, Entry)}
    seen = _labelled(seen, entries.values())
    answers = tuple(answer_to(flown, index, request.today) for flown in seen.flown)
    findings = [answer.finding for answer in answers if answer.finding is not None]
    for answer in answers:
        findings += disagreements(answer, policy)
    findings += unit_findings(answers, policy)
    flew = {answer.resolution.path for answer in answers if answer.resolution is not None}
    findings += _of_entries(parsed, flew, request)
    verification = None
    if request.verify:
        verification = verify_flights(
            seen.flown, index, policy, request.today, minutes=request.minutes, progress=request.progress
        )
        findings += pixel_findings(verification, seen.flown)
    units = units_of(answers, findings, entries)
    return Audit(
        request=request,
        policy=policy,
        flights=seen,
        answers=answers,
        entries=len(files),
        findings=tuple(sorted(findings, key=_gravest_first)),
        units=units,
        by_flight=flights_of(units),
        verification=verification,
    )


def _parsed(path: str, data: bytes) -> Entry | InputError:
    """Parse an entry; returns the error if its file is broken."""
    try:
        return parse_entry(data, path)
    except InputError as error:
        return error


def _labelled(seen: Flights, entries: Iterable[Entry]) -> Flights:
    """The cameras that flew, with the registry's labels of their units."""
    labels = {unit: one.label for one in entries if one.label and (unit := _unit(one.calibration.camera))}
    flown = (replace(one, label=labels.get(_unit(one.key) or ())) for one in seen.flown)
    return replace(seen, flown=tuple(flown))


def _unit(camera: CameraKey) -> tuple[str, ...] | None:
    if camera.serial is None:
        return None
    return tuple(match_key(text or "") for text in (camera.make, camera.model, camera.serial))


def _of_entries(
    parsed: Mapping[str, Entry | InputError], flew: Collection[str], request: Request
) -> Iterator[Finding]:
    """Findings on the entries themselves: broken files, age, validity, and proposals waiting for approval."""
    for path, entry in parsed.items():
        if isinstance(entry, InputError):
            yield Finding(
                rule=Rule.BROKEN,
                severity=Severity.ERROR,
                place=id_of(path),
                message=str(entry),
                remedy="calibrary registry check",
            )
            continue
        if entry.is_usable:
            yield from _stale(id_of(path), entry, request, has_flown=path in flew)
            if proposal_path(path) in request.snapshot.proposed:
                yield _waiting(path)


def _waiting(path: str) -> Finding:
    id_ = id_of(path)
    return Finding(
        rule=Rule.WAITING,
        severity=Severity.NOTE,
        place=id_,
        message="another K is proposed to replace it, and is not used before it is approved",
        remedy=f"calibrary registry show proposals/{id_}, then calibrary registry approve {id_}",
    )


def _stale(id_: str, entry: Entry, request: Request, *, has_flown: bool) -> Iterator[Finding]:
    validity = entry.validity
    if validity is not None and validity.last is not None and validity.last < request.today and not has_flown:
        yield Finding(
            rule=Rule.OVER,
            severity=Severity.WARNING,
            place=id_,
            message=f"it is {entry.status.value} and valid {validity}, which is over",
            remedy=f"calibrary registry retire {id_} --reason 'validity over'",
        )
    age = age_finding(entry, request.today, request.stale_months, has_flown=has_flown)
    if age is not None:
        yield age
    elif not has_flown:
        yield Finding(
            rule=Rule.NOT_FLOWN,
            severity=Severity.NOTE,
            place=id_,
            message="no image of its camera is among these flights",
        )


def _gravest_first(finding: Finding) -> tuple[int, int, str, str]:
    return (
        LEVELS.index(finding.severity),
        RULES.index(finding.rule),
        finding.place or "",
        finding.camera or "",
    )
