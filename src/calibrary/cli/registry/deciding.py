"""Shared by approve, hold and retire: set the status of entries named by KEY, checked before writing."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from datetime import date
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.place import add_registry_flag, opened

if TYPE_CHECKING:
    from calibrary.jobs.fleet.changes import ProposedChange
    from calibrary.registry.entry import Validity

__all__ = [
    "add_deciding_flags",
    "add_force_flag",
    "add_validity_flags",
    "day",
    "decide",
    "force_of",
    "run_decision",
    "validity_of",
]

EXIT_REFUSED = 1


def add_deciding_flags(parser: argparse.ArgumentParser, *, reason_required: bool) -> None:
    """Add ``KEY…``, ``--reason``, ``--registry`` and ``--json``."""
    parser.add_argument(
        "keys", nargs="+", metavar="KEY", help="make/model[/variant], as short as it is unambiguous"
    )
    parser.add_argument(
        "--reason", required=reason_required, metavar="TEXT", help="reason; kept in the entry and its history"
    )
    add_registry_flag(parser)
    add_json_flag(parser)


def add_force_flag(parser: argparse.ArgumentParser) -> None:
    """Add ``--force``."""
    parser.add_argument(
        "--force",
        action="store_true",
        help="accept a K that contradicts what is known of its camera; needs --reason, which stays visible",
    )


def add_validity_flags(parser: argparse.ArgumentParser) -> None:
    """Add ``--valid-from`` and ``--valid-until``."""
    for name, what in (("from", "first"), ("until", "last")):
        parser.add_argument(
            f"--valid-{name}",
            type=day,
            metavar="DATE",
            help=f"{what} day of images for which this K is valid",
        )


def validity_of(arguments: argparse.Namespace) -> Validity | None:
    """The stated validity period; None if no date was stated."""
    from calibrary.jobs.fleet.changes import validity

    first, last = arguments.valid_from, arguments.valid_until
    if first is not None and last is not None and last < first:
        arguments.parser.error("--valid-until: expected a day after --valid-from")
    return validity(first, last)


def day(text: str) -> date:
    """Parse a date in ISO 8601."""
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a day such as 2026-05-01") from None


def force_of(arguments: argparse.Namespace) -> str | None:
    """Reason for overriding a contradiction; None if none is overridden."""
    if not arguments.force:
        return None
    if not arguments.reason:
        arguments.parser.error("--force goes with --reason TEXT, which stays with the entry")
    return str(arguments.reason)


def run_decision(arguments: argparse.Namespace, status: str, *, successor: str | None = None) -> int:
    """Hold or retire entries; returns 1 if the check finds an error."""
    change = opened(arguments).propose_status(
        arguments.keys, status, reason=arguments.reason, successor=successor
    )
    return decide(arguments, change, status)


def decide(
    arguments: argparse.Namespace,
    change: ProposedChange,
    status: str,
    *,
    is_agreed: Callable[[argparse.Namespace, ProposedChange], bool] = lambda *_: True,
    as_table: bool = False,
) -> int:
    """Show a change, write it if the user agrees, and show the commit; returns 1 if the check finds an error.

    Args:
        arguments: of the command.
        change: the change to show and write.
        status: new status of the entries, or the name of the action.
        is_agreed: asks whether to write it.
        as_table: show the changes of all entries in one table; suits few fields of many entries.
    """
    from calibrary.cli.console import errors, out
    from calibrary.cli.registry.changes import (
        show_changes,
        show_differences,
        show_edits,
        show_findings,
        show_written,
    )

    screen, proposals, code = out(arguments), change.proposals, 0
    (show_edits if as_table else show_changes)(screen, proposals.items)
    show_differences(screen, change)
    show_findings(screen, proposals.findings)
    if proposals.errors:
        errors().say("nothing was written: put the errors right first")
        code = EXIT_REFUSED
    elif proposals.due and is_agreed(arguments, change):
        written = change.write(arguments.reason)
        is_used = bool(written.paths)
        show_written(
            screen, written, status if is_used else "approved, with others to follow,", len(proposals.due)
        )
    elif proposals.due:
        screen.say("nothing was written")
    elif as_table:
        screen.say("nothing to change: the registry says all of it already")
    if arguments.json:
        print_json(change.to_dict())
    return code
