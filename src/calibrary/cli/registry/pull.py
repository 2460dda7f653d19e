"""``calibrary registry pull``: fetch the commits of others and put the local ones on top."""

from __future__ import annotations

import argparse

from calibrary.cli.registry.sync import declare, show_pulled, synced
from calibrary.jobs.fleet import Fleet

DESCRIPTION = "Fetch the commits of others, and apply your own commits on top of them."
EXAMPLES = """\
examples:
  calibrary registry pull
  calibrary registry pull backup
  calibrary registry pull --theirs dji/fc6310r --ours sony/dsc-rx1rm2       if both changed an entry
  calibrary registry pull --theirs all

Your commits are repeated on top of theirs, entry by entry. Labels, tags and notes of both sides come together; all else
of an entry is one side's, so that no K is ever mixed from two. If both sides changed that, nothing is changed until you
have decided each entry (exit code 4). So it is if the remote was rewritten and lost commits that you have: --removed
drop gives them up, --removed keep makes them again.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    declare(parser, Fleet.pull)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    return synced(arguments, "pulling from", Fleet.pull, [show_pulled])
