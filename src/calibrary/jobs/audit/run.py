"""An audit from end to end: flights in, findings out. It reads, and writes nothing."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Final

from calibrary.errors import InputError
from calibrary.jobs.audit.age import age_finding
from calibrary.jobs.audit.agreement import disagreements, unit_findings
from calibrary.jobs.audit.answers import Answer, answer_to
from calibrary.jobs.audit.flights import Flights, Progress, flights
from calibrary.jobs.audit.rules import Rule
from calibrary.policy import Policy
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.paths import id_of
from calibrary.registry.snapshot import Snapshot
from calibrary.validation import Finding, Severity

__all__ = ["LEVELS", "STALE_MONTHS", "Audit", "Request", "audit"]

STALE_MONTHS: Final = 24
LEVELS: Final = (Severity.ERROR, Severity.WARNING, Severity.NOTE)
"""What an audit's findings can be, the gravest first."""
RULES: Final = tuple(rule.value for rule in Rule)


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What to look at.

    Attributes:
        folders: of images, each with those within it.
        snapshot: of the registry.
        today: what counts as that.
        since: leave out images of earlier days.
        stale_months: a calibration older than this is told of.
        workers: processes that read images; 0 decides by itself.
    """

    folders: tuple[Path, ...]
    snapshot: Snapshot
    today: date
    since: date | None = None
    stale_months: int = STALE_MONTHS
    workers: int = 0
    progress: Progress | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Audit:
    """What was found.

    Attributes:
        request: what was asked.
        policy: of the registry.
        flights: what flew.
        answers: every camera that flew and the entry for it.
        entries: how many the registry has.
        findings: the gravest first.
    """

    request: Request
    policy: Policy
    flights: Flights
    answers: tuple[Answer, ...]
    entries: int
    findings: tuple[Finding, ...]

    @property
    def is_clean(self) -> bool:
        """Whether no finding needs attention; there may be notes."""
        return all(finding.severity is Severity.NOTE for finding in self.findings)

    def of(self, level: Severity) -> int:
        """How many findings there are of a level."""
        return sum(finding.severity is level for finding in self.findings)


def audit(request: Request) -> Audit:
    """Hold the registry against what flew.

    Raises:
        InputError: a folder cannot be read or there is no image.
        RegistryError: the registry cannot be listed.
    """
    policy = request.snapshot.configuration.policy
    index, files = request.snapshot.index(), dict(request.snapshot.files())
    seen = flights(
        request.folders, policy, since=request.since, workers=request.workers, progress=request.progress
    )
    answers = tuple(answer_to(flown, index, request.today) for flown in seen.flown)
    findings = [answer.finding for answer in answers if answer.finding is not None]
    for answer in answers:
        findings += disagreements(answer, policy)
    findings += unit_findings(answers, policy)
    flew = {answer.resolution.path for answer in answers if answer.resolution is not None}
    findings += _of_entries(files, flew, request)
    return Audit(
        request=request,
        policy=policy,
        flights=seen,
        answers=answers,
        entries=len(files),
        findings=tuple(sorted(findings, key=_gravest_first)),
    )


def _of_entries(files: Mapping[str, bytes], flew: Collection[str], request: Request) -> Iterator[Finding]:
    """What the entries say of their own age."""
    for path, data in sorted(files.items()):
        try:
            entry = parse_entry(data, path)
        except InputError as error:
            yield Finding(
                rule=Rule.BROKEN,
                severity=Severity.ERROR,
                place=id_of(path),
                message=str(error),
                remedy="calibrary registry check",
            )
            continue
        if entry.is_usable:
            yield from _stale(id_of(path), entry, request, has_flown=path in flew)


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
