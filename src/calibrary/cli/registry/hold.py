"""``calibrary registry hold``: pin entries, so that they are not replaced without an explicit override."""

from __future__ import annotations

import argparse

from calibrary.cli.registry.deciding import add_deciding_flags, run_decision

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Use entries and pin them: nothing replaces them without --override-held."
EXAMPLES = """\
examples:
  calibrary registry hold fc6310r --reason "agreed with the surveyor for 2026"
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_deciding_flags(parser, reason_required=True)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    return run_decision(arguments, "held")
