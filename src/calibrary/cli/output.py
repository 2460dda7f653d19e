"""The flags that every command has, and the document of ``--json``. Nothing here loads a library."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from calibrary.records import Record

__all__ = ["add_json_flag", "add_output_flags", "print_json"]

GROUP = "what is printed"
_BEYOND_ASCII = re.compile(r"[^\x00-\x7f]+")


def add_json_flag(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    _group(parser).add_argument(
        "--json",
        action="store_true",
        help="print one JSON document on standard output, and nothing else there",
    )


def add_output_flags(parser: argparse.ArgumentParser) -> None:
    """Add ``--quiet`` and ``--verbose``."""
    amount = _group(parser).add_mutually_exclusive_group()
    amount.add_argument("--quiet", "-q", action="store_true", help="results and errors only")
    amount.add_argument(
        "--verbose", "-v", action="count", default=0, help="say more on standard error; twice, every detail"
    )


def print_json(document: Mapping[str, object] | Record, *, indent: Literal[2] | None = 2) -> None:
    """Print the document; ASCII, whatever the terminal's language."""
    from calibrary.records import encoded

    text = encoded(document, indent=indent or 0).decode()
    sys.stdout.write((text if text.isascii() else _BEYOND_ASCII.sub(_escaped, text)) + "\n")


def _escaped(found: re.Match[str]) -> str:
    return json.dumps(found[0])[1:-1]


def _group(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """The group of these flags, which ``--json`` may have begun."""
    for group in parser._action_groups:
        if group.title == GROUP:
            return group
    return parser.add_argument_group(GROUP)
