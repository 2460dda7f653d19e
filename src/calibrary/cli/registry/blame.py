"""``calibrary registry blame``: who last changed each field of an entry, when and why."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

from calibrary.cli.registry.place import add_registry_flag, opened

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from calibrary.registry.history import FieldOrigin

__all__ = ["add_parser"]

EXAMPLES = """\
examples:
  calibrary registry blame fc6310r
  calibrary registry blame fc6310r intrinsics distortion.k1
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = subparsers.add_parser(
        "blame",
        help="tell who last changed each field",
        description="Tell of each field of an entry by which commit it came to be what it is.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("key", metavar="KEY", help="make/model[/variant], as short as it is unambiguous")
    parser.add_argument("fields", nargs="*", metavar="FIELD", help="only these, or all below them")
    add_registry_flag(parser)
    parser.add_argument("--json", action="store_true", help="print JSON on standard output")
    parser.set_defaults(run=_run, parser=parser)


def _run(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import make_console
    from calibrary.registry.history import blame_json

    registry = opened(arguments)
    said = registry.blame(arguments.key)
    asked = arguments.fields
    kept = [
        one
        for one in said
        if not asked or any(one.field == name or one.field.startswith(f"{name}.") for name in asked)
    ]
    if not kept:
        there = ", ".join(dict.fromkeys(one.field.partition(".")[0] for one in said))
        arguments.parser.error(f"{arguments.key} says nothing of {', '.join(asked)}; it has {there}")
    if arguments.json:
        document = blame_json(kept, registry.get(arguments.key).id)
        sys.stdout.write(json.dumps(document, indent=2, ensure_ascii=True, allow_nan=False) + "\n")
    else:
        make_console(stderr=False).print(_table(kept))
    return 0


def _table(said: Sequence[FieldOrigin]) -> Table:
    from rich.table import Table

    from calibrary.cli.console import plain

    table = Table(box=None, padding=(0, 2, 0, 0))
    for name in ("field", "value", "commit", "date", "who", "why"):
        table.add_column(name, overflow="fold", no_wrap=name in {"commit", "date"})
    for one in said:
        revision = one.since.revision
        table.add_row(
            plain(one.field),
            plain(repr(one.value) if isinstance(one.value, float) else str(one.value)),
            revision.commit[:10],
            f"{revision.authored:%Y-%m-%d}",
            plain(revision.author.name),
            plain(one.since.reason or revision.subject),
        )
    return table
