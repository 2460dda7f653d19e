"""``calibrary registry approve``: put entries to use, if the check finds no error."""

from __future__ import annotations

import argparse

from calibrary.cli.registry.deciding import add_deciding_flags, run_decision

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Put entries to use: all of those named, or none where the check objects to one."
EXAMPLES = """\
examples:
  calibrary registry approve fc6310r
  calibrary registry approve dji/fc6310r dji/fc330 --reason "checked over the test field"
  calibrary registry approve fc6310r --from onboard/dji-fc6310r       as 'calibrary onboard' proposed it
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_deciding_flags(parser, reason_required=False)
    parser.add_argument(
        "--from",
        dest="branch",
        metavar="BRANCH",
        help="take them from this branch, on which they are proposed, into the one that is used",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    return run_decision(arguments, "approved", branch=arguments.branch)
