"""Whether a person agrees: asked on a terminal, said by ``--yes`` everywhere else."""

from __future__ import annotations

import argparse
import sys

__all__ = ["add_yes_flag", "agreed", "can_ask"]


def add_yes_flag(parser: argparse.ArgumentParser, means: str = "write without asking") -> None:
    """Add ``--yes``."""
    parser.add_argument("--yes", "-y", action="store_true", help=means)
    parser.set_defaults(parser=parser)


def can_ask() -> bool:
    """Whether there is a person to ask."""
    return sys.stdin is not None and sys.stdin.isatty()


def agreed(arguments: argparse.Namespace, question: str) -> bool:
    """Whether to go on. Where there is nobody to ask and ``--yes`` was not said, the command ends as misused."""
    if arguments.yes:
        return True
    if not can_ask():
        arguments.parser.error(f"{question} Nobody can be asked here; say --yes")
    sys.stderr.write(f"{question} [y/N] ")
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in {"y", "yes"}
