"""``calibrary registry units``: export and import the units as a table for a spreadsheet."""

from __future__ import annotations

import argparse

from calibrary.cli.commands import Command, add_commands

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments"]

DESCRIPTION = "The units of the registry as a table: exported for a spreadsheet, and imported from it."
EXAMPLES = """\
examples:
  calibrary registry units export fleet.csv
  calibrary registry units import fleet.csv --dry-run
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the commands."""
    listed = (
        Command("export", "write the table", f"{__name__}.export"),
        Command("import", "take labels, tags and notes from it, as one commit", f"{__name__}.import_"),
    )
    add_commands(parser, listed, title="commands")
