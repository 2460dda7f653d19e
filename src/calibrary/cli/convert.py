"""``calibrary convert``: one calibration file into another, with a verdict on what survived."""

from __future__ import annotations

import argparse
from pathlib import Path

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.reading import add_reading_flags, reading_of

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Write a calibration in another program's format, and say what survived."
EXAMPLES = """\
examples:
  calibrary convert camera.xml camera.yml --to opencv_storage
  calibrary convert K.npy cameras.txt --to colmap_text --image-size 5472x3648
  calibrary convert rig.xml one.yml --to opencv_storage --camera 2
  calibrary convert report.txt lens.xml --to agisoft_xml --max-error-px 0.2

The output is written only when it holds the calibration to 0.05 px anywhere in the image, or to
--max-error-px; what the format has no place for is named.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("input", type=Path, metavar="IN", help="a calibration file or an image")
    parser.add_argument("output", type=Path, metavar="OUT", help="the file to write")
    parser.add_argument("--to", metavar="FORMAT", help="the output's format (default: by OUT's name)")
    parser.add_argument("--camera", type=int, metavar="N", help="the Nth camera of a file with several")
    parser.add_argument(
        "--max-error-px",
        type=float,
        metavar="X",
        help="largest error a refit may leave anywhere in the image (default: 0.05)",
    )
    parser.add_argument(
        "--allow-prior",
        action="store_true",
        help="write a K that was not measured, such as another program's default",
    )
    parser.add_argument("--force", action="store_true", help="write a K that is that of no camera")
    add_reading_flags(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.api.files import convert
    from calibrary.cli.console import out, plain

    done = convert(
        arguments.input,
        arguments.output,
        to=arguments.to,
        reading=reading_of(arguments, camera=arguments.camera),
        max_error_px=arguments.max_error_px,
        allow_prior=arguments.allow_prior,
        force=arguments.force,
    )
    if arguments.json:
        print_json(done.to_dict())
    else:
        screen = out(arguments)
        screen.say(plain(f"wrote {done.output} ({done.format})"))
        screen.say(plain(str(done.verdict)))
        if done.priors:
            grades = ", ".join(dict.fromkeys(f"{grade.value} ({grade.meaning})" for grade in done.priors))
            screen.say(plain(f"not measured, to start an adjustment with: its K is a {grades}"))
    return 0
