"""``calibrary convert``: one calibration file into another, with a verdict on what survived."""

from __future__ import annotations

import argparse
from pathlib import Path

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.reading import Answers, add_reading_flags
from calibrary.errors import InputError

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
    parser.add_argument("--to", metavar="FORMAT", help="the output's format (default: told by OUT's name)")
    parser.add_argument("--camera", type=int, metavar="N", help="the Nth camera of a file with several")
    parser.add_argument(
        "--max-error-px",
        type=float,
        metavar="X",
        help="largest error a refit may leave anywhere in the image (default: 0.05)",
    )
    add_reading_flags(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary import parsers
    from calibrary.cli.console import out, plain

    calibrations = Answers.of(arguments).read(arguments.input)
    if arguments.camera is not None:
        if not 1 <= arguments.camera <= len(calibrations):
            raise InputError(
                f"has no camera {arguments.camera}; it holds {len(calibrations)}, counted from 1",
                source=arguments.input.name,
                place="--camera",
            )
        calibrations = [calibrations[arguments.camera - 1]]
    target = arguments.to or _by_name(arguments.output)
    verdict = parsers.write(calibrations, arguments.output, target, max_error_px=arguments.max_error_px)
    if arguments.json:
        document = {
            "output": arguments.output.name,
            "format": target,
            "verdict": verdict.outcome.value,
            "rms_px": verdict.rms_px,
            "max_px": verdict.max_px,
            "radius_px": verdict.radius_px,
            "dropped": list(verdict.dropped),
        }
        print_json(document)
    else:
        screen = out(arguments)
        screen.say(plain(f"wrote {arguments.output} ({target})"))
        screen.say(plain(str(verdict)))
    return 0


def _by_name(path: Path) -> str:
    """The one format that is written under such a name.

    Raises:
        InputError: none or several are.
    """
    from calibrary import parsers

    names = [r.name for r in parsers.formats() if r.write is not None and path.suffix.lower() in r.suffixes]
    if len(names) == 1:
        return names[0]
    listed = ", ".join(names or [r.name for r in parsers.formats() if r.write is not None])
    found = "several formats are" if names else "no format is"
    raise InputError(
        f"{found} written as {path.suffix or 'a file without a suffix'}; say which with --to: {listed}",
        source=path.name,
    )
