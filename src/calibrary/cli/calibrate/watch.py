"""``calibrary calibrate watch``: evaluate each frame as it arrives, while the board is still in place."""

from __future__ import annotations

import argparse

from calibrary.cli.flags import call
from calibrary.cli.shown import Shown
from calibrary.jobs.calibrate_watch import watch

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


def run(arguments: argparse.Namespace) -> int:
    """Run the command: watch the folder and show results; returns the exit code."""
    from calibrary.cli.commands import print_json
    from calibrary.cli.console import out
    from calibrary.cli.terminal import show
    from calibrary.view import view_of

    screen, done = out(arguments), False
    try:
        for status in call(watch, arguments):
            done = status.done
            if arguments.json:
                print_json(status, indent=None)
            else:
                show(screen, view_of(status))
    except KeyboardInterrupt:
        screen.say("stopped; the frames are kept: the same command goes on from them")
    return 0 if done else EXIT_NOT_YET


COMMAND = Shown(
    watch,
    DESCRIPTION,
    EXAMPLES,
    run=run,
    positional={"folder": "DIR"},
    switches={"--json": "print one JSON document a line (schemas/calibrate-watch-1.schema.json)"},
    json=False,
)
