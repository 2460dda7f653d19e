"""``calibrary registry hold``: pin entries, so that they are not replaced without an explicit override."""

from __future__ import annotations

import argparse

from calibrary.cli.commands import add_json_flag
from calibrary.cli.flags import add_flags, call
from calibrary.cli.registry import add_registry_flag, opened
from calibrary.cli.registry.changes import decide
from calibrary.jobs.fleet import Fleet

DESCRIPTION = "Use entries and pin them: nothing replaces them without --force."
EXAMPLES = """\
examples:
  calibrary registry hold fc6310r --reason "agreed with the surveyor for 2026"
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, Fleet.propose_hold, positional={"keys": "KEY"}, spelled={"digests": "--digest"})
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    return decide(arguments, call(opened(arguments).propose_hold, arguments), "held")
