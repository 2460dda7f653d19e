"""``calibrary diff``: whether two calibrations of one camera differ by more than noise, and what changed."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.cli.tables import Column, fitted
from calibrary.jobs.diff import compare, compare_fleet

if TYPE_CHECKING:
    from rich.text import Text

    from calibrary.cli.console import Screen
    from calibrary.jobs.diff.comparison import Difference, DiffReport
    from calibrary.jobs.diff.fleet import FleetDiffReport

DESCRIPTION = (
    "Compare two calibrations of one camera, or every entry of a registry with its earlier state: in "
    "numbers, in pixels and on the ground, against their noise."
)
EXAMPLES = """\
examples:
  calibrary diff factory.xml adjusted.cam                two files, whatever their formats
  calibrary diff fc6310r@2026-05-01 fc6310r              an entry of the registry, then and now
  calibrary diff fc6310r@firmware:01.08 flight/DJI_0001.JPG
  calibrary diff K.npy camera.xml --camera 2
  calibrary diff old.yaml new.yaml --camera cam0         by name; --camera cam0,cam1 is one for each side
  calibrary diff old.xml new.xml --html diff.html        and a page
  calibrary diff --since v1.0                            every entry that changed since, worst first
  calibrary diff --firmware 01.08..01.09                 every camera calibrated with either; 01.09 is 01.09.1691

--since and --firmware compare proposals as well, each with the entry that it would replace.

exit code 1: the projections differ by 0.5 px rms, 1 px at most or 0.05 % of the focal length (a policy may state
other limits) and no measured uncertainty explains it; or the frame, the lens or a convention
changed; or an
entry could not be compared, or none is of that firmware.
"""

EXIT_ALARM = 1
STYLES = {
    "identical": "green",
    "within noise": "green",
    "negligible": "green",
    "unresolved": "yellow",
    "drift": "red",
    "structural": "yellow",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, compare, positional={"a": "A", "b": "B"}, optional=["a", "b"])
    fleet = {"every entry of a registry instead of two calibrations": ("since", "firmware")}
    add_flags(parser, compare_fleet, groups=fleet, exclusive=[("since", "firmware")], without=["registry"])
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import out

    if arguments.since is not None or arguments.firmware is not None:
        if arguments.a is not None:
            arguments.parser.error(
                "expected either two calibrations A B, or --since REV, or --firmware OLD..NEW"
            )
        return _fleet(arguments)
    if arguments.b is None:
        arguments.parser.error("expected two calibrations A B, or --since REV, or --firmware OLD..NEW")
    found = call(compare, arguments)
    _say_written(arguments)
    if arguments.json:
        print_json(found)
    else:
        _show(out(arguments), found)
    return EXIT_ALARM if found.alarm else 0


PARAMETERS = (
    Column(name=""),
    Column(name="A", right=True),
    Column(name="± σ of A", rank=2, right=True),
    Column(name="B", right=True),
    Column(name="± σ of B", rank=2, right=True),
    Column(name="Δ", right=True),
    Column(name="Δ / σ", rank=1, right=True),
)


def _show(screen: Screen, found: DiffReport) -> None:
    """Show the inputs, the numbers, the reasons, the verdict, and finally what to do."""
    from calibrary.cli.console import plain, printable
    from calibrary.cli.tables import facts

    verdict = found.verdict.value
    for name, side in (("A", found.a), ("B", found.b)):
        screen.say(f"{name}  {plain(side.label)}", hang=3)
    for step in found.steps:
        screen.say(f"   [dim]{plain(step)}[/]")
    if found.numbers is not None:
        screen.say("")
        screen.show(_parameters(found.numbers, screen.width))
        screen.say("")
        screen.show(facts([(name, printable(text)) for name, text in _findings(found.numbers)], screen.width))
    if found.reasons:
        screen.say("")
    for reason in found.reasons:
        screen.say(plain(reason))
    for warning in found.warnings:
        screen.say(f"[yellow]{plain(warning)}[/]")
    kinds = ", ".join(one.kind.value for one in found.structural)
    screen.say("")
    badge = f"[bold {STYLES[verdict]}]{verdict}{f': {kinds}' if kinds else ''}[/]"
    attention = ", [red]needs attention[/]" if found.alarm else ""
    screen.say(f"{badge}{attention}. {plain(found.advice)}")


def _parameters(numbers: Difference, width: int) -> list[Text]:
    rows = []
    for row in numbers.parameters:
        in_px = row.name in {"fx", "fy", "cx", "cy", "skew"}
        form = "{:.3f}" if in_px else "{:.6g}"
        rows.append(
            (
                row.name,
                _cell(row.a, form),
                _cell(row.std_a, "{:.2g}"),
                _cell(row.b, form),
                _cell(row.std_b, "{:.2g}"),
                _cell(row.delta, "0" if not row.delta else "{:+.3f}" if in_px else "{:+.3g}"),
                _cell(row.z, "{:+.1f}"),
            )
        )
    return fitted(PARAMETERS, rows, width)


def _cell(value: float | None, form: str) -> str:
    return form.format(value) if value is not None else "–"


def _findings(numbers: Difference) -> list[tuple[str, str]]:
    from calibrary.jobs.diff.wording import length, percent, pixels

    seen, ground, found = numbers.projection, numbers.ground, numbers.significance
    return [
        ("focal length", f"{percent(numbers.focal_change)}; image scale {percent(numbers.scale_change)}"),
        (
            "projection",
            f"{pixels(seen.rms_px)} rms, {pixels(seen.max_px)} at most over the frame, "
            f"{pixels(seen.centre_rms_px)} in the centre; the camera turned by {round(seen.rotation_deg, 4):g}°",
        ),
        (
            "on the ground",
            f"from {ground.altitude_m:g} m (GSD {length(ground.gsd_cm / 100)}): {length(ground.rms_cm / 100)} rms, "
            f"{length(ground.max_cm / 100)} at most; heights {length(ground.height_cm / 100, signed=True)}",
        ),
        ("σ of A", found.spread_a),
        ("σ of B", found.spread_b),
    ]


def _fleet(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import note, out
    from calibrary.jobs.fleet import Fleet

    registry = Fleet.named(arguments.registry).registry
    with Bar(note(arguments), "comparing") as bar:
        found = call(compare_fleet, arguments, registry=registry, progress=bar)
    _say_written(arguments)
    if arguments.json:
        print_json(found)
    else:
        _show_fleet(out(arguments), found)
    return EXIT_ALARM if found.alarm else 0


def _say_written(arguments: argparse.Namespace) -> None:
    from calibrary.cli.console import note, plain

    if arguments.html is not None:
        note(arguments).say(plain(f"wrote {arguments.html}"))


CHANGES = (
    Column(name="entry"),
    Column(name="verdict", rank=1),
    Column(name="Δf / f", rank=2, right=True),
    Column(name="rms", rank=3, right=True),
    Column(name="reason", rank=4, wraps=True),
)


def _show_fleet(screen: Screen, found: FleetDiffReport) -> None:
    from collections import Counter

    from calibrary.cli.console import plain
    from calibrary.jobs.diff.wording import percent, pixels

    changes = found.changes
    if not changes:
        screen.say(plain(found.unmatched) if found.unmatched is not None else "no entry differs")
        return
    rows, verdicts = [], Counter[str]()
    for change in changes:
        # What is new or gone is no failure to compare.
        uncompared = "not compared" if change.alarm else change.reasons[0]
        verdict = change.verdict.value if change.verdict is not None else uncompared
        verdicts[verdict] += 1
        rows.append(
            (
                plain(change.id),
                f"[{STYLES.get(verdict, 'dim')}]{verdict}[/]",
                percent(change.focal_change) if change.focal_change is not None else "–",
                pixels(change.rms_px) if change.rms_px is not None else "–",
                plain(", ".join(change.structural) if verdict != "not compared" else change.reasons[0]),
            )
        )
    screen.show(fitted(CHANGES, rows, screen.width))
    counts = ", ".join(f"{number} {verdict}" for verdict, number in verdicts.items())
    alarms = sum(change.alarm for change in changes)
    judged = (
        f"[bold red]{alarms} need{'s' * (alarms == 1)} attention[/]"
        if alarms
        else "[bold green]nothing to do[/]"
    )
    screen.say("")
    screen.say(f"{judged}: {len(changes)} {'entry' if len(changes) == 1 else 'entries'}: {counts}")
