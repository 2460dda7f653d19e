"""``calibrary registry show``: an entry, now or at a revision, what changed between the two, or the one of an image."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from calibrary.cli.commands import print_json
from calibrary.cli.flags import call
from calibrary.cli.registry import OfRegistry, note_cut, opened
from calibrary.jobs.fleet import Fleet
from calibrary.jobs.resolve import names_image, resolve

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.cli.words import Words
    from calibrary.jobs.fleet import FieldChange, ShownEntry

DESCRIPTION = (
    "Show one entry, as it is or as it was, or the one that applies to an image, with its K and its use."
)
EXAMPLES = """\
examples:
  calibrary registry show dji/fc6310r
  calibrary registry show dji/fc6310r@proposed          what is proposed to replace it
  calibrary registry show fc6310r@2026-05-01            as it was at the end of that day
  calibrary registry show fc6310r@firmware:01.09        as it was made for that firmware
  calibrary registry show fc6310r --diff v2026.1        what changed since that tag
  calibrary registry show fc6310r --yaml                the file itself
  calibrary registry show flight/DJI_0001.JPG           the entry of this image, K at its size, and what it may do

Of an image it tells what 'registry resolve' prints in one line: from the same registries, with the same exit code.
"""


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    if arguments.against is not None and arguments.yaml:
        arguments.parser.error("--diff: not together with --yaml; git diff compares files")
    return _show_of_image(arguments) if names_image(arguments.key) else _show(arguments)


def _show_of_image(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import out
    from calibrary.cli.registry.resolve import exit_code
    from calibrary.cli.terminal import show
    from calibrary.view import view_of

    if arguments.against is not None or arguments.yaml:
        arguments.parser.error(
            "--diff and --yaml: of an entry; without them 'show IMAGE' tells which one it is"
        )
    found = resolve(arguments.key, registry=arguments.registry, history=True)
    if arguments.json:
        print_json(found)
    else:
        show(out(arguments), view_of(found))
    return exit_code(found)


def _show(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import out
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
        screen.say(*_summary(arguments.key, shown.against, shown.changes))
        if shown.changes:
            screen.show(change_table(shown.changes, screen.width))
    return 0


def _summary(key: str, against: str, changes: tuple[FieldChange, ...]) -> tuple[Words, ...]:
    if not changes:
        return (f"{key} says what {against} said",)
    return (key, "bold"), f" against {against}"


def _describe(screen: Screen, shown: ShownEntry) -> None:
    from calibrary.cli.tables import facts

    label = f"{shown.label}  " if shown.label is not None else ""
    screen.say((label + shown.id, "bold"))
    screen.show(facts(shown.rows(), screen.width))


class _Show(OfRegistry):
    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the flags; the document and the file are printed in place of one another."""
        super().add_arguments(parser)
        form = parser.add_mutually_exclusive_group()
        form.add_argument("--json", action="store_true", help="print one JSON document on standard output")
        form.add_argument("--yaml", action="store_true", help="print the file of the entry")


COMMAND = _Show(
    Fleet.show,
    DESCRIPTION,
    EXAMPLES,
    run=run,
    positional={"key": "KEY[@REV]|IMAGE"},
    spelled={"against": "--diff"},
    json=False,
)
