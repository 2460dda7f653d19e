"""An audit as a page: what has to be done, every camera that flew, and how far its images lie from its entry."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from importlib.metadata import version
from typing import Final

from calibrary.jobs.audit.agreement import gaps, tolerance_of
from calibrary.jobs.audit.answers import Answer, Use, named
from calibrary.jobs.audit.groups import AuditedUnit
from calibrary.jobs.audit.rules import Rule
from calibrary.jobs.audit.run import LEVELS, Audit
from calibrary.pages import (
    Badge,
    Block,
    Bullets,
    Cell,
    Column,
    Details,
    Figure,
    Note,
    Page,
    Section,
    Table,
    Tone,
)
from calibrary.pages.plots import Axis, Band, Interval, Role, intervals
from calibrary.policy import Policy
from calibrary.validation import Finding, Severity

__all__ = ["audit_page"]

TONES: Final = {Severity.ERROR: Tone.BAD, Severity.WARNING: Tone.CAUTION, Severity.NOTE: Tone.NEUTRAL}
USES: Final = {
    Use.USED: Tone.GOOD,
    Use.EXPIRED: Tone.BAD,
    Use.DRAFT: Tone.BAD,
    Use.RETIRED: Tone.BAD,
    Use.NONE: Tone.BAD,
}
PX: Final = Axis("fx", "px")
MOST_ROWS: Final = 500
MOST_NAMED: Final = 6
MOST_DRAWN: Final = 24
DRAWN: Final = {Rule.DRIFT, Rule.TAGS, Rule.FIRMWARE}


def audit_page(done: Audit) -> Page:
    """The whole audit."""
    errors, warnings, notes = (done.of(level) for level in LEVELS)
    counted = f"{_count(errors, 'error')}, {_count(warnings, 'warning')}, {_count(notes, 'note')}"
    return Page(
        title="Audit of the registry",
        badge=Badge("nothing to do", Tone.GOOD) if done.is_clean else Badge("needs attention", Tone.BAD),
        lead=f"{_count(len(done.answers), 'camera')} in {_count(done.flights.images, 'image')} held against "
        f"{_count(done.entries, 'entry', 'entries')}: {counted}.",
        sections=tuple(_sections(done)),
        made_by=f"Made by calibrary {version('calibrary')} on {done.request.today} from "
        f"{', '.join(str(folder) for folder in done.request.folders)}, the registry at "
        f"{(done.request.snapshot.commit or 'a plain folder')[:12]}.",
    )


def _sections(done: Audit) -> Iterator[Section]:
    to_do = [one for unit in done.units for one in unit.findings if one.severity is not Severity.NOTE]
    if to_do:
        yield Section(title="What to do first", blocks=tuple(_first(done.units)))
        yield Section(title="Why", blocks=tuple(_to_do(to_do)))
    yield Section(title="What flew", blocks=tuple(_flown(done)))
    yield Section(title="By flight", blocks=tuple(_by_flight(done)))
    drawn = tuple(_charts(done))
    if drawn:
        yield Section(title="The images against their entries", blocks=drawn)
    notes = [finding for finding in done.findings if finding.severity is Severity.NOTE]
    if notes:
        yield Section(title="To know", blocks=(_notes(notes),))
    if done.flights.unreadable:
        yield Section(title="Images skipped", blocks=(_unreadable(done),))


def _first(units: tuple[AuditedUnit, ...]) -> Iterator[Block]:
    """A row a unit, the most urgent first."""
    due = [unit for unit in units if unit.level is not None and unit.level is not Severity.NOTE]
    yield Table(
        caption="Every unit that needs attention, the most urgent first",
        columns=(
            Column("unit"),
            Column("what"),
            Column("images", numeric=True),
            Column("flights"),
            Column("do this"),
        ),
        rows=tuple(
            (
                unit.name,
                Badge(unit.findings[0].rule, TONES[unit.findings[0].severity]),
                str(unit.images),
                _some(dict.fromkeys(leg.flight for leg in unit.legs)),
                unit.next or "–",
            )
            for unit in due[:MOST_ROWS]
        ),
    )
    if len(due) > MOST_ROWS:
        yield f"{len(due) - MOST_ROWS} more are in the JSON."


def _by_flight(done: Audit) -> Iterator[Block]:
    yield Table(
        caption="Every flight, those that need attention first; a flight is a folder of images",
        columns=(
            Column("flight"),
            Column("first day"),
            Column("last day"),
            Column("images", numeric=True),
            Column("units"),
            Column("without a usable entry"),
        ),
        rows=tuple(
            (
                one.name,
                one.first.isoformat() if one.first is not None else "–",
                one.last.isoformat() if one.last is not None else "–",
                str(one.images),
                _some(one.units),
                Badge(_some(one.without), Tone.BAD) if one.without else "–",
            )
            for one in done.by_flight[:MOST_ROWS]
        ),
    )
    if len(done.by_flight) > MOST_ROWS:
        yield f"{len(done.by_flight) - MOST_ROWS} more are in the JSON."


def _some(names: Iterable[str]) -> str:
    every = [*names]
    more = f" and {len(every) - MOST_NAMED} more" if len(every) > MOST_NAMED else ""
    return "; ".join(every[:MOST_NAMED]) + more or "–"


def _to_do(findings: list[Finding]) -> Iterator[Block]:
    for finding in findings[:MOST_ROWS]:
        rule = finding.rule
        yield Note(
            text=f"{rule[:1].upper()}{rule[1:]}. {finding.camera or finding.place}: {finding.message}.",
            action=finding.remedy,
            tone=TONES[finding.severity],
        )
    if len(findings) > MOST_ROWS:
        yield f"{len(findings) - MOST_ROWS} more are in the JSON."


def _flown(done: Audit) -> Iterator[Block]:
    answers = [answer for unit in done.units for answer in unit.answers]
    rows = tuple(_row(answer, done.policy) for answer in answers[:MOST_ROWS])
    yield Table(
        caption="Every unit of every camera with every firmware, and the entry that answers for it",
        columns=(
            Column("camera"),
            Column("entry"),
            Column("state"),
            Column("images", numeric=True),
            Column("last flown"),
            Column("images' fx against it", numeric=True),
        ),
        rows=rows,
    )
    if len(done.answers) > MOST_ROWS:
        yield f"{len(done.answers) - MOST_ROWS} more are in the JSON."
    if done.flights.undated:
        yield f"{_count(done.flights.undated, 'image')} say no day and count as recent."
    if done.flights.before:
        yield f"{_count(done.flights.before, 'image')} before {done.request.since} are left out."


def _row(answer: Answer, policy: Policy) -> tuple[Cell, ...]:
    flown = answer.flown
    chosen = flown.camera.evidence.chosen
    own = next((gap for gap in gaps(answer, policy) if gap.estimate is chosen), None)
    apart = "–"
    if own is not None and answer.resolution is not None:
        K = answer.resolution.calibration.intrinsics
        # + 0.0 takes the sign off a zero.
        apart = f"{round(own.estimate.intrinsics.fx / K.fx - 1.0, 4) + 0.0:+.2%}".replace("-", "−")
    return (
        named(flown),
        answer.entry_id or "–",
        Badge("no entry" if answer.use is Use.NONE else answer.use.value, USES[answer.use]),
        str(flown.images),
        flown.last.isoformat() if flown.last is not None else "–",
        apart,
    )


def _charts(done: Audit) -> Iterator[Block]:
    concerned = {(one.camera, one.place) for one in done.findings if one.rule in DRAWN}
    shown = [one for one in done.answers if (named(one.flown), one.entry_id) in concerned]
    for answer in shown[:MOST_DRAWN]:
        figure = _chart(answer, done.policy)
        if figure is not None:
            yield Section(title=named(answer.flown), blocks=(figure,))
    if len(shown) > MOST_DRAWN:
        yield f"{len(shown) - MOST_DRAWN} more are in the JSON."


def _chart(answer: Answer, policy: Policy) -> Figure | None:
    found = gaps(answer, policy)
    if answer.resolution is None or not found:
        return None
    K, tolerance = answer.resolution.calibration.intrinsics, tolerance_of(answer.resolution.entry, policy)
    rows = [Interval(name=f"entry {answer.entry_id}", value=K.fx, role=Role.CHOSEN)]
    rows += [
        Interval(
            name=gap.estimate.tag,
            value=gap.estimate.intrinsics.fx,
            half_width=gap.estimate.intrinsics.fx * gap.estimate.tolerance,
            role=Role.DISAGREES if gap.is_beyond else Role.AGREES,
        )
        for gap in found
    ]
    band = Band(K.fx * (1 - tolerance), K.fx * (1 + tolerance), "the entry")
    caption = f"What the images say of fx. Shaded: what the entry lets pass, ± {tolerance:.1%}."
    return intervals(rows, axis=PX, caption=caption, band=band)


def _notes(notes: list[Finding]) -> Details:
    told = tuple(
        f"{finding.camera or finding.place}: {finding.rule}. {finding.message}."
        for finding in notes[:MOST_ROWS]
    )
    more = (f"{len(notes) - MOST_ROWS} more are in the JSON.",) if len(notes) > MOST_ROWS else ()
    return Details(summary=_count(len(notes), "note"), blocks=(Bullets(told), *more))


def _unreadable(done: Audit) -> Details:
    found = done.flights.unreadable
    table = Table(
        caption="Images whose camera could not be identified",
        columns=(Column("image"), Column("why")),
        rows=tuple((one.name, one.reason) for one in found[:MOST_ROWS]),
    )
    return Details(summary=_count(len(found), "image"), blocks=(table,))


def _count(number: int, one: str, several: str | None = None) -> str:
    return f"{number} {one if number == 1 else several or one + 's'}"
