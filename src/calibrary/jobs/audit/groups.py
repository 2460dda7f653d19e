"""Results of an audit grouped by unit and by flight, in order of urgency."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import date
from typing import Final

from msgspec import Struct

from calibrary.jobs.audit.answers import Answer, Use, named, unit_name
from calibrary.jobs.audit.flights import Leg
from calibrary.jobs.audit.rules import Rule
from calibrary.registry.entry import Entry
from calibrary.registry.paths import ROOT, SUFFIX, match_key
from calibrary.validation import Finding, Severity

__all__ = ["AuditedFlight", "AuditedUnit", "flights_of", "units_of"]

LEVELS: Final = (Severity.ERROR, Severity.WARNING, Severity.NOTE)
RULES: Final = tuple(rule.value for rule in Rule)


class AuditedUnit(Struct, frozen=True, kw_only=True):
    """One unit (or a model without a known unit) and its findings.

    Attributes:
        name: label, camera and first digits of the hash of its serial number.
        label: label of the unit in the registry.
        serial: hash of its serial number.
        answers: the registry's answers, by firmware and image size.
        findings: most severe first.
    """

    name: str
    label: str | None
    serial: str | None
    answers: tuple[Answer, ...]
    findings: tuple[Finding, ...]

    @property
    def level(self) -> Severity | None:
        """Severity of its most severe finding; None without findings."""
        return self.findings[0].severity if self.findings else None

    @property
    def images(self) -> int:
        """Number of images it took."""
        return sum(answer.flown.images for answer in self.answers)

    @property
    def legs(self) -> tuple[Leg, ...]:
        """Its flights, newest last."""
        return tuple(leg for answer in self.answers for leg in answer.flown.legs)

    @property
    def next(self) -> str | None:
        """What to do first; None if nothing needs attention."""
        due = [one for one in self.findings if one.severity is not Severity.NOTE]
        return next((one.remedy for one in due if one.remedy is not None), None)


class AuditedFlight(Struct, frozen=True, kw_only=True):
    """One flight: a folder of images.

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
    images: int
    units: tuple[str, ...]
    without: tuple[str, ...]
    level: Severity | None


def units_of(
    answers: Sequence[Answer], findings: Iterable[Finding], entries: Mapping[str, Entry]
) -> tuple[AuditedUnit, ...]:
    """The units that flew or have findings, most urgent first.

    Args:
        answers: for all cameras that flew.
        findings: all findings.
        entries: entries by path.
    """
    names = {named(answer.flown): unit_name(answer.flown.key, answer.flown.label) for answer in answers}
    flew: dict[str, list[Answer]] = {}
    for answer in answers:
        flew.setdefault(unit_name(answer.flown.key, answer.flown.label), []).append(answer)
    found: dict[str, list[Finding]] = {name: [] for name in flew}
    said: dict[str, tuple[str | None, str | None]] = {}
    for finding in findings:
        name = names.get(finding.camera or "") or finding.camera
        entry = entries.get(f"{ROOT}{finding.place}{SUFFIX}") if name is None else None
        if entry is not None:
            camera = entry.calibration.camera
            name = unit_name(camera, entry.label)
            said[name] = entry.label, camera.serial
        found.setdefault(name or finding.place or "", []).append(finding)
    units = []
    for name, own in found.items():
        own_answers = tuple(flew.get(name, ()))
        label, serial = said.get(name, (None, None))
        if own_answers:
            label, serial = own_answers[0].flown.label, own_answers[0].flown.key.serial
        units.append(
            AuditedUnit(
                name=name,
                label=label,
                serial=serial,
                answers=own_answers,
                findings=tuple(sorted(own, key=_gravity)),
            )
        )
    return tuple(sorted(units, key=_urgency))


def flights_of(units: Sequence[AuditedUnit]) -> tuple[AuditedFlight, ...]:
    """The flights, sorted by the severity of findings, then newest first."""
    legs: dict[str, list[tuple[Leg, Answer, AuditedUnit]]] = {}
    for unit in units:
        for answer in unit.answers:
            for leg in answer.flown.legs:
                legs.setdefault(leg.flight, []).append((leg, answer, unit))
    flights = []
    for name, own in legs.items():
        days = [day for leg, _, _ in own for day in (leg.first, leg.last) if day is not None]
        cameras = {named(answer.flown) for _, answer, _ in own}
        levels = [
            finding.severity for _, _, unit in own for finding in unit.findings if finding.camera in cameras
        ]
        flights.append(
            AuditedFlight(
                name=name,
                first=min(days, default=None),
                last=max(days, default=None),
                images=sum(leg.images for leg, _, _ in own),
                units=tuple(dict.fromkeys(unit.name for _, _, unit in own)),
                without=tuple(dict.fromkeys(unit.name for _, one, unit in own if one.use is not Use.USED)),
                level=min(levels, key=LEVELS.index, default=None),
            )
        )
    return tuple(
        sorted(flights, key=lambda one: (_rank(one.level), -(one.last or date.min).toordinal(), one.name))
    )


def _rank(level: Severity | None) -> int:
    return LEVELS.index(level) if level is not None else len(LEVELS)


def _gravity(finding: Finding) -> tuple[int, int, str, str]:
    return _rank(finding.severity), RULES.index(finding.rule), finding.place or "", finding.camera or ""


def _urgency(unit: AuditedUnit) -> tuple[int, int, int, str]:
    """Sort key: most severe finding first, then most images."""
    first = RULES.index(unit.findings[0].rule) if unit.findings else len(RULES)
    return _rank(unit.level), first, -unit.images, match_key(unit.name)
