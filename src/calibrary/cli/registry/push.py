"""``calibrary registry push``: send the local commits to the shared registry."""

from __future__ import annotations

import argparse

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.place import add_registry_flag, opened
from calibrary.cli.registry.pull import show_noted

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Send your commits to a remote; the command never overwrites the commits of others."
EXAMPLES = """\
examples:
  calibrary registry push
  calibrary registry push git@example.com:fleet.git      the first time: saved as origin

The command adds commits to the remote's state as last seen. If the remote has newer commits, pull first (exit code 4).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "remote", nargs="?", metavar="REMOTE", help="a remote's name or address (default: origin)"
    )
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out, plain
    from calibrary.jobs.fleet.changes import sync_report

    remarks, registry = note(arguments), opened(arguments)
    remote, noted = registry.remote_named(arguments.remote)
    show_noted(remarks, remote, noted)
    with remarks.status(f"pushing to {remote}"):
        commit = registry.push(remote)
    out(arguments).say(plain(f"{remote} and this registry are at {commit[:12]}"))
    if arguments.json:
        print_json(sync_report(remote, None, commit))
    return 0
