"""``calibrary registry audit``: compare recent flights with the registry, interactively or from cron."""

from __future__ import annotations

import argparse
from datetime import date
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.calibrate.flags import number
from calibrary.cli.output import add_json_flag, add_table_flag, check_table_flag, print_json, write_table
from calibrary.cli.progress import Bar
from calibrary.cli.registry.audit_pixels import show_verification
from calibrary.cli.registry.place import add_registry_flag, opened
from calibrary.cli.tables import Column, fitted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.text import Text

    from calibrary.api.tables import Table
    from calibrary.cli.console import Screen
    from calibrary.jobs.audit.answers import Answer
    from calibrary.jobs.audit.groups import AuditedFlight, AuditedUnit
    from calibrary.jobs.audit.run import Audit
    from calibrary.jobs.fleet.exchange import AuditResult

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

EXIT_FINDINGS = 1
NOT_FLOWN = "not flown"
MOST_FIRST = 10
STYLES = {"error": "bold red", "warning": "yellow", "note": "dim"}
USES = {"used": "green", "expired": "red", "draft": "red", "retired": "red", "none": "red"}

DESCRIPTION = (
    "Compare the registry with images of recent flights: find cameras without an entry, entries that the "
    "images contradict, and stale entries. Nothing is written."
)
EXAMPLES = """\
examples:
  calibrary registry audit flights/                          which cameras fly without a valid entry
  calibrary registry audit flights/2026-03 flights/2026-04 --html audit.html
  calibrary registry audit /data/flights --since 2026-04-01 --json      for a cron job
  calibrary registry audit flights/ --stale-after 12         calibrations over a year old
  calibrary registry audit flights/ --verify --html k.html   K over time from the pixels of ordinary flights

The command only reads. exit code 0: nothing to do, possibly notes; 1: an error or a warning; 3: a folder cannot be
read; 4: the registry.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "folders",
        type=Path,
        nargs="+",
        metavar="IMAGES_DIR",
        help="folders of images, sub-folders included",
    )
    parser.add_argument(
        "--since",
        type=_day,
        metavar="DATE",
        help="ignore images that were taken before this day, such as 2026-04-01",
    )
    parser.add_argument(
        "--stale-after",
        type=_months,
        default=24,
        metavar="MONTHS",
        help="report calibrations from this age on (default: 24)",
    )
    parser.add_argument(
        "--verify",
        action="store_true",
        help="also compare the registered K's with the pixels of a dozen images of one flight of each unit and date: "
        "K over time (needs calibrary[sfm]; about a minute for each flight)",
    )
    parser.add_argument(
        "--verify-minutes",
        type=number(0.1, 10_000),
        default=15.0,
        metavar="MINUTES",
        help="time limit of --verify: no flight is started after it (default: 15)",
    )
    parser.add_argument("--workers", type=_count, default=0, metavar="N", help="processes that read images")
    add_registry_flag(parser)
    add_json_flag(parser)
    add_table_flag(parser, "what flew")
    parser.add_argument("--html", type=Path, metavar="FILE", help="also write the audit as a page")


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.api.pages import check_page_place, write_page
    from calibrary.cli.console import note, out

    check_table_flag(arguments)
    if arguments.html is not None:
        check_page_place(arguments.html)
    # Without pycolmap the audit ends with one line that names the extra, and must announce nothing before it.
    if arguments.verify and find_spec("pycolmap") is not None:
        note(arguments).say(
            "[dim]--verify: one flight of each unit and date, a dozen images and about a minute each, "
            f"at most {arguments.verify_minutes:g} min[/]"
        )
    with Bar(note(arguments), "reading") as bar:
        done = opened(arguments).audit(
            arguments.folders,
            since=arguments.since,
            stale_months=arguments.stale_after,
            workers=arguments.workers,
            verify=arguments.verify,
            verify_minutes=arguments.verify_minutes,
            progress=bar,
        )
    if arguments.html is not None:
        write_page(arguments.html, done.to_html())
    write_table(arguments.table, lambda: _as_table(done))
    if arguments.json:
        print_json(done.to_dict())
    else:
        _show(out(arguments), done.audit)
    return 0 if done.is_clean else EXIT_FINDINGS


def _as_table(done: AuditResult) -> Table:
    from calibrary.api.tables import audited_cameras

    return audited_cameras(done)


def _show(screen: Screen, done: Audit) -> None:
    from calibrary.cli.console import plain
    from calibrary.jobs.fleet.exchange import LEVELS

    _show_first(screen, done.units)
    if done.answers:
        screen.show(_table([answer for unit in done.units for answer in unit.answers], screen.width))
    if len(done.by_flight) > 1:
        screen.show(_flights(done.by_flight, screen.width))
    if done.verification is not None:
        show_verification(screen, done.verification)
    for unit in done.units:
        _show_findings(screen, unit)
    quiet = [finding for finding in done.findings if finding.rule == NOT_FLOWN]
    if quiet:
        screen.say(f"[dim]{_several(len(quiet), 'usable entry', 'usable entries')} did not fly here[/]")
    for one in done.flights.unreadable[:8]:
        screen.say(f"[dim]skipped {plain(one.name)}: {plain(one.reason)}[/]")
    if len(done.flights.unreadable) > 8:
        screen.say(f"[dim]and {len(done.flights.unreadable) - 8} more images[/]")
    counts = ", ".join(_several(done.of(level), level.value, f"{level.value}s") for level in LEVELS)
    verdict = "[bold green]nothing to do[/]" if done.is_clean else "[bold red]needs attention[/]"
    seen = done.flights
    left_out = f", {seen.before} older left out" if seen.before else ""
    left_out += f", {seen.undated} without a day" if seen.undated else ""
    screen.say(
        f"{verdict}: {_several(len(done.answers), 'camera', 'cameras')} in "
        f"{_several(seen.images, 'image', 'images')}{left_out}, "
        f"{_several(done.entries, 'entry', 'entries')}: {counts}"
    )


def _show_first(screen: Screen, units: Sequence[AuditedUnit]) -> None:
    """Show what to do, one line per unit, most urgent first."""
    from calibrary.cli.console import plain

    due = [unit for unit in units if unit.level is not None and unit.level.value in {"error", "warning"}]
    if not due:
        return
    screen.say(f"[bold]what to do first[/], {_several(len(due), 'unit', 'units')}")
    for place, unit in enumerate(due[:MOST_FIRST], start=1):
        first, level = unit.findings[0], unit.findings[0].severity.value
        flew = f", {_several(unit.images, 'image', 'images')}" if unit.images else ""
        more = f", {len(unit.findings) - 1} more below" if len(unit.findings) > 1 else ""
        screen.say(f"{place}. {plain(unit.name)}: [{STYLES[level]}]{first.rule}[/]{flew}{more}", hang=3)
        if unit.next is not None:
            screen.say(f"[cyan]next[/] {plain(unit.next)}", indent=3)
    if len(due) > MOST_FIRST:
        screen.say(f"[dim]and {len(due) - MOST_FIRST} more units[/]")


def _show_findings(screen: Screen, unit: AuditedUnit) -> None:
    from calibrary.cli.console import plain

    for finding in unit.findings:
        if finding.rule == NOT_FLOWN:
            continue
        about = plain(finding.camera or finding.place or "")
        screen.say(f"[{STYLES[finding.severity.value]}]{finding.severity.value}[/] {finding.rule}: {about}")
        screen.say(f"  {plain(finding.message)}")
        if finding.remedy is not None:
            screen.say(f"  [cyan]next[/] {plain(finding.remedy)}")


FLIGHTS = (
    Column(name="flight"),
    Column(name="days", rank=2),
    Column(name="images", rank=3, right=True),
    Column(name="units", rank=4, right=True),
    Column(name="without a usable entry", rank=1, wraps=True),
)


def _flights(flights: Sequence[AuditedFlight], width: int) -> list[Text]:
    from calibrary.cli.console import plain

    rows = [
        (
            plain(one.name),
            _days(one),
            str(one.images),
            str(len(one.units)),
            f"[red]{plain('; '.join(one.without))}[/]" if one.without else "",
        )
        for one in flights
    ]
    return fitted(FLIGHTS, rows, width)


def _days(flight: AuditedFlight) -> str:
    days = dict.fromkeys(day.isoformat() for day in (flight.first, flight.last) if day is not None)
    return " to ".join(days) or "–"


COLUMNS = (
    Column(name="camera", wraps=True),
    Column(name="images", rank=2, right=True),
    Column(name="last flown", rank=3),
    Column(name="entry", rank=4),
    Column(name="state", rank=1),
)


def _table(answers: Sequence[Answer], width: int) -> list[Text]:
    from calibrary.cli.console import plain
    from calibrary.jobs.fleet.exchange import named

    rows = []
    for answer in answers:
        flown, use = answer.flown, answer.use.value
        rows.append(
            (
                plain(named(flown)),
                str(flown.images),
                flown.last.isoformat() if flown.last is not None else "–",
                plain(answer.entry_id or "–"),
                f"[{USES[use]}]{'no entry' if use == 'none' else use}[/]",
            )
        )
    return fitted(COLUMNS, rows, width)


def _several(number: int, one: str, several: str) -> str:
    return f"{number} {one if number == 1 else several}"


def _day(text: str) -> date:
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a day such as 2026-04-01") from None


def _months(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text[:6]) <= 1200:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a whole number of months, 1 … 1200")
    return int(text)


def _count(text: str) -> int:
    if not text.isdecimal() or len(text) > 4 or int(text) > 256:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a whole number of processes, 0 … 256")
    return int(text)
