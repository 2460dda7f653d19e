"""``calibrary formats``: list the calibration file formats that can be read or written, from their declarations."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.tables import Column, fitted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibrary.cli.console import Screen
    from calibrary.parsers.format import Format

__all__ = ["DESCRIPTION", "EXAMPLES", "abilities", "add_arguments", "markdown", "run"]

DESCRIPTION = "List the calibration files that are read and written."
EXAMPLES = """\
examples:
  calibrary formats              the table
  calibrary formats colmap       formats with a word in name or title, with their conventions
  calibrary formats --markdown   the table as documentation
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("name", nargs="?", metavar="NAME", help="part of a format's name or title")
    add_json_flag(parser)
    parser.add_argument("--markdown", action="store_true", help="print the table as Markdown")


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import errors, out, plain
    from calibrary.jobs.files import format_listing, formats

    records = formats(arguments.name or "")
    if not records:
        complaint = f"calibrary: no format is called {arguments.name!r}"
        errors().say(plain(f"{complaint}; 'calibrary formats' lists them all"))
        return 1
    if arguments.json:
        print_json(format_listing(records))
    elif arguments.markdown:
        sys.stdout.write(markdown(records))
    else:
        _show(out(arguments), records, details=bool(arguments.name))
    return 0


def markdown(records: Sequence[Format]) -> str:
    """Markdown table with one row per format."""
    rows = [f"| `{r.name}` | {r.title} | {abilities(r)} | {_counts(r)} |" for r in records]
    head = ["| name | what it is | read, write | how it counts |", "| --- | --- | --- | --- |"]
    return "\n".join([*head, *rows]) + "\n"


def abilities(record: Format) -> str:
    """Whether a format can be read, written or both, in words."""
    if record.refuses is not None:
        return "refused"
    if record.updated:
        return "read, update"
    return "read, write" if record.write is not None else "read"


def _counts(record: Format) -> str:
    if record.convention is None:
        return record.refuses or ""
    sentences = list(record.convention.sentences())
    if record.needs_image_size:
        sentences.append("the file does not say the image size: give --image-size")
    if record.states:
        sentences.append(f"a file can state its {', '.join(record.states)}")
    return "; ".join(sentences)


COLUMNS = (
    Column(name="name"),
    Column(name="what it is", rank=2, wraps=True),
    Column(name="", rank=1),
    Column(name="usual names", rank=3, wraps=True),
)


def _show(screen: Screen, records: Sequence[Format], *, details: bool) -> None:
    from calibrary.cli.console import plain

    rows = [(r.name, plain(r.title), abilities(r), plain(" ".join(r.suffixes))) for r in records]
    screen.show(fitted(COLUMNS, rows, screen.width))
    screen.say(f"{len(records)} formats" if len(records) > 1 else "1 format")
    if not details:
        return
    for record in records:
        screen.say("")
        screen.say(f"[bold]{record.name}[/] — {plain(record.title)}")
        screen.say(f"  [dim]{plain(record.reference)}[/]")
        for sentence in _counts(record).split("; "):
            screen.say(f"  {plain(sentence)}")
        for option in record.options:
            values = "|".join(option.values)
            screen.say(f"  --set {option.name}={values}: {plain(option.meaning)}")
