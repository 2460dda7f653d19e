"""``calibrary registry retire``: stop using entries, with a reason."""

from __future__ import annotations

import argparse

from calibrary.cli.flags import call
from calibrary.cli.registry import OfRegistry, opened
from calibrary.cli.registry.changes import decide
from calibrary.jobs.fleet import Fleet

DESCRIPTION = "Stop using entries. Their files and history stay."
EXAMPLES = """\
examples:
  calibrary registry retire fc6310r --reason "lens was replaced"
  calibrary registry retire fc6310r --reason "sold" --from 2026-10-01    flights before that day keep their K
  calibrary registry retire fc6310r@proposed --reason "blurred"          it is not proposed any more
  calibrary registry retire fc6310r/5472 --reason "new frame" --superseded-by fc6310r/4864
"""


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    return decide(arguments, call(opened(arguments).propose_retirement, arguments))


COMMAND = OfRegistry(
    Fleet.propose_retirement,
    DESCRIPTION,
    EXAMPLES,
    run=run,
    positional={"keys": "KEY"},
    spelled={"start": "--from", "digests": "--digest"},
)
