"""Confirmation by the user: asked on a terminal, otherwise given by ``--yes``."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.cli.console import Screen

__all__ = ["add_yes_flag", "agreed", "can_ask", "deciding_screen"]


def add_yes_flag(parser: argparse.ArgumentParser, means: str = "write without asking") -> None:
    """Add ``--yes``."""
    parser.add_argument("--yes", "-y", action="store_true", help=means)


def can_ask() -> bool:
    """Whether there is a terminal to ask on."""
    return sys.stdin is not None and sys.stdin.isatty()


def deciding_screen(arguments: argparse.Namespace) -> Screen:
    """Console on which a change is shown: that of the results, or that of the question if ``--json`` mutes results."""
    from calibrary.cli.console import errors, out

    return errors() if arguments.json and not arguments.yes and can_ask() else out(arguments)


def agreed(arguments: argparse.Namespace, question: str) -> bool:
    """Whether the user agrees. Without a terminal and without ``--yes`` the command ends with a usage error."""
    if arguments.yes:
        return True
    if not can_ask():
        arguments.parser.error(f"{question} There is no terminal to ask on; say --yes")
    sys.stderr.write(f"{question} [y/N] ")
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in {"y", "yes"}
