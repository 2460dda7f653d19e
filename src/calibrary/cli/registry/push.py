"""``calibrary registry push``: send the local commits to the shared registry."""

from __future__ import annotations

import argparse

from calibrary.cli.registry.sync import declare, show_pushed, synced
from calibrary.jobs.fleet import Fleet

DESCRIPTION = "Send your commits to a remote; the command never overwrites the commits of others."
EXAMPLES = """\
examples:
  calibrary registry push
  calibrary registry push git@example.com:fleet.git      the first time: saved as origin
  calibrary registry push --propose                      as a branch for review, if main is protected

The command adds commits to the remote's state as last seen. If the remote has newer commits, pull first (exit code 4).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    declare(parser, Fleet.push)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    return synced(arguments, "pushing to", Fleet.push, [show_pushed])
