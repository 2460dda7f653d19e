"""``calibrary registry retire``: stop using entries, with a reason."""

from __future__ import annotations

import argparse

from calibrary.cli.commands import add_json_flag
from calibrary.cli.flags import add_flags, call
from calibrary.cli.registry import add_registry_flag, opened
from calibrary.cli.registry.changes import decide
from calibrary.jobs.fleet import Fleet

DESCRIPTION = "Stop using entries. Their files and history stay."
EXAMPLES = """\
examples:
  calibrary registry retire fc6310r --reason "lens was replaced"
  calibrary registry retire fc6310r --reason "sold" --from 2026-10-01    flights before that day keep their K
  calibrary registry retire fc6310r/5472 --reason "new frame" --superseded-by fc6310r/4864
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(
        parser,
        Fleet.propose_retirement,
        positional={"keys": "KEY"},
        spelled={"start": "--from", "digests": "--digest"},
    )
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    return decide(arguments, call(opened(arguments).propose_retirement, arguments), "retired")
