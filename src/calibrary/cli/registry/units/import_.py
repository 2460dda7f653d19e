"""``calibrary registry units import``: import labels, tags and notes from a table, as one commit."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.asking import add_yes_flag, agreed, deciding_screen
from calibrary.cli.registry.place import add_registry_flag, opened

if TYPE_CHECKING:
    from calibrary.jobs.fleet.units import UnitsChange

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = (
    "Import labels, tags and notes from a table, in one commit; the command first shows what changes."
)
EXAMPLES = """\
examples:
  calibrary registry units import fleet.csv --dry-run
  calibrary registry units import fleet.csv --yes --reason "names of the 2026 season"

The table is one that 'units export' wrote and any spreadsheet saved, or your own table with the columns serial and
label. Commas, semicolons or tabs separate its cells; it may have decimal commas and a byte order mark.
A colleague's change since the export stays; a row in which both of you changed one cell is refused. If a row is wrong,
nothing is written (exit code 1).
"""

EXIT_REFUSED = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("file", type=Path, metavar="FILE.csv", help="the table")
    parser.add_argument("--dry-run", action="store_true", help="show what would change, and write nothing")
    parser.add_argument("--reason", metavar="TEXT", help="why, for the history")
    add_registry_flag(parser)
    add_yes_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import errors, note, plain
    from calibrary.cli.registry.changes import show_edits, show_findings, show_written

    change, screen = opened(arguments).import_units(arguments.file), deciding_screen(arguments)
    proposals, code = change.found.proposals, 0
    show_edits(screen, proposals.due)
    show_findings(screen, proposals.findings)
    for remark in change.found.remarks:
        note(arguments).say(plain(remark))
    if change.found.problems:
        _show_problems(change)
        code = EXIT_REFUSED
    elif not proposals.due:
        screen.say("nothing to change: the registry says all of it already")
    elif not arguments.dry_run and agreed(arguments, f"Change these {len(proposals.due)} entries?"):
        show_written(screen, change.write(arguments.reason), "changed", len(proposals.due))
    else:
        errors().say("nothing was written")
    if arguments.json:
        print_json(change.to_dict())
    return code


def _show_problems(change: UnitsChange) -> None:
    from calibrary.cli.console import errors, plain

    for one in change.found.problems:
        where = f"line {one.line}" if one.line else "registry"
        errors().say(f"[red]{where}[/] {plain(one.entry)}: {plain(one.message)}")
    errors().say("nothing was written: put these rows right first")
