"""``calibrary registry blame``: show who last changed each field of an entry, when and why."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.place import add_registry_flag, note_cut, opened
from calibrary.cli.tables import Column, fitted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.text import Text

    from calibrary.registry.history import FieldOrigin

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Show for each field of an entry the commit that last changed it."
EXAMPLES = """\
examples:
  calibrary registry blame fc6310r
  calibrary registry blame fc6310r intrinsics distortion.k1
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("key", metavar="KEY", help="make/model[/variant], as short as it is unambiguous")
    parser.add_argument("fields", nargs="*", metavar="FIELD", help="only these fields, or all below them")
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import out
    from calibrary.errors import InputError

    registry = opened(arguments)
    try:
        found = registry.blame(arguments.key, arguments.fields)
    except InputError as error:
        arguments.parser.error(str(error))
    if arguments.json:
        print_json(found.to_dict())
    else:
        screen = out(arguments)
        screen.show(_table(found.origins, screen.width))
        note_cut(arguments, registry)
    return 0


COLUMNS = (
    Column(name="field"),
    Column(name="value", wraps=True),
    Column(name="commit", rank=1),
    Column(name="date", rank=2),
    Column(name="by", rank=4),
    Column(name="reason", rank=3, wraps=True),
)


def _table(said: Sequence[FieldOrigin], width: int) -> list[Text]:
    from calibrary.cli.console import plain

    rows = []
    for one in said:
        revision = one.since.revision
        rows.append(
            (
                plain(one.field),
                plain(repr(one.value) if isinstance(one.value, float) else str(one.value)),
                revision.commit[:10],
                f"{revision.authored:%Y-%m-%d}",
                plain(revision.author.name),
                plain(one.since.reason or revision.subject),
            )
        )
    return fitted(COLUMNS, rows, width)
