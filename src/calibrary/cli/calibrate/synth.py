"""``calibrary calibrate synth``: render frames of a board with an exactly known camera."""

from __future__ import annotations

import argparse

from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.jobs.synth import render_frames

DESCRIPTION = """\
Render frames of a board as a camera would take them, and write the true values beside them: K, distortion, poses
and corners in OUT/truth.json. With these you can test a set-up before you print a board.
"""
EXAMPLES = """\
examples:
  calibrary calibrate synth frames/ --board checkerboard:11x8 --square-mm 40
  calibrary calibrate synth frames/ --board checkerboard:11x8 --square-mm 40 --camera FC6310
  calibrary calibrate synth frames/ --board charuco:8x5 --square-mm 30 --calibration camera.yaml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(
        parser,
        render_frames,
        positional={"out": "OUT"},
        exclusive=(("camera", "calibration"),),
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the command: render and write the frames; returns the exit code."""
    from calibrary.cli.console import note, out, plain

    with Bar(note(arguments), "rendering") as bar:
        truth = call(render_frames, arguments, progress=bar)
    calibration, K = truth.calibration, truth.calibration.intrinsics
    out(arguments).say(
        f"wrote {len(truth.poses)} frames of {K.image_size[0]}×{K.image_size[1]} px by "
        f"{plain(str(calibration.camera))} to {plain(str(arguments.out))}, and K (fx {K.fx:.2f} px) with everything "
        "else that is true in truth.json"
    )
    return 0
