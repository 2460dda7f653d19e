"""``calibrary calibrate``: calibrate a camera from frames of a board; its first word may select a subcommand."""

from __future__ import annotations

from typing import Any

from calibrary.cli.calibrate.solve import DESCRIPTION as OF_FRAMES
from calibrary.cli.calibrate.solve import EXAMPLES, add_arguments, run
from calibrary.cli.commands import Command, Commands
from calibrary.cli.parser import Parser

__all__ = ["DESCRIPTION", "EXAMPLES", "PARSER", "add_arguments", "run"]

WORDS = (
    Command("board", "write a board as PDF or SVG, true to the millimetre", f"{__name__}.board"),
    Command("flight", "calibrate from the images of a flight themselves", f"{__name__}.flight"),
    Command("combine", "several calibrations of one camera as one, if they agree", f"{__name__}.combine"),
    Command("rig", "calibrate cameras that are fixed to one another; also --rig", f"{__name__}.rig"),
    Command("watch", "judge frames as they arrive, and propose the next pose", f"{__name__}.watch"),
    Command("synth", "render frames of a board, with the truth beside them", f"{__name__}.synth"),
)
"""Subcommands. A folder of frames with such a name is given as ./board, ./flight, ./combine, ./rig, … ."""

RIG = "--rig"
LISTED = "\n".join(f"  {word.name:<8}{word.help}" for word in WORDS)
DESCRIPTION = f"{OF_FRAMES}\nin place of FRAMES:\n{LISTED}\n"


class _CalibrateParser(Parser):
    """Parser that delegates to the subcommand named by the first word; any other argument is frames."""

    def __init__(self, **settings: Any) -> None:
        """Create the parser with argparse's settings."""
        super().__init__(**settings)
        self.words = Commands(self.prog, WORDS)

    # The base class has four overloads of this signature; Any covers all of them.
    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse the arguments after the command's name, as the base class does."""
        if args and RIG in args:
            # It looks like a flag, but asks for another command.
            args = [RIG.removeprefix("--"), *(one for one in args if one != RIG)]
        word = self.words.get(args[0]) if args else None
        if word is not None:
            return word.parse_known_args(args[1:], namespace)
        return super().parse_known_args(args, namespace)


PARSER = _CalibrateParser
