"""``calibrary registry audit``: compare recent flights with the registry, interactively or from cron."""

from __future__ import annotations

import argparse
import re
from importlib.util import find_spec
from itertools import compress
from typing import TYPE_CHECKING

from calibrary.cli.commands import add_json_flag, add_table_flag, check_table_flag, print_json, write_table
from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.cli.registry import add_registry_flag, opened, where
from calibrary.cli.tables import Column, fitted
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.text import Text

    from calibrary.cli.console import Screen
    from calibrary.jobs.audit.report import (
        AuditedCamera,
        AuditedFlight,
        AuditedUnit,
        AuditReport,
        UnitOverTime,
        Verification,
    )
    from calibrary.jobs.tables.rows import Table

EXIT_FINDINGS = 1
NOT_FLOWN = "not flown"
MOST_SKIPPED = 8
COMMAND = re.compile(r"\bcalibrary (registry \w+|diff|onboard|calibrate)\b")
STYLES = {"error": "bold red", "warning": "yellow", "note": "dim", "clean": "green"}
VERDICTS = {"agrees": "green", "contradicts": "red", "cannot tell": "dim"}
VERDICT = {
    "clean": "[bold green]nothing to do[/]",
    "incomplete": "[bold yellow]nothing found, but not everything was compared[/]",
    "findings": "[bold red]needs attention[/]",
}
CHANGES = {"steady": "green", "cannot tell": "dim"}

DESCRIPTION = (
    "Compare the registry with images of recent flights: find cameras without an entry, entries that the "
    "images, files among them or proposals contradict, and stale entries. Nothing is written."
)
EXAMPLES = """\
examples:
  calibrary registry audit flights/                          which cameras fly without a valid entry
  calibrary registry audit flights/2026-03 flights/2026-04 --html audit.html
  calibrary registry audit /data/flights --since 2026-04-01 --json      for a cron job
  calibrary registry audit flights/ --stale-after-months 12   calibrations over a year old
  calibrary registry audit flights/ --verify --html k.html   K over time from the pixels of ordinary flights

The entries in use are compared with what the images state, with calibration files among them, and with proposals on
any branch. The command only reads. exit code 0: nothing to do, possibly notes; 1: an error or a warning, or not
everything could be compared; 3: a folder cannot be read; 4: the registry.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, Fleet.audit, positional={"folders": "IMAGES_DIR"})
    add_registry_flag(parser)
    add_json_flag(parser)
    add_table_flag(parser, "what flew")


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out

    check_table_flag(arguments)
    # Without pycolmap the audit ends with one line that names the extra, and must announce nothing before it.
    if arguments.verify and find_spec("pycolmap") is not None:
        note(arguments).say(
            "[dim]--verify: one flight of each unit and date, a dozen images and about a minute each, "
            f"at most {arguments.verify_minutes or 15:g} min[/]"
        )
    with Bar(note(arguments), "reading") as bar:
        done = call(opened(arguments).audit, arguments, progress=bar)
    write_table(arguments.table, lambda: _as_table(done))
    if arguments.json:
        print_json(done)
    else:
        _show(out(arguments), done, where(arguments))
    return 0 if done.is_clean else EXIT_FINDINGS


def _as_table(done: AuditReport) -> Table:
    from calibrary.jobs.tables.rows import audit_table

    return audit_table(done)


def _show(screen: Screen, done: AuditReport, registry: str) -> None:
    """Show each unit once, most urgent first: its finding, what to do, and what its pixels show over time."""
    series = done.verification.units if done.verification is not None else ()
    for unit in done.units:
        if unit.images or any(finding.rule != NOT_FLOWN for finding in unit.findings):
            _show_unit(screen, unit, done.cameras_of(unit), registry)
            for one in series:
                if one.name == unit.name:
                    _show_over_time(screen, one)
    if len(done.flights) > 1:
        screen.show(_flights(done.flights, screen.width))
    if done.verification is not None:
        _show_unverified(screen, done.verification)
    quiet = sum(finding.rule == NOT_FLOWN for finding in done.findings)
    if quiet:
        screen.say(f"[dim]{_several(quiet, 'usable entry', 'usable entries')} did not fly here[/]")
    _show_not_compared(screen, done)
    left_out = f", {done.images_before} older left out" if done.images_before else ""
    left_out += f", {done.images_undated} without a day" if done.images_undated else ""
    counts = done.counts
    screen.say(
        f"{VERDICT[done.verdict]}: {_several(len(done.cameras), 'camera', 'cameras')} in "
        f"{_several(done.images, 'image', 'images')}{left_out}, "
        f"{_several(done.entries, 'entry', 'entries')}: {_several(counts.error, 'error', 'errors')}, "
        f"{_several(counts.warning, 'warning', 'warnings')}, {_several(counts.note, 'note', 'notes')}"
    )


def _show_not_compared(screen: Screen, done: AuditReport) -> None:
    from calibrary.cli.console import plain

    for file in done.unreadable[:MOST_SKIPPED]:
        screen.say(f"[dim]skipped {plain(file.name)}: {plain(file.reason)}[/]")
    if len(done.unreadable) > MOST_SKIPPED:
        screen.say(f"[dim]and {len(done.unreadable) - MOST_SKIPPED} more images[/]")
    for one in done.not_compared[:MOST_SKIPPED]:
        screen.say(f"[yellow]not compared[/] {plain(one.what)}: {plain(one.reason)}")
    if len(done.not_compared) > MOST_SKIPPED:
        screen.say(f"[dim]and {len(done.not_compared) - MOST_SKIPPED} more, which --json lists[/]")


def _show_unit(
    screen: Screen, unit: AuditedUnit, cameras: Sequence[AuditedCamera], registry: str = ""
) -> None:
    from calibrary.cli.console import plain

    level = unit.level.value if unit.level is not None else "clean"
    screen.say(f"[{STYLES[level]}]{level}[/] [bold]{plain(unit.name)}[/]: {plain(_in_brief(unit, cameras))}")
    apart = _apart(cameras)
    # What is said of an entry alone names no camera.
    several = len({finding.place for finding in unit.findings if finding.camera is None}) > 1
    for number, finding in enumerate(unit.findings):
        severity, which = finding.severity.value, apart.get(finding.camera or "", "")
        if finding.camera is None and several:
            which = f"{finding.place}: "
        rule = f"[{STYLES[severity]}]{severity}[/] {finding.rule}: " if number else ""
        screen.say(f"{rule}{plain(which + finding.message)}", indent=2)
        if finding.remedy is not None:
            screen.say(f"[cyan]next[/] {plain(_of(registry, finding.remedy))}", indent=2)


def _of(registry: str, remedy: str) -> str:
    """A remedy with the flag that selects the audited registry in its commands, unless they are run in its folder."""
    return remedy if "in the registry's folder" in remedy else COMMAND.sub(rf"\g<0>{registry}", remedy)


def _apart(cameras: Sequence[AuditedCamera]) -> dict[str, str]:
    """What distinguishes each camera of a unit from its others: lens, focal length, mode, image size, firmware."""
    stated = {
        one.name: (
            one.camera.lens,
            f"{one.camera.focal_mm:g} mm" if one.camera.focal_mm is not None else None,
            one.camera.capture_mode,
            "{}×{}".format(*one.camera.image_size) if one.camera.image_size else None,
            f"firmware {one.camera.firmware or 'not stated'}",
        )
        for one in cameras
    }
    differ = [len(set(values)) > 1 for values in zip(*stated.values(), strict=True)]
    told = {name: ", ".join(filter(None, compress(values, differ))) for name, values in stated.items()}
    return {name: f"{text}: " if text else "" for name, text in told.items()}


def _in_brief(unit: AuditedUnit, cameras: Sequence[AuditedCamera]) -> str:
    """The most severe finding in a word; of a unit without any what flew, the entries that are used, and what tells."""
    if unit.findings:
        return unit.findings[0].rule
    last = max((leg.last for leg in unit.flights if leg.last is not None), default=None)
    flew = _several(unit.images, "image", "images") + (f", last on {last}" if last is not None else "")
    told = dict.fromkeys(
        f"{one.own.tag} {one.own.difference:+.2%}, within ±{one.own.limit:.1%}"
        for one in cameras
        if one.own is not None
    )
    return "; ".join([f"{flew}, {', '.join(unit.entries)}", *told])


FLIGHTS = (
    Column(name="flight"),
    Column(name="days", rank=2),
    Column(name="images", rank=3, right=True),
    Column(name="units", rank=4, right=True),
    Column(name="without a usable entry", rank=1, right=True),
)


def _flights(flights: Sequence[AuditedFlight], width: int) -> list[Text]:
    from calibrary.cli.console import plain

    rows = [
        (
            plain(one.name),
            " to ".join(dict.fromkeys(str(day) for day in (one.first, one.last) if day is not None)) or "–",
            str(one.images),
            str(len(one.units)),
            f"[red]{len(one.without)}[/]" if one.without else "",
        )
        for one in flights
    ]
    return fitted(FLIGHTS, rows, width)


OVER_TIME = (
    Column(name="day"),
    Column(name="flight", rank=2, wraps=True),
    Column(name="firmware", rank=4),
    Column(name="K from", rank=3),
    Column(name="fx of K", rank=1, right=True),
    Column(name="by the pixels", right=True),
    Column(name="verdict"),
    Column(name="reason", rank=5, wraps=True),
)


def _show_over_time(screen: Screen, unit: UnitOverTime) -> None:
    from calibrary.cli.console import plain

    rows = []
    for one in unit.flights:
        check, verdict = one.pixels, one.pixels.verdict.value
        measured = "–"
        if check.measured_fx is not None and check.std is not None:
            measured = f"{check.measured_fx:.1f} ± {check.std * check.measured_fx:.1f}"
        rows.append(
            (
                one.day.isoformat() if one.day is not None else "no day",
                plain(one.flight),
                plain(one.firmware or ""),
                plain(one.entry or "the images' tags"),
                f"{check.fx:.1f}",
                measured,
                f"[{VERDICTS[verdict]}]{verdict}[/]",
                plain(check.reason) if verdict == "cannot tell" else "",
            )
        )
    screen.show(fitted(OVER_TIME, rows, screen.width - 2), indent=2)
    style = CHANGES.get(unit.change.value, "yellow")
    screen.say(f"K over time by the pixels: [{style}]{unit.change.value}[/]: {plain(unit.reason)}", indent=2)


def _show_unverified(screen: Screen, done: Verification) -> None:
    if not done.units:
        screen.say("[dim]no flight has 8 images of one camera and day and a K to compare them with[/]")
    if done.left_out:
        flights = "1 flight was" if done.left_out == 1 else f"{done.left_out} flights were"
        screen.say(f"[yellow]{flights} not looked at in {done.minutes:g} min[/]: --verify-minutes")


def _several(number: int, one: str, several: str) -> str:
    return f"{number} {one if number == 1 else several}"
