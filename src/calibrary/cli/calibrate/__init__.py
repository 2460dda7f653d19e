"""``calibrary calibrate``: calibrate a camera from frames of a board; its first word may select a subcommand."""

from __future__ import annotations

from typing import Any

from calibrary.cli.calibrate.keeping import Kept
from calibrary.cli.commands import Command, Commands, Parser
from calibrary.jobs.calibrate import calibrate

WORDS = (
    Command("board", "write a board as PDF or SVG, true to the millimetre", f"{__name__}.board"),
    Command("flight", "calibrate from the images of a flight themselves", f"{__name__}.flight"),
    Command("rig", "calibrate cameras that are fixed to one another; also --rig", f"{__name__}.rig"),
    Command("watch", "judge frames as they arrive, and propose the next pose", f"{__name__}.watch"),
    Command("synth", "render frames of a board, with the truth beside them", f"{__name__}.synth"),
)
"""Subcommands. A folder of frames with such a name is given as ./board, ./flight, ./rig, … ."""

RIG = "--rig"
LISTED = "\n".join(f"  {word.name:<8}{word.help}" for word in WORDS)
DESCRIPTION = f"""\
Compute a camera's K and distortion from frames of a calibration board, and report how far to trust them.

FRAMES are files, folders and patterns: the frames of one camera at one focus. The result says what K is good for: to
be kept FIXED in a solver, to START one from, or for NONE, with the numbers that decide, every reason, and what to do
next. Limits are those of the policy. Of what is good for nothing only a page and the corners are written. Without
--date the day of the images is taken, or today.

in place of FRAMES:
{LISTED}
"""
EXAMPLES = """\
examples:
  calibrary calibrate frames/ --board checkerboard:11x8 --square-mm 40 --html camera.html
  calibrary calibrate 'frames/*.JPG' --square-mm 40 --out camera.xml --to agisoft_xml
  calibrary calibrate frames/ --board charuco:8x5 --square-mm 30 --corners corners.json --registry ../fleet
  calibrary calibrate --from corners.json --lens-model rational --json
  calibrary calibrate --from corners.vnl --board checkerboard:10x10 --image-size 6000x3376
  calibrary calibrate --points gcp.csv --image-size 5472x3648 --seed-k K_matrix_seed.npy --html camera.html

exit codes: 0 good for --use (default: fixed); 1 not, no board, or an error of the registry's check; 3 unreadable
  input
"""


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


COMMAND = Kept(
    calibrate,
    DESCRIPTION,
    EXAMPLES,
    doing="finding the board in",
    made=lambda report: [report.entry],
    positional={"frames": "FRAMES"},
    spelled={"corners": "--from", "keep_corners": "--corners"},
    without=("tool", "flight"),
    groups={
        "the board": ("board", "square_mm", "marker_mm"),
        "in place of frames": ("corners", "points", "pixel_origin"),
        "how to solve": ("lens_model", "flat", "seed_k", "focus", "workers"),
        "what is written": ("html", "out", "to", "keep_corners"),
        "the registry": ("registry", "as_"),
    },
    switches={"--correlations": "also show correlated parameters"},
    kind=_CalibrateParser,
)
