"""What approve, hold and retire share: entries named by KEY get a status, checked before it is written."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

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
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")


def run_decision(
    arguments: argparse.Namespace, status: Status, verb: str, successor: str | None = None
) -> int:
    """Show what changes, write it, and tell the commit; 1 where the check objects."""
    from calibrary.cli.console import make_console
    from calibrary.cli.registry.changes import (
        EntryChange,
        print_document,
        show_changes,
        show_findings,
        tell_written,
    )
    from calibrary.keep.admission import stands_against
    from calibrary.keep.standing import decide, decide_from, write_decisions

    keeper, note = opened(arguments), make_console(stderr=True)
    branch: str | None = getattr(arguments, "branch", None)
    if branch is not None:
        decisions, findings = decide_from(keeper, arguments.keys, branch, status, arguments.reason)
    else:
        decisions, findings = decide(keeper, arguments.keys, status, arguments.reason, successor)
    changed = [
        EntryChange(
            entry=one.entry,
            standing=one.standing,
            is_new=one.base is None,
            changes=one.changes,
            remarks=() if one.changes else (f"it is {one.entry.status.value} already",),
        )
        for one in decisions
    ]
    show_changes(note, changed)
    show_findings(note, findings)
    written, code = None, 0
    due = [one for one in decisions if one.changes]
    if stands_against(findings):
        note.print("nothing was written: put the errors right first", highlight=False, soft_wrap=True)
        code = EXIT_REFUSED
    elif due:
        written = write_decisions(keeper, decisions, status, arguments.reason)
        tell_written(note, written, verb, len(due))
    if arguments.json:
        print_document(keeper, changed, findings, written)
    return code
