"""What an audit shows: every unit and what to do, each with its findings, and all flights."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import date
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.errors import first_of
from calibrary.jobs.audit.age import Rule
from calibrary.jobs.audit.report import (
    LEVELS,
    AuditedCamera,
    AuditedFlight,
    AuditedUnit,
    AuditReport,
    Change,
    DatedCheck,
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
    in_registry,
    known,
    made_by,
    minus,
    sentence,
    several,
)
from calibrary.sfm.pixel_check import PixelVerdict
from calibrary.validation import Severity
from calibrary.view import (
    Badge,
    Block,
    Cell,
    Column,
    Details,
    Figure,
    Link,
    Note,
    Plots,
    Section,
    Table,
    Tone,
    View,
)

# A warning of an audit requires an action.
TONES: Final = {**SEVERITIES, Severity.WARNING: Tone.CAUTION}
USES: Final = {use: Tone.GOOD if use is Use.USED else Tone.BAD for use in Use}
PX: Final = Axis("fx", "px")
BADGES: Final = {
    "clean": Badge("nothing to do", Tone.GOOD),
    "incomplete": Badge("nothing found, but not everything was compared", Tone.CAUTION),
    "findings": Badge("needs attention", Tone.BAD),
}
NOT_FLOWN: Final = "not flown"
MOST_FINE: Final = 10
"""Most units without a finding that have a row of their own."""
FEW: Final = 3
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


def told(done: AuditReport, *, registry: str = "") -> View:
    """Describe an audit.

    Args:
        done: the result.
        registry: the flag that selects the registry, for the commands of the remedies.
    """
    levels = (count(getattr(done.counts, level.value), level.value) for level in LEVELS)
    days = [day for one in done.flights for day in (one.first, one.last) if day is not None]
    left_out = f", {done.images_before} older left out" if done.images_before else ""
    left_out += f", {done.images_undated} without a day" if done.images_undated else ""
    badge = BADGES[done.verdict]
    return View(
        title="Audit of the registry",
        badge=badge,
        lead=f"{badge.text}: {count(len(done.cameras), 'camera')} in {count(done.images, 'image')}{left_out}, "
        f"{count(done.entries, 'entry', 'entries')}: {', '.join(levels)}",
        facts=known(
            ("images in", several(Path(folder).name or folder for folder in done.folders)),
            ("flown", _days(min(days, default=None), max(days, default=None))),
            (
                "registry at",
                f"commit {done.commit[:12]}" if done.commit is not None else "a folder without git",
            ),
            ("audited on", done.on.isoformat()),
        ),
        sections=tuple(_sections(done, registry)),
        made_by=made_by(f"on {done.on}, the registry at {(done.commit or 'a folder without git')[:12]}"),
    )


def _sections(done: AuditReport, registry: str) -> Iterator[Section]:
    yield Section(title="Units", blocks=tuple(_answer(done, registry)))
    if done.verification is not None:
        yield _time_section(done.verification)
    concerned = {(one.camera, one.place) for one in done.findings if one.rule in DRAWN}
    due = [unit for unit in done.units if unit.findings]
    for n, unit in enumerate(due[:MOST_UNITS]):
        blocks = tuple(_unit(unit, done.cameras_of(unit), concerned, registry))
        badge = Badge(unit.findings[0].rule, TONES[unit.findings[0].severity])
        yield Section(title=unit.name, badge=badge, anchor=_anchor(n), blocks=blocks, printed=False)
    fine = [camera for unit in done.units if not unit.is_due for camera in done.cameras_of(unit)]
    if fine:
        caption = "Cameras that need nothing: each unit with each firmware, and the entry that is used"
        rows = [_row(camera, camera.name) for camera in fine]
        table = cut_table(caption, CAMERAS, rows, most=MOST_ROWS, rest="the JSON")
        yield Section(title="Nothing to do", blocks=tuple(table), printed=False)
    yield Section(title="Flights", blocks=tuple(_flights(done)), printed=False)
    if done.not_compared:
        rows = [(one.what, one.reason) for one in done.not_compared]
        columns = (Column("camera, file or proposal"), Column("reason"))
        table = cut_table("What could not be compared", columns, rows, most=MOST_ROWS, rest="the JSON")
        yield Section(title="Not compared", blocks=tuple(table), printed=False)
    if done.unreadable:
        yield Section(title="Images skipped", blocks=(_unreadable(done),), printed=False)


class Row(Struct, frozen=True, kw_only=True):
    """A row of the answer: a unit, or units with one cause."""

    unit: Cell
    state: Badge
    findings: int = 0
    images: int = 0
    flights: Sequence[str] = ()
    why: str = ""
    do: str = ""


UNITS: Final = (
    Column("unit", lambda row: row.unit),
    Column("state", lambda row: row.state),
    Column("findings", lambda row: str(row.findings or ""), numeric=True, rank=3),
    Column("images", lambda row: str(row.images or ""), numeric=True, rank=2),
    Column("flights", lambda row: first_of(row.flights, 1), rank=4),
    Column("why", lambda row: row.why, below=""),
    Column("what to do", lambda row: row.do, below="→ "),
)


def _answer(done: AuditReport, registry: str) -> Iterator[Block]:
    """Every unit that flew, the most urgent first and those with one cause together, and what was not compared."""
    flew = [unit for unit in done.units if unit.images or unit.is_due]
    anchors = {unit.name: _anchor(n) for n, unit in enumerate(one for one in done.units if one.findings)}
    causes: dict[object, list[AuditedUnit]] = {}
    for unit in flew:
        rules = tuple(dict.fromkeys(one.rule for one in unit.findings if one.severity is not Severity.NOTE))
        causes.setdefault((unit.level, rules) if unit.is_due else unit.name, []).append(unit)
    rows = [_cause(units, done, registry, anchors.get(units[0].name)) for units in causes.values()]
    fine = sum(not units[0].is_due for units in causes.values())
    shown = len(rows) - max(0, fine - MOST_FINE)
    yield Table.of("Every unit that flew, the most urgent first", rows[:shown], UNITS)
    if shown < len(rows):
        yield f"{count(len(rows) - shown, 'more unit')} without anything to do"
    if quiet := sum(one.rule == NOT_FLOWN for one in done.findings):
        yield f"{count(quiet, 'usable entry', 'usable entries')} did not fly here"
    for what, found in (
        ("skipped", [(one.name, one.reason) for one in done.unreadable]),
        ("not compared", [(one.what, one.reason) for one in done.not_compared]),
    ):
        reasons: dict[str, list[str]] = {}
        for name, reason in found:
            reasons.setdefault(reason, []).append(name)
        for reason, names in [*reasons.items()][:FEW]:
            yield Note(text=f"{what} {first_of(names, 1)}: {reason}", tone=Tone.CAUTION)
        if more := sum(len(names) for names in [*reasons.values()][FEW:]):
            yield Note(text=f"{what}: {more} more", tone=Tone.CAUTION)
    if done.images_before:
        yield f"{count(done.images_before, 'image')} taken before {done.since} skipped"


def _cause(units: Sequence[AuditedUnit], done: AuditReport, registry: str, anchor: str | None) -> Row:
    first, worst = units[0], units[0].findings[0] if units[0].findings else None
    cameras = done.cameras_of(first)
    which = f"{worst.camera or worst.place}: " if worst is not None and len(cameras) > 1 else ""
    more = f" and {len(units) - 1} more" if len(units) > 1 else ""
    name = f"{first.name}{more}"
    return Row(
        unit=Link(name, f"#{anchor}") if anchor is not None else name,
        state=Badge(worst.rule, TONES[worst.severity]) if worst is not None else Badge("clean", Tone.GOOD),
        findings=sum(len(unit.findings) for unit in units),
        images=sum(unit.images for unit in units),
        flights=[*dict.fromkeys(leg.flight for unit in units for leg in unit.flights)],
        why=f"{which}{worst.message}" if worst is not None else _in_brief(first, cameras),
        do=in_registry(registry, first.next or (worst.remedy if worst is not None else None) or ""),
    )


def _in_brief(unit: AuditedUnit, cameras: Sequence[AuditedCamera]) -> str:
    """Of a unit without a finding, the entries that are used, and what tells that they are right."""
    last = max((leg.last for leg in unit.flights if leg.last is not None), default=None)
    told = dict.fromkeys(
        f"{one.own.tag} {one.own.difference:+.2%}, within ±{one.own.limit:.1%}"
        for one in cameras
        if one.own is not None
    )
    flown = (f"last flown on {last}",) if last is not None else ()
    return "; ".join([", ".join(unit.entries), *told, *flown])


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
    unit: AuditedUnit,
    cameras: Sequence[AuditedCamera],
    concerned: set[tuple[str | None, str | None]],
    registry: str,
) -> Iterator[Block]:
    """Section of one unit: findings, cameras, and the estimates of fx from their images if fx is in question."""
    own = {one.name: str(one.camera) for one in cameras}
    for finding in unit.findings:
        camera = own.get(finding.camera or "", finding.camera) or finding.place
        yield Note(
            text=f"{sentence(finding.rule)} {camera}: {finding.message}.",
            action=in_registry(registry, finding.remedy) if finding.remedy is not None else None,
            tone=TONES[finding.severity],
        )
    if cameras:
        rows = [_row(one, _within(one)) for one in cameras]
        yield from cut_table("Its cameras", CAMERAS, rows, most=MOST_ROWS, rest="the JSON")
    for one in cameras:
        if (one.name, one.entry) in concerned:
            yield Plots(partial(_chart, one))


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


def _chart(one: AuditedCamera) -> Iterator[Figure]:
    if one.fx is None or one.tolerance is None or not one.sources:
        return
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
    yield intervals(rows, axis=PX, caption=caption, band=band)


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
    if not done.units:
        blocks.append("No flight has 8 images of one camera and day and a K to compare them with.")
    if len(done.units) > MOST_SERIES:
        blocks.append(f"{len(done.units) - MOST_SERIES} more units are in the JSON.")
    if done.left_out:
        blocks.append(
            f"{done.left_out} more flights were not looked at within {done.minutes:g} min (--verify-minutes)."
        )
    return Section(title="K over time, by the pixels", blocks=tuple(blocks))


def _over_time(unit: UnitOverTime) -> Iterator[Block]:
    yield f"By the pixels: {unit.reason}."
    yield Plots(partial(_plot, unit))
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


def _plot(unit: UnitOverTime) -> Iterator[Figure]:
    """Plot of the measured fx by date against the registered fx, if there are measurements."""
    measured = [
        Dated(day=one.day, value=fx, std=std * fx, role=ROLES[one.pixels.verdict])
        for one in unit.flights
        if one.day is not None
        and (fx := one.pixels.measured_fx) is not None
        and (std := one.pixels.std) is not None
    ]
    if not measured:
        return
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
    yield over_time(
        measured,
        [*periods.values()],
        axis=Axis("fx", "px"),
        caption="What the pixels of each date show, ± 3 σ. Line and shade: the registered K with its tolerance, over "
        "the days that it is valid on. A square cannot tell.",
        marks=marks,
    )
