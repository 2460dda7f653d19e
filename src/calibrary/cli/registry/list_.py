"""``calibrary registry list``: the cameras of the fleet."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.place import add_registry_flag, opened
from calibrary.cli.tables import Column, fitted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibrary.cli.console import Screen
    from calibrary.registry.snapshot import StoredEntry

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "List the cameras of the fleet, one row an entry."
EXAMPLES = """\
examples:
  calibrary registry list
  calibrary registry list dji --status approved
  calibrary registry list --at 2026-05-01 --json
"""


EXIT_UNREADABLE = 1
GRADES = ("calibrated", "adjusted", "design", "derived")
"""Those of an entry: the metric ones of :class:`calibrary.calibration.Grade`, without what that module loads."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("words", nargs="*", metavar="WORD", help="only entries whose id holds every word")
    parser.add_argument(
        "--status",
        action="append",
        choices=("draft", "approved", "held", "retired"),
        help="only entries of this status; may be given several times",
    )
    parser.add_argument(
        "--grade",
        action="append",
        choices=GRADES,
        help="only entries of this grade; may be given several times",
    )
    parser.add_argument("--at", metavar="REV", help="as it was at a commit, tag, branch or day")
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import errors, note, out, plain

    found = opened(arguments, arguments.at).listing(
        arguments.words, statuses=arguments.status or (), grades=arguments.grade or ()
    )
    if arguments.json:
        print_json(found.to_dict())
    else:
        _show(out(arguments), found.entries)
        if not found.entries and not found.unreadable:
            note(arguments).say("no entry fits; 'calibrary registry add FILE' puts one in")
    for error in found.unreadable:
        errors().say(f"[red]not listed[/] {plain(str(error))}")
    return EXIT_UNREADABLE if found.unreadable else 0


COLUMNS = (
    Column(name="entry"),
    Column(name="status", rank=1),
    Column(name="grade", rank=3),
    Column(name="fx px", rank=2, right=True),
    Column(name="cx px", rank=6, right=True),
    Column(name="cy px", rank=6, right=True),
    Column(name="distortion", rank=5),
    Column(name="made on", rank=4),
)
STYLES = {"approved": "green", "held": "cyan", "draft": "yellow", "retired": "dim"}


def _show(screen: Screen, listed: Sequence[StoredEntry]) -> None:
    from calibrary.cli.console import plain

    rows = []
    for stored in listed:
        calibration, status = stored.entry.calibration, stored.entry.status.value
        state = "proposed" if stored.is_pending else status
        state += ", proposal pending" if stored.proposal is not None else ""
        K = calibration.intrinsics
        rows.append(
            (
                plain(stored.id),
                f"[{STYLES[status]}]{state}[/]",
                calibration.grade.value,
                f"{K.fx:.2f}",
                f"{K.cx:.2f}",
                f"{K.cy:.2f}",
                calibration.distortion.model if calibration.distortion is not None else "unknown",
                plain(calibration.provenance.date or ""),
            )
        )
    if rows:
        screen.show(fitted(COLUMNS, rows, screen.width))
