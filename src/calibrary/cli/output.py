"""Flags that every command has, and the output of ``--json``. This module loads no heavy library."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from calibrary.jobs.tables.table import Table
    from calibrary.records import Record

__all__ = [
    "add_json_flag",
    "add_output_flags",
    "add_table_flag",
    "check_table_flag",
    "print_json",
    "write_table",
]

GROUP = "what is printed"
_BEYOND_ASCII = re.compile(r"[^\x00-\x7f]+")


def add_json_flag(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    _group(parser).add_argument(
        "--json",
        action="store_true",
        help="print one JSON document on standard output, and nothing else there",
    )


def add_table_flag(parser: argparse.ArgumentParser, of: str, *, name: str = "--table") -> None:
    """Add ``--table``, or another flag of a table.

    Args:
        parser: of the command.
        of: what a row represents.
        name: of the flag.
    """
    _group(parser).add_argument(
        name,
        metavar="FILE",
        help=f"also write a table of {of}: .csv, or .parquet (calibrary[tables]); - prints CSV in place of the results",
    )


def check_table_flag(arguments: argparse.Namespace, *, name: str = "table") -> None:
    """Check before any work is done that the table can be written."""
    place = getattr(arguments, name)
    if place == "-" and arguments.json:
        arguments.parser.error(f"--{name.replace('_', '-')} - and --json both print on standard output")
    if place not in {None, "-"}:
        from calibrary.jobs.tables.table import check_table_place

        check_table_place(Path(place))


def write_table(place: str | None, table: Callable[[], Table]) -> None:
    """Write the table to the place given by the flag of :func:`add_table_flag`, if it was given."""
    if place == "-":
        sys.stdout.write(table().to_csv())
    elif place is not None:
        table().write(Path(place))


def add_output_flags(parser: argparse.ArgumentParser) -> None:
    """Add ``--quiet`` and ``--verbose``."""
    amount = _group(parser).add_mutually_exclusive_group()
    amount.add_argument("--quiet", "-q", action="store_true", help="print only results and errors")
    amount.add_argument(
        "--verbose", "-v", action="count", default=0, help="print more on standard error; twice: every detail"
    )


def print_json(document: Mapping[str, object] | Record, *, indent: Literal[2] | None = 2) -> None:
    """Print the document as ASCII, whatever the terminal's language."""
    from calibrary.records import encoded

    text = encoded(document, indent=indent or 0).decode()
    sys.stdout.write((text if text.isascii() else _BEYOND_ASCII.sub(_escaped, text)) + "\n")


def _escaped(found: re.Match[str]) -> str:
    return json.dumps(found[0])[1:-1]


def _group(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """The argument group of these flags, which ``--json`` may already have created."""
    for group in parser._action_groups:
        if group.title == GROUP:
            return group
    return parser.add_argument_group(GROUP)
