"""The one way to get a terminal."""

from __future__ import annotations

import os

from rich.console import Console

__all__ = ["make_console"]

PIPED_WIDTH = 140


def make_console(*, stderr: bool) -> Console:
    """A rich console; where there is no terminal, tables get a width that does not break their words."""
    console = Console(stderr=stderr)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        return Console(stderr=stderr, width=PIPED_WIDTH)
    return console
