"""The one way to get a terminal."""

from __future__ import annotations

import os

from rich.console import Console
from rich.markup import escape

__all__ = ["make_console", "plain", "printable"]

PIPED_WIDTH = 140


def make_console(*, stderr: bool) -> Console:
    """A rich console; where there is no terminal, tables get a width that does not break their words."""
    console = Console(stderr=stderr)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        return Console(stderr=stderr, width=PIPED_WIDTH)
    return console


def printable(text: str) -> str:
    """Text from a file or a tag without control characters, which a terminal would obey."""
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)


def plain(text: str) -> str:
    """The same without markup, for strings in which rich looks for it."""
    return escape(printable(text))
