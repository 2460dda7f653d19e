"""Whether a person agrees: asked on a terminal, said by ``--yes`` everywhere else."""

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
    """Whether there is a person to ask."""
    return sys.stdin is not None and sys.stdin.isatty()


def deciding_screen(arguments: argparse.Namespace) -> Screen:
    """Where a change is shown: with the results, but where ``--json`` mutes these, before the question about it."""
    from calibrary.cli.console import errors, out

    return errors() if arguments.json and not arguments.yes and can_ask() else out(arguments)


def agreed(arguments: argparse.Namespace, question: str) -> bool:
    """Whether to go on. Without a terminal to ask on and without ``--yes``, the command ends as misused."""
    if arguments.yes:
        return True
    if not can_ask():
        arguments.parser.error(f"{question} There is no terminal to ask on; say --yes")
    sys.stderr.write(f"{question} [y/N] ")
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in {"y", "yes"}
