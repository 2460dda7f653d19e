"""``calibrary registry retire``: stop using entries, with a reason."""

from __future__ import annotations

import argparse

from calibrary.cli.registry.deciding import add_deciding_flags, run_decision

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Stop using entries. Their files and history stay."
EXAMPLES = """\
examples:
  calibrary registry retire fc6310r --reason "lens was replaced"
  calibrary registry retire fc6310r/5472 --reason "new frame" --superseded-by fc6310r/4864
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_deciding_flags(parser, reason_required=True)
    parser.add_argument(
        "--superseded-by", metavar="KEY", help="the entry that replaces it; that entry records this"
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    return run_decision(arguments, "retired", successor=arguments.superseded_by)
