"""What approve, hold and retire share: entries named by KEY get a status, checked before it is written."""

from __future__ import annotations

import argparse

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.place import add_registry_flag, opened

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
    arguments: argparse.Namespace, status: str, *, branch: str | None = None, successor: str | None = None
) -> int:
    """Show what changes, write it, and show the commit; 1 where the check finds an error."""
    from calibrary.cli.console import errors, out
    from calibrary.cli.registry.changes import show_changes, show_findings, show_written

    screen = out(arguments)
    change = opened(arguments).propose_status(
        arguments.keys, status, reason=arguments.reason, branch=branch, successor=successor
    )
    proposals, code = change.proposals, 0
    show_changes(screen, proposals.items)
    show_findings(screen, proposals.findings)
    if proposals.errors:
        errors().say("nothing was written: put the errors right first")
        code = EXIT_REFUSED
    elif proposals.due:
        show_written(screen, change.write(arguments.reason), status, len(proposals.due))
    if arguments.json:
        print_json(change.to_dict())
    return code
