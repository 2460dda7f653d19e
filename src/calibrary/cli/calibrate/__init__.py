"""``calibrary calibrate``: a camera from frames of a board, and, by a first word, the board or the frames."""

from __future__ import annotations

import argparse
from types import MappingProxyType
from typing import Any, Final, Protocol

from calibrary.cli.calibrate import board, solve, synth
from calibrary.cli.parser import Parser

__all__ = ["add_parser"]


class _Word(Protocol):
    """What a module of this package has to hold."""

    DESCRIPTION: str
    EXAMPLES: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the word's arguments."""

    def run(self, arguments: argparse.Namespace) -> int:
        """Do it; returns the exit code."""


_ALL: Final[dict[str, _Word]] = {"board": board, "synth": synth}
WORDS: Final = MappingProxyType(_ALL)
"""A folder of frames that bears such a name is given as ./board or ./synth."""

DESCRIPTION = f"""\
{solve.DESCRIPTION}
in place of FRAMES:
  board   write a board as PDF or SVG, true to the millimetre
  synth   render frames of a board, with the truth beside them
"""


class _CalibrateParser(Parser):
    """Hands over to the parser of a first word it knows; what else comes are frames."""

    words: dict[str, argparse.ArgumentParser]

    # The base has four overloads of this one signature; Any says the same as all of them.
    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As the base does, from the arguments after the command's name."""
        word = self.words.get(args[0]) if args else None
        if word is not None:
            return word.parse_known_args(args[1:], namespace)
        return super().parse_known_args(args, namespace)


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    listed = subparsers.add_parser(
        "calibrate", help="find K from frames of a board; print boards, render frames"
    )
    parser = _CalibrateParser(prog=listed.prog, description=DESCRIPTION, epilog=solve.EXAMPLES)
    solve.add_arguments(parser)
    parser.words = {
        word: Parser(prog=f"{listed.prog} {word}", description=module.DESCRIPTION, epilog=module.EXAMPLES)
        for word, module in WORDS.items()
    }
    for word, module in WORDS.items():
        module.add_arguments(parser.words[word])
        parser.words[word].set_defaults(run=module.run)
    # The list that the help shows was filled by add_parser; this is the mapping that decides who parses.
    subparsers.choices["calibrate"] = parser
