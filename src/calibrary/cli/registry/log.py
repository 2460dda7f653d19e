"""``calibrary registry log``: show the revisions of an entry, or of the whole registry."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.place import add_registry_flag, note_cut, opened
from calibrary.cli.tables import Column, fitted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.text import Text

    from calibrary.registry.history import EntryRevision

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "List the revisions of an entry with what changed in its K, or all commits."
EXAMPLES = """\
examples:
  calibrary registry log                     every commit
  calibrary registry log fc6310r             every revision of an entry, with what changed in K
  calibrary registry log fc6310r -n 5 --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("key", nargs="?", metavar="KEY", help="an entry; for a removed one its whole id")
    parser.add_argument("-n", "--most", type=_count, metavar="N", help="only the newest N")
    add_registry_flag(parser)
    add_json_flag(parser)


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a whole number, 1 or more")
    return int(text)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import out

    registry = opened(arguments)
    found = registry.history(arguments.key, most=arguments.most)
    if arguments.json:
        print_json(found.to_dict())
    else:
        screen, rows_of = out(arguments), _of_all if arguments.key is None else _of_one
        screen.show(rows_of(found.revisions, screen.width))
        note_cut(arguments, registry)
    return 0


OF_ONE = (
    Column(name="commit"),
    Column(name="date", rank=1),
    Column(name="status", rank=2),
    *(
        Column(name=f"{name} px", rank=3 + (name[0] == "c") * 2, right=True)
        for name in ("fx", "fy", "cx", "cy")
    ),
    Column(name="grade", rank=6),
    Column(name="firmware", rank=7),
    Column(name="by", rank=8),
    Column(name="reason", rank=4, wraps=True),
)
OF_ALL = (
    Column(name="commit"),
    Column(name="date", rank=1),
    Column(name="by", rank=4),
    Column(name="what", rank=2, wraps=True),
    Column(name="cameras", rank=3, wraps=True),
    Column(name="reason", rank=3, wraps=True),
)


def _of_one(revisions: Sequence[EntryRevision], width: int) -> list[Text]:
    from calibrary.cli.console import plain

    rows = []
    for one in revisions:
        entry, delta = one.entry, one.delta or {}
        K = entry.calibration.intrinsics if entry is not None else None
        gone = "removed" if one.revision.oid is None else "unreadable"
        commit, when, by = _commit(one)
        rows.append(
            (
                commit,
                when,
                entry.status.value if entry is not None else gone,
                *(
                    _number(getattr(K, name), delta.get(name)) if K is not None else ""
                    for name in ("fx", "fy", "cx", "cy")
                ),
                entry.calibration.grade.value if entry is not None else "",
                plain(one.firmware or ""),
                by,
                plain(one.reason or _without_names(one)),
            )
        )
    return fitted(OF_ONE, rows, width)


def _without_names(one: EntryRevision) -> str:
    """The commit's subject without the entry's name, which the user has just typed, and without a lone "Add"."""
    subject = one.revision.subject
    for camera in one.cameras:
        subject = subject.removesuffix(camera).strip()
    return subject if " " in subject else ""


def _of_all(revisions: Sequence[EntryRevision], width: int) -> list[Text]:
    from calibrary.cli.console import plain

    rows = []
    for one in revisions:
        more = f" and {len(one.cameras) - 3} more" if len(one.cameras) > 3 else ""
        cameras = ", ".join(one.cameras[:3]) + more
        rows.append((*_commit(one), plain(one.revision.subject), plain(cameras), plain(one.reason or "")))
    return fitted(OF_ALL, rows, width)


def _commit(one: EntryRevision) -> tuple[str, str, str]:
    from calibrary.cli.console import plain

    revision = one.revision
    return revision.commit[:10], f"{revision.authored:%Y-%m-%d %H:%M}", plain(revision.author.name)


def _number(value: float, delta: float | None) -> str:
    text = f"{value:.2f}"
    return f"{text} [dim]({delta:+.2f})[/]" if delta else text
