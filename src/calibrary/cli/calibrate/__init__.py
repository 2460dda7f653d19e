"""``calibrary calibrate``: a camera from frames of a board, and, by a first word, the board or the frames."""

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
"""A folder of frames that bears such a name is given as ./board, ./flight, ./combine, ./rig or ./synth."""

RIG = "--rig"
LISTED = "\n".join(f"  {word.name:<8}{word.help}" for word in WORDS)
DESCRIPTION = f"{OF_FRAMES}\nin place of FRAMES:\n{LISTED}\n"


class _CalibrateParser(Parser):
    """Hands over to the parser of a first word it knows; what else comes are frames."""

    def __init__(self, **settings: Any) -> None:
        """As the base."""
        super().__init__(**settings)
        self.words = Commands(self.prog, WORDS)

    # The base has four overloads of this one signature; Any says the same as all of them.
    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As the base does, from the arguments after the command's name."""
        if args and RIG in args:
            # A flag by its looks, another command by what it asks for.
            args = [RIG.removeprefix("--"), *(one for one in args if one != RIG)]
        word = self.words.get(args[0]) if args else None
        if word is not None:
            return word.parse_known_args(args[1:], namespace)
        return super().parse_known_args(args, namespace)


PARSER = _CalibrateParser
