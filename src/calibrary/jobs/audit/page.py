"""Page of an audit: what to do first, all flights, and each unit with its findings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import date
from typing import Final

from calibrary.jobs.audit.agreement import gaps, tolerance_of
from calibrary.jobs.audit.answers import Answer, Use, named
from calibrary.jobs.audit.groups import AuditedFlight, AuditedUnit
from calibrary.jobs.audit.rules import Rule
from calibrary.jobs.audit.run import LEVELS, Audit
from calibrary.jobs.audit.time_section import time_section
from calibrary.pages import (
    Badge,
    Block,
    Bullets,
    Cell,
    Column,
    Details,
    Figure,
    Link,
    Note,
    Page,
    Section,
    Tone,
)
from calibrary.pages.plots import Axis, Band, Interval, Role, intervals
from calibrary.pages.wording import (
    SEVERITIES,
    count,
    cut_table,
    made_by,
    minus,
    or_unknown,
    sentence,
    several,
)
from calibrary.policy import Policy
from calibrary.validation import Finding, Severity

__all__ = ["audit_page"]

# A warning of an audit requires an action.
TONES: Final = {**SEVERITIES, Severity.WARNING: Tone.CAUTION}
USES: Final = {use: Tone.GOOD if use is Use.USED else Tone.BAD for use in Use}
PX: Final = Axis("fx", "px")
MOST_ROWS: Final = 500
MOST_UNITS: Final = 60
"""Most units that get their own section; the table lists all units."""
DRAWN: Final = {Rule.DRIFT, Rule.TAGS, Rule.FIRMWARE}
CAMERAS: Final = (
    Column("camera"),
    Column("entry"),
    Column("state"),
    Column("images", numeric=True),
    Column("last flown"),
    Column("difference of fx to the entry", numeric=True),
)


def audit_page(done: Audit) -> Page:
    """Make the page of an audit."""
    levels = (count(done.of(level), level.value) for level in LEVELS)
    days = [day for one in done.by_flight for day in (one.first, one.last) if day is not None]
    commit = done.request.snapshot.commit
    return Page(
        title="Audit of the registry",
        badge=Badge("nothing to do", Tone.GOOD) if done.is_clean else Badge("needs attention", Tone.BAD),
        lead=f"{count(done.flights.images, 'image')} of {count(len(done.by_flight), 'flight')} compared with "
        f"{count(done.entries, 'entry', 'entries')} of the registry: {', '.join(levels)}.",
        facts=(
            ("images in", several(folder.name or str(folder) for folder in done.request.folders)),
            ("flown", or_unknown(_days(min(days, default=None), max(days, default=None)))),
            ("registry at", f"commit {commit[:12]}" if commit is not None else "a folder without git"),
            ("audited on", done.request.today.isoformat()),
        ),
        sections=tuple(_sections(done)),
        # The first table links to the sections of the units.
        contents=False,
        made_by=made_by(
            f"on {done.request.today}, the registry at {(commit or 'a folder without git')[:12]}"
        ),
    )


def _sections(done: Audit) -> Iterator[Section]:
    due = [unit for unit in done.units if unit.level is not None and unit.level is not Severity.NOTE]
    if due:
        yield Section(title="What to do first", blocks=tuple(_first(due)))
    yield Section(title="Flights", blocks=tuple(_flights(done)))
    concerned = {(one.camera, one.place) for one in done.findings if one.rule in DRAWN}
    for n, unit in enumerate(due[:MOST_UNITS]):
        blocks = tuple(_unit(unit, concerned, done.policy))
        badge = Badge(unit.findings[0].rule, TONES[unit.findings[0].severity])
        yield Section(title=unit.name, badge=badge, anchor=_anchor(n), blocks=blocks, printed=False)
    fine = [answer for unit in done.units if unit not in due for answer in unit.answers]
    if fine:
        caption = "Cameras that need nothing: each unit with each firmware, and the entry that is used"
        rows = [_row(answer, named(answer.flown), done.policy) for answer in fine]
        table = cut_table(caption, CAMERAS, rows, most=MOST_ROWS, rest="the JSON")
        yield Section(title="Nothing to do", blocks=tuple(table), printed=False)
    if done.verification is not None:
        yield time_section(done.verification)
    notes = [finding for finding in done.findings if finding.severity is Severity.NOTE]
    if notes:
        yield Section(title="For information", blocks=(_notes(notes),), printed=False)
    if done.flights.unreadable:
        yield Section(title="Images skipped", blocks=(_unreadable(done),), printed=False)


def _first(due: Sequence[AuditedUnit]) -> Iterator[Block]:
    """Table with one row per unit, most urgent first."""
    columns = (
        Column("unit"),
        Column("most urgent"),
        Column("findings", numeric=True),
        Column("images", numeric=True),
        Column("flights"),
        Column("do this"),
    )
    rows = [
        (
            Link(unit.name, f"#{_anchor(n)}") if n < MOST_UNITS else unit.name,
            Badge(unit.findings[0].rule, TONES[unit.findings[0].severity]),
            str(sum(finding.severity is not Severity.NOTE for finding in unit.findings)),
            str(unit.images),
            several(dict.fromkeys(leg.flight for leg in unit.legs)),
            unit.next or "–",
        )
        for n, unit in enumerate(due)
    ]
    caption = "Every unit that needs attention, the most urgent first"
    yield from cut_table(caption, columns, rows, most=MOST_ROWS, rest="the JSON")


def _anchor(n: int) -> str:
    return f"unit-{n + 1}"


def _flights(done: Audit) -> Iterator[Block]:
    columns = (
        Column("flight"),
        Column("state"),
        Column("days"),
        Column("images", numeric=True),
        Column("units with an entry to use"),
        Column("units without"),
    )
    caption = "Every flight (a folder of images), those that need attention first"
    rows = [_flight(one) for one in done.by_flight]
    yield from cut_table(caption, columns, rows, most=MOST_ROWS, rest="the JSON")
    if done.flights.undated:
        yield f"{count(done.flights.undated, 'image')} without a date counted as recent."
    if done.flights.before:
        yield f"{count(done.flights.before, 'image')} taken before {done.request.since} skipped."


def _flight(one: AuditedFlight) -> tuple[Cell, ...]:
    attention = one.level is not None and one.level is not Severity.NOTE
    return (
        one.name,
        Badge(one.level.value, TONES[one.level])
        if one.level is not None and attention
        else Badge("good", Tone.GOOD),
        _days(one.first, one.last) or "–",
        str(one.images),
        several(unit for unit in one.units if unit not in one.without),
        several(one.without),
    )


def _days(first: date | None, last: date | None) -> str | None:
    if first is None or last is None or first == last:
        day = first or last
        return day.isoformat() if day is not None else None
    return f"{first} to {last}"


def _unit(
    unit: AuditedUnit, concerned: set[tuple[str | None, str | None]], policy: Policy
) -> Iterator[Block]:
    """Section of one unit: findings, cameras, and the estimates of fx from their images if fx is in question."""
    own = {named(answer.flown): str(answer.flown.key) for answer in unit.answers}
    for finding in unit.findings:
        if finding.severity is not Severity.NOTE:
            camera = own.get(finding.camera or "", finding.camera) or finding.place
            yield Note(
                text=f"{sentence(finding.rule)} {camera}: {finding.message}.",
                action=finding.remedy,
                tone=TONES[finding.severity],
            )
    if unit.answers:
        rows = [_row(answer, _within(answer), policy) for answer in unit.answers]
        yield from cut_table("Its cameras", CAMERAS, rows, most=MOST_ROWS, rest="the JSON")
    for answer in unit.answers:
        if (named(answer.flown), answer.entry_id) in concerned:
            figure = _chart(answer, policy)
            if figure is not None:
                yield figure


def _within(answer: Answer) -> str:
    """The camera in words, without its unit."""
    key = answer.flown.key
    return f"{key}, firmware {key.firmware}" if key.firmware is not None else str(key)


def _row(answer: Answer, name: str, policy: Policy) -> tuple[Cell, ...]:
    flown = answer.flown
    chosen = flown.camera.evidence.chosen
    own = next((gap for gap in gaps(answer, policy) if gap.estimate is chosen), None)
    apart = "–"
    if own is not None and answer.resolution is not None:
        K = answer.resolution.calibration.intrinsics
        # + 0.0 removes the sign of −0.0.
        apart = minus(f"{round(own.estimate.intrinsics.fx / K.fx - 1.0, 4) + 0.0:+.2%}")
    return (
        name,
        answer.entry_id or "–",
        Badge("no entry" if answer.use is Use.NONE else answer.use.value, USES[answer.use]),
        str(flown.images),
        flown.last.isoformat() if flown.last is not None else "–",
        apart,
    )


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
    caption = f"fx by each source in the images of {_within(answer)}. Shaded: the entry ± {tolerance:.1%}."
    return intervals(rows, axis=PX, caption=caption, band=band)


def _notes(notes: Sequence[Finding]) -> Details:
    told = tuple(
        f"{finding.camera or finding.place}: {finding.rule}. {sentence(finding.message)}"
        for finding in notes[:MOST_ROWS]
    )
    more = (f"{len(notes) - MOST_ROWS} more are in the JSON.",) if len(notes) > MOST_ROWS else ()
    return Details(summary=count(len(notes), "note"), blocks=(Bullets(told), *more))


def _unreadable(done: Audit) -> Details:
    found = done.flights.unreadable
    rows = [(one.name, one.reason) for one in found]
    columns = (Column("image"), Column("reason"))
    table = cut_table(
        "Images of a camera that could not be identified", columns, rows, most=MOST_ROWS, rest="the JSON"
    )
    return Details(summary=count(len(found), "image"), blocks=tuple(table))
