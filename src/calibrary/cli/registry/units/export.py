"""``calibrary registry units export``: export the units as a table for a spreadsheet."""

from __future__ import annotations

import argparse
from pathlib import Path

from calibrary.cli.registry.list_ import CONDITIONS, add_where_flag
from calibrary.cli.registry.place import add_registry_flag, opened

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Write the units as CSV, one row for each entry: their names, their cameras and their K."
EXAMPLES = f"""\
examples:
  calibrary registry units export fleet.csv
  calibrary registry units export fleet.csv --excel               for Excel with a decimal comma
  calibrary registry units export survey.csv --where tags=survey

You may edit label, tags and notes and import them again; the other columns are for reading. No cell is a formula.

{CONDITIONS}"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("file", type=Path, metavar="FILE.csv", help="the table to write")
    add_where_flag(parser)
    parser.add_argument(
        "--excel",
        action="store_true",
        help="write semicolons, decimal commas and a byte order mark, as Excel reads them",
    )
    add_registry_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, plain

    count = opened(arguments).export_units(arguments.file, where=arguments.where, excel=arguments.excel)
    note(arguments).say(
        f"wrote {'1 entry' if count == 1 else f'{count} entries'} to {plain(str(arguments.file))}"
    )
    return 0
