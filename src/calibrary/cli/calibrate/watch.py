"""``calibrary calibrate watch``: evaluate each frame as it arrives, while the board is still in place."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.flags import add_flags, call
from calibrary.jobs.calibrate_watch import watch

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.calibrate_watch.session import WatchStatus

DESCRIPTION = """\
Watch a folder in which frames of a board arrive, from a tethered camera or a card reader. After each frame the
command reports whether it found the board, how much of the frame is covered, the standard deviations so far, and which
pose to photograph next: the one that lowers the largest standard deviation over the frame most. It ends when the
calibration passes. Ctrl-C ends it earlier; run it again to read the frames and continue.
"""
EXAMPLES = """\
examples:
  calibrary calibrate watch DCIM/ --board checkerboard:11x8
  calibrary calibrate watch DCIM/ --board checkerboard:11x8 --html watch.html
  calibrary calibrate watch DCIM/ --board checkerboard:11x8 --once --json

exit codes: 0 the calibration passes; 1 not yet
"""
EXIT_NOT_YET = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, watch, positional={"folder": "DIR"})
    parser.add_argument(
        "--json",
        action="store_true",
        help="print one JSON document a line (schemas/calibrate-watch-1.schema.json)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the command: watch the folder and show results; returns the exit code."""
    from calibrary.cli.commands import print_json
    from calibrary.cli.console import out

    screen, done = out(arguments), False
    statuses = call(watch, arguments)
    try:
        for status in statuses:
            done = status.done
            if arguments.json:
                print_json(status, indent=None)
            else:
                _show(screen, status)
    except KeyboardInterrupt:
        if not arguments.json:
            screen.say("stopped; the frames are kept: the same command goes on from them")
    return 0 if done else EXIT_NOT_YET


def _show(screen: Screen, status: WatchStatus) -> None:
    from calibrary.cli.console import plain
    from calibrary.jobs.calibrate_watch.page import facts

    for frame in status.new:
        found = f"{frame.corners} corners" if frame.corners else "[yellow]does not count[/]"
        why = f": {plain('; '.join(frame.remarks))}" if frame.remarks else ""
        screen.say(f"{plain(frame.name)}  {found}{why}")
    said = ", ".join(f"{name} {value}" for name, value in facts(status))
    screen.say(f"  {status.views} of {status.frames} frames count; {plain(said)}")
    if status.done:
        screen.say("[bold green]FIXED[/] is in reach: calibrate from these frames")
        return
    for reason in status.missing[:3]:
        screen.say(f"  [yellow]missing[/]  {plain(reason)}")
    if status.next is not None:
        from calibrary.probability import two_digits

        screen.say(
            f"  [bold]next[/]  {plain(str(status.next))}: the largest σ over the frame is then expected at "
            f"{two_digits(status.next.edge_px)} px, {status.next.gain:.0%} less"
        )
