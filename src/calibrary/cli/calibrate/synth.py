"""``calibrary calibrate synth``: render frames of a board with an exactly known camera."""

from __future__ import annotations

import argparse
from pathlib import Path

from calibrary.cli.calibrate.flags import add_size_flags, number
from calibrary.cli.progress import Bar

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = """\
Render frames of a board as a camera would take them, and write the true values beside them: K, distortion, poses
and corners in OUT/truth.json. With these you can test a set-up before you print a board.
"""
EXAMPLES = """\
examples:
  calibrary calibrate synth frames/ --board checkerboard:11x8 --square-mm 40
  calibrary calibrate synth frames/ --board checkerboard:11x8 --square-mm 40 --camera FC6310 --bow-mm 0.2
  calibrary calibrate synth frames/ --board charuco:8x5 --square-mm 30 --calibration camera.yaml --blur 1.5
"""
LARGEST_COUNT = 1000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("out", type=Path, metavar="OUT", help="a new or an empty folder")
    parser.add_argument("--board", required=True, metavar="BOARD", help="such as checkerboard:11x8")
    add_size_flags(parser)
    parser.add_argument("--frames", type=_count, default=20, metavar="N", help="how many (default: 20)")
    parser.add_argument("--seed", type=_seed, default=1, metavar="N", help="the same seed, the same frames")
    camera = parser.add_mutually_exclusive_group()
    camera.add_argument(
        "--camera", metavar="NAME", help="camera of the catalogue to simulate, by its Model or name"
    )
    camera.add_argument(
        "--calibration", type=Path, metavar="FILE", help="calibration of the camera to simulate"
    )
    poses = parser.add_argument_group("how the board is held")
    poses.add_argument(
        "--max-tilt-deg", type=number(0, 80), default=35.0, metavar="DEG", help="largest tilt (default: 35)"
    )
    poses.add_argument(
        "--reach",
        type=number(0.05, 1),
        default=1.0,
        metavar="SHARE",
        help="share of the frame, around its middle, that the boards cover (default: 1)",
    )
    picture = parser.add_argument_group("what is wrong with the frames")
    for flag, (low, high), default, metavar, text in _FLAGS:
        picture.add_argument(
            flag,
            type=number(low, high),
            default=default,
            metavar=metavar,
            help=f"{text} (default: {default:g})",
        )
    picture.add_argument(
        "--quality", type=_quality, default=92, metavar="Q", help="quality of the JPEG (default: 92)"
    )


_FLAGS = (
    ("--blur", (0.0, 50.0), 0.8, "PX", "standard deviation of the blur"),
    ("--motion-px", (0.0, 200.0), 0.0, "PX", "motion along x while the shutter is open"),
    ("--noise", (0.0, 100.0), 2.0, "LEVELS", "standard deviation of the noise, of 255"),
    ("--glare", (0.0, 100.0), 0.0, "LIGHT", "brightness of a lamp's mirror image; 1 saturates"),
    ("--bow-mm", (-100.0, 100.0), 0.0, "MM", "distance of the board's middle behind its ends"),
    ("--stretch-pct", (-10.0, 10.0), 0.0, "PCT", "by how much the print is too wide"),
    ("--readout-ms", (0.0, 1000.0), 0.0, "MS", "readout of a rolling shutter, first to last row"),
    ("--turn-deg-s", (-1000.0, 1000.0), 0.0, "DEG", "speed of the camera's turn during the readout"),
)


def run(arguments: argparse.Namespace) -> int:
    """Run the command: render and write the frames; returns the exit code."""
    from calibrary.api.synthesis import render_frames
    from calibrary.cli.console import note, out, plain

    given = arguments
    with Bar(note(arguments), "rendering") as bar:
        truth = render_frames(
            given.out,
            given.board,
            square_mm=given.square_mm,
            marker_mm=given.marker_mm,
            frames=given.frames,
            seed=given.seed,
            camera=given.camera,
            calibration=given.calibration,
            max_tilt_deg=given.max_tilt_deg,
            reach=given.reach,
            blur_px=given.blur,
            motion_px=given.motion_px,
            noise=given.noise,
            glare=given.glare,
            bow_mm=given.bow_mm,
            stretch_pct=given.stretch_pct,
            readout_ms=given.readout_ms,
            turn_deg_s=given.turn_deg_s,
            quality=given.quality,
            progress=bar,
        )
    calibration, K = truth.calibration, truth.calibration.intrinsics
    out(arguments).say(
        f"wrote {len(truth.poses)} frames of {K.image_size[0]}×{K.image_size[1]} px by "
        f"{plain(str(calibration.camera))} to {plain(str(given.out))}, and K (fx {K.fx:.2f} px) with everything else "
        "that is true in truth.json"
    )
    return 0


def _count(text: str) -> int:
    return _whole(text, 1, LARGEST_COUNT)


def _seed(text: str) -> int:
    return _whole(text, 0, 2**31)


def _quality(text: str) -> int:
    return _whole(text, 1, 95)


def _whole(text: str, low: int, high: int) -> int:
    value = int(text) if text.isdecimal() and len(text) < 12 else low - 1
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a whole number from {low} to {high}")
    return value
