"""Page of an audit: what to do first, all flights, and each unit with its findings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Final

from calibrary.jobs.audit.report import (
    LEVELS,
    AuditedCamera,
    AuditedFlight,
    AuditedUnit,
    AuditReport,
    Change,
    DatedCheck,
    Rule,
    UnitOverTime,
    Use,
    Verification,
)
from calibrary.pages.plots import Axis, Band, Interval, Role, intervals
from calibrary.pages.plots.intervals import Dated, Period, over_time
from calibrary.pages.wording import (
    SEVERITIES,
    count,
    cut_table,
    known,
    made_by,
    minus,
    sentence,
    several,
)
from calibrary.sfm.pixel_check import PixelVerdict
from calibrary.validation import Finding, Severity
from calibrary.view import (
    Badge,
    Block,
    Bullets,
    Cell,
    Column,
    Details,
    Figure,
    Link,
    Note,
    Section,
    Tone,
    View,
)

# A warning of an audit requires an action.
TONES: Final = {**SEVERITIES, Severity.WARNING: Tone.CAUTION}
USES: Final = {use: Tone.GOOD if use is Use.USED else Tone.BAD for use in Use}
PX: Final = Axis("fx", "px")
BADGES: Final = {
    "clean": Badge("nothing to do", Tone.GOOD),
    "incomplete": Badge("not everything was compared", Tone.CAUTION),
    "findings": Badge("needs attention", Tone.BAD),
}
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
MOST_SERIES: Final = 50
"""Most units whose K over time is shown."""
MOST_FLIGHTS: Final = 100
CHECKS: Final = (
    Column("day"),
    Column("verdict"),
    Column("by the pixels, ± 1 σ (px)", numeric=True),
    Column("fx of K (px)", numeric=True),
    Column("K from"),
    Column("flight"),
    Column("firmware"),
    Column("reason"),
)
ROLES: Final = {
    PixelVerdict.AGREES: Role.AGREES,
    PixelVerdict.CONTRADICTS: Role.DISAGREES,
    PixelVerdict.CANNOT_TELL: Role.NO_K,
}
PIXELS: Final = {
    PixelVerdict.AGREES: Tone.GOOD,
    PixelVerdict.CONTRADICTS: Tone.BAD,
    PixelVerdict.CANNOT_TELL: Tone.NEUTRAL,
}
STEADY: Final = {Change.STEADY: Tone.GOOD, Change.UNKNOWN: Tone.NEUTRAL, Change.SEVERAL_UNITS: Tone.NEUTRAL}


def audit_page(done: AuditReport) -> View:
    """Make the page of an audit."""
    levels = (count(getattr(done.counts, level.value), level.value) for level in LEVELS)
    days = [day for one in done.flights for day in (one.first, one.last) if day is not None]
    return View(
        title="Audit of the registry",
        badge=BADGES[done.verdict],
        lead=f"{count(done.images, 'image')} of {count(len(done.flights), 'flight')} compared with "
        f"{count(done.entries, 'entry', 'entries')} of the registry: {', '.join(levels)}.",
        facts=known(
            ("images in", several(Path(folder).name or folder for folder in done.folders)),
            ("flown", _days(min(days, default=None), max(days, default=None))),
            (
                "registry at",
                f"commit {done.commit[:12]}" if done.commit is not None else "a folder without git",
            ),
            ("audited on", done.on.isoformat()),
        ),
        sections=tuple(_sections(done)),
        # The first table links to the sections of the units.
        contents=False,
        made_by=made_by(f"on {done.on}, the registry at {(done.commit or 'a folder without git')[:12]}"),
    )


def _sections(done: AuditReport) -> Iterator[Section]:
    due = [unit for unit in done.units if unit.is_due]
    if due:
        yield Section(title="What to do first", blocks=tuple(_first(due)))
    yield Section(title="Flights", blocks=tuple(_flights(done)))
    concerned = {(one.camera, one.place) for one in done.findings if one.rule in DRAWN}
    for n, unit in enumerate(due[:MOST_UNITS]):
        blocks = tuple(_unit(unit, done.cameras_of(unit), concerned))
        badge = Badge(unit.findings[0].rule, TONES[unit.findings[0].severity])
        yield Section(title=unit.name, badge=badge, anchor=_anchor(n), blocks=blocks, printed=False)
    fine = [camera for unit in done.units if not unit.is_due for camera in done.cameras_of(unit)]
    if fine:
        caption = "Cameras that need nothing: each unit with each firmware, and the entry that is used"
        rows = [_row(camera, camera.name) for camera in fine]
        table = cut_table(caption, CAMERAS, rows, most=MOST_ROWS, rest="the JSON")
        yield Section(title="Nothing to do", blocks=tuple(table), printed=False)
    if done.verification is not None:
        yield _time_section(done.verification)
    notes = [finding for finding in done.findings if finding.severity is Severity.NOTE]
    if notes:
        yield Section(title="For information", blocks=(_notes(notes),), printed=False)
    if done.not_compared:
        rows = [(one.what, one.reason) for one in done.not_compared]
        columns = (Column("camera, file or proposal"), Column("reason"))
        table = cut_table("What could not be compared", columns, rows, most=MOST_ROWS, rest="the JSON")
        yield Section(title="Not compared", blocks=tuple(table), printed=False)
    if done.unreadable:
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
            several(dict.fromkeys(leg.flight for leg in unit.flights)),
            unit.next or "–",
        )
        for n, unit in enumerate(due)
    ]
    caption = "Every unit that needs attention, the most urgent first"
    yield from cut_table(caption, columns, rows, most=MOST_ROWS, rest="the JSON")


def _anchor(n: int) -> str:
    return f"unit-{n + 1}"


def _flights(done: AuditReport) -> Iterator[Block]:
    columns = (
        Column("flight"),
        Column("state"),
        Column("days"),
        Column("images", numeric=True),
        Column("units with an entry to use"),
        Column("units without"),
    )
    caption = "Every flight (a folder of images), those that need attention first"
    rows = [_flight(one) for one in done.flights]
    yield from cut_table(caption, columns, rows, most=MOST_ROWS, rest="the JSON")
    if done.images_undated:
        yield f"{count(done.images_undated, 'image')} without a date counted as recent."
    if done.images_before:
        yield f"{count(done.images_before, 'image')} taken before {done.since} skipped."


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
    unit: AuditedUnit, cameras: Sequence[AuditedCamera], concerned: set[tuple[str | None, str | None]]
) -> Iterator[Block]:
    """Section of one unit: findings, cameras, and the estimates of fx from their images if fx is in question."""
    own = {one.name: str(one.camera) for one in cameras}
    for finding in unit.findings:
        if finding.severity is not Severity.NOTE:
            camera = own.get(finding.camera or "", finding.camera) or finding.place
            yield Note(
                text=f"{sentence(finding.rule)} {camera}: {finding.message}.",
                action=finding.remedy,
                tone=TONES[finding.severity],
            )
    if cameras:
        rows = [_row(one, _within(one)) for one in cameras]
        yield from cut_table("Its cameras", CAMERAS, rows, most=MOST_ROWS, rest="the JSON")
    for one in cameras:
        if (one.name, one.entry) in concerned:
            figure = _chart(one)
            if figure is not None:
                yield figure


def _within(one: AuditedCamera) -> str:
    """The camera in words, without its unit."""
    key = one.camera
    return f"{key}, firmware {key.firmware}" if key.firmware is not None else str(key)


def _row(one: AuditedCamera, name: str) -> tuple[Cell, ...]:
    apart = "–"
    if one.own is not None and one.fx is not None:
        # + 0.0 removes the sign of −0.0.
        apart = minus(f"{round(one.own.fx / one.fx - 1.0, 4) + 0.0:+.2%}")
    return (
        name,
        one.entry or "–",
        Badge("no entry" if one.use is Use.NONE else one.use.value, USES[one.use]),
        str(one.images),
        one.last.isoformat() if one.last is not None else "–",
        apart,
    )


def _chart(one: AuditedCamera) -> Figure | None:
    if one.fx is None or one.tolerance is None or not one.sources:
        return None
    rows = [Interval(name=f"entry {one.entry}", value=one.fx, role=Role.CHOSEN)]
    rows += [
        Interval(
            name=source.tag,
            value=source.fx,
            half_width=source.fx * source.tolerance,
            role=Role.DISAGREES if source.contradicts else Role.AGREES,
        )
        for source in one.sources
    ]
    band = Band(one.fx * (1 - one.tolerance), one.fx * (1 + one.tolerance), "the entry")
    caption = f"fx by each source in the images of {_within(one)}. Shaded: the entry ± {one.tolerance:.1%}."
    return intervals(rows, axis=PX, caption=caption, band=band)


def _notes(notes: Sequence[Finding]) -> Details:
    told = tuple(
        f"{finding.camera or finding.place}: {finding.rule}. {sentence(finding.message)}"
        for finding in notes[:MOST_ROWS]
    )
    more = (f"{len(notes) - MOST_ROWS} more are in the JSON.",) if len(notes) > MOST_ROWS else ()
    return Details(summary=count(len(notes), "note"), blocks=(Bullets(told), *more))


def _unreadable(done: AuditReport) -> Details:
    found = done.unreadable
    rows = [(one.name, one.reason) for one in found]
    columns = (Column("image"), Column("reason"))
    table = cut_table(
        "Images of a camera that could not be identified", columns, rows, most=MOST_ROWS, rest="the JSON"
    )
    return Details(summary=count(len(found), "image"), blocks=tuple(table))


def _time_section(done: Verification) -> Section:
    """Make the section on K over time."""
    blocks: list[Block] = [
        f"Of each unit and date up to {done.images} images of one flight were looked at; what they show does not "
        "depend on K. What the pixels cannot tell changes nothing."
    ]
    blocks += [
        Section(
            title=unit.name,
            badge=Badge(unit.change.value, STEADY.get(unit.change, Tone.CAUTION)),
            blocks=tuple(_over_time(unit)),
        )
        for unit in done.units[:MOST_SERIES]
    ]
    if len(done.units) > MOST_SERIES:
        blocks.append(f"{len(done.units) - MOST_SERIES} more units are in the JSON.")
    if done.left_out:
        blocks.append(
            f"{done.left_out} more flights were not looked at within {done.minutes:g} min (--verify-minutes)."
        )
    return Section(title="K over time, by the pixels", blocks=tuple(blocks), printed=False)


def _over_time(unit: UnitOverTime) -> Iterator[Block]:
    yield f"By the pixels: {unit.reason}."
    figure = _plot(unit)
    if figure is not None:
        yield figure
    caption = f"The flights of {unit.name} that were looked at"
    rows = [_check(one) for one in unit.flights]
    yield from cut_table(caption, CHECKS, rows, most=MOST_FLIGHTS, rest="the JSON")


def _check(one: DatedCheck) -> tuple[str | Badge, ...]:
    check = one.pixels
    measured = "–"
    if check.measured_fx is not None and check.std is not None:
        measured = f"{check.measured_fx:.1f} ± {check.std * check.measured_fx:.1f}"
    return (
        one.day.isoformat() if one.day is not None else "–",
        Badge(check.verdict.value, PIXELS[check.verdict]),
        measured,
        f"{check.fx:.1f}",
        one.entry or "the images' tags",
        one.flight,
        one.firmware or "–",
        check.reason,
    )


def _plot(unit: UnitOverTime) -> Figure | None:
    """Plot of the measured fx by date against the registered fx; None without measurements."""
    measured = [
        Dated(day=one.day, value=fx, std=std * fx, role=ROLES[one.pixels.verdict])
        for one in unit.flights
        if one.day is not None
        and (fx := one.pixels.measured_fx) is not None
        and (std := one.pixels.std) is not None
    ]
    if not measured:
        return None
    periods = {
        (one.entry, one.pixels.fx, one.valid_from, one.valid_until): Period(
            first=one.valid_from,
            last=one.valid_until,
            value=one.pixels.fx,
            tolerance=(one.tolerance or 0.0) * one.pixels.fx,
            text=one.entry,
        )
        for one in unit.flights
        if one.entry is not None
    }
    dated = [one for one in unit.flights if one.day is not None and one.firmware is not None]
    marks = [
        (after.day, f"firmware {after.firmware}")
        for before, after in pairwise(dated)
        if before.firmware != after.firmware and after.day is not None
    ]
    return over_time(
        measured,
        [*periods.values()],
        axis=Axis("fx", "px"),
        caption="What the pixels of each date show, ± 3 σ. Line and shade: the registered K with its tolerance, over "
        "the days that it is valid on. A square cannot tell.",
        marks=marks,
    )
