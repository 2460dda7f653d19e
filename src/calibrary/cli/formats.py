"""``calibrary formats``: list the calibration file formats that can be read or written, from their declarations."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.commands import add_json_flag, meant, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.tables import Column, fitted
from calibrary.jobs.formats import formats

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibrary.cli.console import Screen
    from calibrary.jobs.formats import ListedFormat

DESCRIPTION = "List the calibration files that are read and written."
EXAMPLES = """\
examples:
  calibrary formats              the table
  calibrary formats colmap       formats with a word in name or title, with their conventions
  calibrary formats agisoft_xml   one format: an example in its own words, how it counts, its source
"""

EXIT_NONE = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, formats, positional={"name": "NAME"})
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import errors, out, plain

    found = call(formats, arguments)
    if not found.formats:
        words = [word for one in formats().formats for word in (one.name, *one.programs)]
        remedy = meant(arguments.name, words) or "'calibrary formats' lists them all"
        errors().say(plain(f"calibrary: no format is called {arguments.name!r}; {remedy}"))
        return EXIT_NONE
    if arguments.json:
        print_json(found)
    else:
        _show(out(arguments), found.formats, name=arguments.name)
    return 0


COLUMNS = (
    Column(name="name"),
    Column(name="what it is", rank=2, wraps=True),
    Column(name="", rank=1),
    Column(name="usual names", rank=3, wraps=True),
)


def _show(screen: Screen, found: Sequence[ListedFormat], *, name: str) -> None:
    from calibrary.cli.console import plain

    rows = [(one.name, plain(one.title), one.access, plain(" ".join(one.suffixes))) for one in found]
    screen.show(fitted(COLUMNS, rows, screen.width))
    screen.say(f"{len(found)} formats" if len(found) > 1 else "1 format")
    if not name:
        programs = sorted({program for one in found for program in one.programs})
        screen.say(
            f"A program stands for the format that it reads, as in --to metashape: {', '.join(programs)}"
        )
        return
    for one in found:
        screen.say("")
        screen.say(f"[bold]{one.name}[/] — {plain(one.title)}")
        screen.say(f"  [dim]{plain(one.reference)}[/]")
        if one.programs:
            screen.say(f"  --to {' or --to '.join(one.programs)} stands for it")
        for fact in (one.refuses,) if one.refuses else one.facts:
            screen.say(f"  {plain(fact.replace('`', ''))}")
        if one.refuses is None and (one.name == name or len(found) == 1):
            screen.say("")
            for line in one.words.splitlines():
                screen.say(plain(line))
