"""``calibrary diff``: whether two calibrations of one camera differ by more than noise, and what changed."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.progress import Bar
from calibrary.cli.reading import add_reading_flags, reading_of
from calibrary.cli.registry.place import opened
from calibrary.cli.tables import Column, fitted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.text import Text

    from calibrary.cli.console import Screen
    from calibrary.jobs.diff.comparison import Comparison, Numbers
    from calibrary.jobs.diff.fleet import Change

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

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
  calibrary diff old.xml new.xml --html diff.html        and a page
  calibrary diff --since v1.0                            every entry that changed since, worst first
  calibrary diff --firmware 01.08..01.09                 every camera that was calibrated with both

exit code 1: the projections differ by 0.5 px rms, 1 px at most or 0.05 % of the focal length (a policy may state
other limits) and no measured uncertainty explains it; or the frame, the lens or a convention changed.
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
    parser.add_argument(
        "operands", nargs="*", metavar="A B", help="a file of any format, an image, or KEY[@REV]"
    )
    fleet = parser.add_mutually_exclusive_group()
    fleet.add_argument(
        "--since", metavar="REV", help="compare the registry with its state at a commit, tag or day"
    )
    fleet.add_argument(
        "--firmware", metavar="OLD..NEW", help="compare entries of one firmware with those of another"
    )
    parser.add_argument(
        "--registry", type=Path, metavar="PATH", help="see calibrary registry --help for the default"
    )
    parser.add_argument("--camera", type=int, metavar="N", help="which camera of a file with several, from 1")
    parser.add_argument(
        "--altitude-m",
        type=float,
        default=100.0,
        metavar="M",
        help="flying height for lengths on the ground (100)",
    )
    parser.add_argument(
        "--policy", default="fleet", metavar="NAME|FILE", help="policy with the limits for an alarm"
    )
    add_reading_flags(parser)
    add_json_flag(parser)
    parser.add_argument(
        "--html", type=Path, metavar="FILE", help="also write a page with maps of the difference"
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    wants_fleet = arguments.since is not None or arguments.firmware is not None
    if wants_fleet == bool(arguments.operands) or len(arguments.operands) not in {0, 2}:
        arguments.parser.error("expected two calibrations A B, or --since REV, or --firmware OLD..NEW")
    if not 0 < arguments.altitude_m < float("inf"):
        arguments.parser.error("--altitude-m: expected metres above ground, more than 0")
    if arguments.html is not None:
        from calibrary.api.pages import check_page_place

        check_page_place(arguments.html)
    return _fleet(arguments) if wants_fleet else _pair(arguments)


def _pair(arguments: argparse.Namespace) -> int:
    from calibrary.api.changes import compare_named
    from calibrary.cli.console import out

    reading = reading_of(arguments, camera=arguments.camera)
    first, second = arguments.operands
    change = compare_named(first, second, reading, registry=arguments.registry, policy=arguments.policy)
    if arguments.html is not None:
        _write(change.to_html(altitude_m=arguments.altitude_m), arguments)
    if arguments.json:
        print_json(change.to_dict(altitude_m=arguments.altitude_m))
    else:
        _show(out(arguments), change.comparison, change.labels, arguments.altitude_m)
    return EXIT_ALARM if change.alarm else 0


PARAMETERS = (
    Column(name=""),
    Column(name="A", right=True),
    Column(name="± σ of A", rank=2, right=True),
    Column(name="B", right=True),
    Column(name="± σ of B", rank=2, right=True),
    Column(name="Δ", right=True),
    Column(name="Δ / σ", rank=1, right=True),
)


def _show(screen: Screen, comparison: Comparison, labels: tuple[str, str], altitude_m: float) -> None:
    """Show the inputs, the numbers, the reasons, the verdict, and finally what to do."""
    from calibrary.cli.console import plain, printable
    from calibrary.cli.tables import facts

    verdict = comparison.verdict.value
    for name, label in zip("AB", labels, strict=True):
        screen.say(f"{name}  {plain(label)}", hang=3)
    for step in comparison.steps:
        screen.say(f"   [dim]{plain(step)}[/]")
    numbers = comparison.numbers
    if numbers is not None:
        screen.say("")
        screen.show(_parameters(numbers, screen.width))
        screen.say("")
        screen.show(
            facts([(name, printable(text)) for name, text in _findings(numbers, altitude_m)], screen.width)
        )
    if comparison.reasons:
        screen.say("")
    for reason in comparison.reasons:
        screen.say(plain(reason))
    for warning in comparison.warnings:
        screen.say(f"[yellow]{plain(warning)}[/]")
    kinds = ", ".join(one.kind.value for one in comparison.structural)
    screen.say("")
    badge = f"[bold {STYLES[verdict]}]{verdict}{f': {kinds}' if kinds else ''}[/]"
    attention = ", [red]needs attention[/]" if comparison.alarm else ""
    screen.say(f"{badge}{attention}. {plain(comparison.advice)}")


def _parameters(numbers: Numbers, width: int) -> list[Text]:
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


def _findings(numbers: Numbers, altitude_m: float) -> list[tuple[str, str]]:
    from calibrary.api.changes import length, percent, pixels

    seen, ground = numbers.difference, numbers.ground(altitude_m)
    return [
        ("focal length", f"{percent(numbers.focal_change)}; image scale {percent(numbers.scale.change)}"),
        (
            "projection",
            f"{pixels(seen.rms_px)} rms, {pixels(seen.max_px)} at most over the frame, "
            f"{pixels(seen.centre_rms_px)} in the centre; the camera turned by {round(seen.rotation_deg, 4):g}°",
        ),
        (
            "on the ground",
            f"from {altitude_m:g} m (GSD {length(ground.gsd_cm / 100)}): {length(ground.rms_cm / 100)} rms, "
            f"{length(ground.max_cm / 100)} at most; heights {length(ground.height_cm / 100, signed=True)}",
        ),
        ("σ of A", numbers.spread_a.source),
        ("σ of B", numbers.spread_b.source),
    ]


def _fleet(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import note, out

    registry = opened(arguments)
    with Bar(note(arguments), "comparing") as bar:
        if arguments.since is not None:
            found = registry.changes_since(arguments.since, policy=arguments.policy, progress=bar)
        else:
            old, dots, new = arguments.firmware.partition("..")
            if not (old and dots and new):
                arguments.parser.error("--firmware: expected OLD..NEW, such as 01.08..01.09")
            found = registry.changes_of_firmware(old, new, policy=arguments.policy, progress=bar)
    if arguments.html is not None:
        _write(found.to_html(altitude_m=arguments.altitude_m), arguments)
    if arguments.json:
        print_json(found.to_dict())
    else:
        _show_fleet(out(arguments), found.changes)
    return EXIT_ALARM if found.alarm else 0


def _write(html: str, arguments: argparse.Namespace) -> None:
    from calibrary.api.pages import write_page
    from calibrary.cli.console import note, plain

    write_page(arguments.html, html)
    note(arguments).say(plain(f"wrote {arguments.html}"))


CHANGES = (
    Column(name="entry"),
    Column(name="verdict", rank=1),
    Column(name="Δf / f", rank=2, right=True),
    Column(name="rms", rank=3, right=True),
    Column(name="reason", rank=4, wraps=True),
)


def _show_fleet(screen: Screen, changes: Sequence[Change]) -> None:
    from collections import Counter

    from calibrary.api.changes import percent, pixels
    from calibrary.cli.console import plain

    if not changes:
        screen.say("no entry differs")
        return
    rows, verdicts = [], Counter[str]()
    for change in changes:
        found = change.comparison
        numbers = found.numbers if found is not None else None
        verdict = found.verdict.value if found is not None else "not compared"
        verdicts[verdict] += 1
        why = (
            ", ".join(one.kind.value for one in found.structural)
            if found is not None
            else change.reason or ""
        )
        rows.append(
            (
                plain(change.id),
                f"[{STYLES.get(verdict, 'dim')}]{verdict}[/]",
                percent(numbers.focal_change) if numbers is not None else "–",
                pixels(numbers.difference.rms_px) if numbers is not None else "–",
                plain(why),
            )
        )
    screen.show(fitted(CHANGES, rows, screen.width))
    counts = ", ".join(f"{number} {verdict}" for verdict, number in verdicts.items())
    alarms = sum(change.alarm for change in changes)
    judged = f"[bold red]{alarms} need attention[/]" if alarms else "[bold green]nothing to do[/]"
    screen.say("")
    screen.say(f"{judged}: {len(changes)} {'entry' if len(changes) == 1 else 'entries'}: {counts}")
