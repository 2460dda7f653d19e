"""``calibrary registry log``: what became of an entry, or of the whole registry."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

from calibrary.cli.registry.place import add_registry_flag, opened

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from calibrary.registry.history import EntryRevision

__all__ = ["add_parser"]

EXAMPLES = """\
examples:
  calibrary registry log                     every commit
  calibrary registry log fc6310r             every revision of an entry, with what changed in K
  calibrary registry log fc6310r -n 5 --json
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = subparsers.add_parser(
        "log",
        help="tell what became of an entry, or of all",
        description="List the revisions of an entry with what changed in its K, or all commits.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("key", nargs="?", metavar="KEY", help="of one entry; of a removed one its whole id")
    parser.add_argument("-n", "--most", type=_count, metavar="N", help="only the newest N")
    add_registry_flag(parser)
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")
    parser.set_defaults(run=_run)


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: wanted a whole number, 1 or more")
    return int(text)


def _run(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import make_console
    from calibrary.registry.history import history_json

    told = opened(arguments).history(arguments.key, most=arguments.most)
    if arguments.json:
        document = history_json(told, arguments.key)
        sys.stdout.write(json.dumps(document, indent=2, ensure_ascii=True, allow_nan=False) + "\n")
    else:
        make_console(stderr=False).print(_of_all(told) if arguments.key is None else _of_one(told))
    return 0


def _of_one(told: Sequence[EntryRevision]) -> Table:
    from calibrary.cli.console import plain

    left = ("commit", "date", "who", "status", "grade", "firmware")
    table = _table(left, ("fx", "fy", "cx", "cy"), ("why",))
    for one in told:
        entry, delta = one.entry, one.delta or {}
        K = entry.calibration.intrinsics if entry is not None else None
        gone = "removed" if one.revision.oid is None else "unreadable"
        table.add_row(
            *_commit(one),
            entry.status.value if entry is not None else gone,
            entry.calibration.grade.value if entry is not None else "",
            plain(one.firmware or ""),
            *(
                _number(getattr(K, name), delta.get(name)) if K is not None else ""
                for name in ("fx", "fy", "cx", "cy")
            ),
            plain(one.reason or _without_names(one)),
        )
    return table


def _without_names(one: EntryRevision) -> str:
    """What the commit says it did, without the entry's name, which the reader has just typed."""
    subject = one.revision.subject
    for camera in one.cameras:
        subject = subject.removesuffix(camera).strip()
    return subject


def _of_all(told: Sequence[EntryRevision]) -> Table:
    from calibrary.cli.console import plain

    table = _table(("commit", "date", "who"), (), ("what", "cameras", "why"))
    for one in told:
        cameras = ", ".join(one.cameras[:3]) + (
            f" and {len(one.cameras) - 3} more" if len(one.cameras) > 3 else ""
        )
        table.add_row(*_commit(one), plain(one.revision.subject), plain(cameras), plain(one.reason or ""))
    return table


def _table(left: Sequence[str], right: Sequence[str], folded: Sequence[str]) -> Table:
    from rich.table import Table

    table = Table(box=None, padding=(0, 2, 0, 0))
    for name in left:
        table.add_column(name, no_wrap=name in {"commit", "date"})
    for name in right:
        table.add_column(f"{name} px", justify="right", no_wrap=True)
    for name in folded:
        table.add_column(name, overflow="fold")
    return table


def _commit(one: EntryRevision) -> tuple[str, str, str]:
    from calibrary.cli.console import plain

    revision = one.revision
    return revision.commit[:10], f"{revision.authored:%Y-%m-%d %H:%M}", plain(revision.author.name)


def _number(value: float, delta: float | None) -> str:
    text = f"{value:.2f}"
    return f"{text} [dim]({delta:+.2f})[/]" if delta else text
