"""``calibrary registry show``: show an entry, now or at a revision, or the changes between the two."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from calibrary.cli.commands import print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.registry import add_registry_flag, note_cut, opened
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibrary.cli.console import Screen
    from calibrary.jobs.fleet import Approval, FieldChange, Recorded, ShownEntry

DESCRIPTION = "Show one entry, as it is or as it was."
EXAMPLES = """\
examples:
  calibrary registry show dji/fc6310r
  calibrary registry show proposals/dji/fc6310r         what is proposed to replace it
  calibrary registry show fc6310r@2026-05-01            as it was at the end of that day
  calibrary registry show fc6310r@firmware:01.09        as it was made for that firmware
  calibrary registry show fc6310r --diff v2026.1        what changed since that tag
  calibrary registry show fc6310r --yaml                the file itself
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(
        parser,
        Fleet.show,
        positional={"key": "KEY[@REV]"},
        spelled={"against": "--diff"},
    )
    add_registry_flag(parser)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print one JSON document on standard output")
    form.add_argument("--yaml", action="store_true", help="print the file of the entry")


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    if arguments.against is not None and arguments.yaml:
        arguments.parser.error("--diff: not together with --yaml; git diff compares files")
    return _show(arguments)


def _show(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import out, plain
    from calibrary.cli.registry.changes import change_table

    registry = opened(arguments)
    shown = call(registry.show, arguments)
    if arguments.json:
        print_json(shown)
    elif arguments.yaml:
        sys.stdout.buffer.write(registry.file(shown))
    elif shown.against is None or shown.changes is None:
        _describe(out(arguments), shown)
        note_cut(arguments, registry)
    else:
        screen = out(arguments)
        screen.say(_summary(plain(arguments.key), plain(shown.against), shown.changes))
        if shown.changes:
            screen.show(change_table(shown.changes, screen.width))
    return 0


def _summary(key: str, against: str, changes: tuple[FieldChange, ...]) -> str:
    if not changes:
        return f"{key} says what {against} said"
    return f"[bold]{key}[/] against {against}"


def _describe(screen: Screen, shown: ShownEntry) -> None:
    from calibrary.cli.console import plain, printable
    from calibrary.cli.tables import facts

    label = f"{shown.label}  " if shown.label is not None else ""
    screen.say(f"[bold]{plain(label + shown.id)}[/]")
    place = [
        ("file", shown.path),
        ("digest of the file", (shown.blob or "")[:12]),
        ("commit", (shown.commit or "")[:12]),
    ]
    if shown.proposal is not None:
        place.append(("proposed", f"another K waits for approval: calibrary registry show {shown.proposal}"))
    if shown.remark is not None:
        place.append(("not in force", shown.remark))
    rows = [*shown.rows(), *place, *_recorded(shown.recorded), *approval_rows(shown.approved)]
    screen.show(facts([(name, printable(value)) for name, value in rows], screen.width))


def approval_rows(approved: Sequence[Approval]) -> list[tuple[str, str]]:
    """Rows of the approvals, one each."""
    return [
        (
            "approved",
            f"{one.date:%Y-%m-%d} by {one.by}" + (f", commit {one.commit[:12]}" if one.commit else ""),
        )
        for one in approved
    ]


def _recorded(put: Recorded | None) -> list[tuple[str, str]]:
    """Row of the person who added the calibration to the registry, who need not be the one who made it."""
    if put is None:
        return []
    from_file = f", from {put.file}" if put.file is not None else ""
    return [("recorded", f"{put.date:%Y-%m-%d} by {put.by}{from_file}, commit {put.commit[:12]}")]
