"""``calibrary registry list``: the cameras of the fleet."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

from calibrary.cli.registry.place import add_registry_flag, opened

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from calibrary.errors import RegistryError
    from calibrary.registry.snapshot import StoredEntry

__all__ = ["add_parser"]

EXAMPLES = """\
examples:
  calibrary registry list
  calibrary registry list dji --status approved
  calibrary registry list --at 2026-05-01 --json
"""


EXIT_UNREADABLE = 1


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    from calibrary.calibration import Grade

    parser = subparsers.add_parser(
        "list",
        help="list the cameras of the fleet",
        description="List the cameras of the fleet, one row an entry.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("words", nargs="*", metavar="WORD", help="only entries whose id holds every word")
    parser.add_argument(
        "--status",
        action="append",
        choices=("draft", "approved", "held", "retired"),
        help="only entries of this status; may be given several times",
    )
    parser.add_argument(
        "--grade",
        action="append",
        choices=[grade.value for grade in Grade if grade.is_metric],
        help="only entries of this grade; may be given several times",
    )
    parser.add_argument("--at", metavar="REV", help="as it was at a commit, tag, branch or day")
    add_registry_flag(parser)
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import make_console, plain
    from calibrary.registry.entry_json import stored_json

    snapshot, note = opened(arguments).snapshot(arguments.at), make_console(stderr=True)
    words = [word.lower() for word in arguments.words]
    unreadable: list[RegistryError] = []
    listed = [
        stored
        for stored in snapshot.entries(unreadable=unreadable.append)
        if all(word in stored.id for word in words)
        and (not arguments.status or stored.entry.status.value in arguments.status)
        and (not arguments.grade or stored.entry.calibration.grade.value in arguments.grade)
    ]
    if arguments.json:
        document = {
            "schema": "calibrary/entry-listing-1",
            "entries": [stored_json(stored) for stored in listed],
        }
        sys.stdout.write(json.dumps(document, indent=2, ensure_ascii=True, allow_nan=False) + "\n")
    else:
        _show(make_console(stderr=False), listed)
        if not listed and not unreadable:
            told = "no entry fits; 'calibrary registry add FILE' puts one in"
            note.print(told, highlight=False, soft_wrap=True)
    for error in unreadable:
        note.print(f"[red]not listed[/] {plain(str(error))}", highlight=False, soft_wrap=True)
    return EXIT_UNREADABLE if unreadable else 0


def _show(console: Console, listed: Sequence[StoredEntry]) -> None:
    from rich.table import Table

    from calibrary.cli.console import plain

    if not listed:
        return
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("entry", overflow="fold")
    table.add_column("status")
    table.add_column("grade")
    for name in ("fx px", "cx px", "cy px"):
        table.add_column(name, justify="right")
    table.add_column("distortion")
    table.add_column("made on")
    styles = {"approved": "green", "held": "cyan", "draft": "yellow", "retired": "dim"}
    for stored in listed:
        calibration, status = stored.entry.calibration, stored.entry.status.value
        K = calibration.intrinsics
        table.add_row(
            plain(stored.id),
            f"[{styles[status]}]{status}[/]",
            calibration.grade.value,
            f"{K.fx:.2f}",
            f"{K.cx:.2f}",
            f"{K.cy:.2f}",
            calibration.distortion.model if calibration.distortion is not None else "unknown",
            plain((calibration.provenance.date or "")[:10]),
        )
    console.print(table)
