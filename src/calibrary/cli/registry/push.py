"""``calibrary registry push``: what we have written, for others."""

from __future__ import annotations

import argparse
import json
import sys

from calibrary.cli.registry.place import add_registry_flag, opened
from calibrary.cli.registry.pull import tell_noted

__all__ = ["add_parser"]

EXAMPLES = """\
examples:
  calibrary registry push
  calibrary registry push git@example.com:fleet.git      the first time: noted as origin

Only forward, and only from where the remote was last seen; if it has moved on, pull first (exit code 4).
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = subparsers.add_parser(
        "push",
        help="give others what was written here",
        description="Give a remote what was written here; nothing of theirs is ever overwritten.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "remote", nargs="?", metavar="REMOTE", help="a remote's name or address (default: origin)"
    )
    add_registry_flag(parser)
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import make_console
    from calibrary.registry.sync import remote_named, sync_json

    note, registry = make_console(stderr=True), opened(arguments)
    remote, noted = remote_named(registry.repo, arguments.remote)
    tell_noted(note, remote, noted)
    with note.status(f"pushing to {remote}"):
        commit = registry.push(remote)
    note.print(f"{remote} and here stand at {commit[:12]}", highlight=False, markup=False, soft_wrap=True)
    if arguments.json:
        document = sync_json(remote, None, commit)
        sys.stdout.write(json.dumps(document, indent=2, ensure_ascii=True, allow_nan=False) + "\n")
    return 0
