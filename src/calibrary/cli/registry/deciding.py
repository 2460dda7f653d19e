"""What approve, hold and retire share: entries named by KEY get a status, checked before it is written."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.place import add_registry_flag, opened

if TYPE_CHECKING:
    from calibrary.registry.entry import Status

__all__ = ["add_deciding_flags", "run_decision"]

EXIT_REFUSED = 1


def add_deciding_flags(parser: argparse.ArgumentParser, *, reason_required: bool) -> None:
    """Add ``KEY…``, ``--reason``, ``--registry`` and ``--json``."""
    parser.add_argument(
        "keys", nargs="+", metavar="KEY", help="make/model[/variant], as short as it is unambiguous"
    )
    parser.add_argument(
        "--reason", required=reason_required, metavar="TEXT", help="why; kept in the entry and its history"
    )
    add_registry_flag(parser)
    add_json_flag(parser)


def run_decision(
    arguments: argparse.Namespace, status: Status, verb: str, successor: str | None = None
) -> int:
    """Show what changes, write it, and tell the commit; 1 where the check objects."""
    from calibrary.cli.console import errors, out
    from calibrary.cli.registry.changes import show_changes, show_findings, tell_written
    from calibrary.registry.proposals import change_report

    registry, screen = opened(arguments), out(arguments)
    branch: str | None = getattr(arguments, "branch", None)
    proposals = registry.propose_status(
        arguments.keys, status, arguments.reason, branch=branch, successor=successor
    )
    show_changes(screen, proposals.items)
    show_findings(screen, proposals.findings)
    written, code = None, 0
    if proposals.errors:
        errors().say("nothing was written: put the errors right first")
        code = EXIT_REFUSED
    elif proposals.due:
        written = registry.save(proposals, reason=arguments.reason)
        tell_written(screen, written, verb, len(proposals.due))
    if arguments.json:
        print_json(change_report(registry.repo.path, proposals, written))
    return code
