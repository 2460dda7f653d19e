"""``calibrary calibrate combine``: combine several calibrations of one camera, if they agree."""

from __future__ import annotations

import argparse
from pathlib import Path

from calibrary.cli.calibrate.flags import add_provenance_flags, add_registry_flags
from calibrary.cli.calibrate.solve import (
    EXIT_NOT_PASSED,
    check_outputs,
    keep,
    stated_camera,
    writes_registry,
)
from calibrary.cli.camera_flags import add_camera_flags
from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.reading import add_reading_flags, reading_of
from calibrary.cli.registry.place import opened

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = """\
Combine several calibrations of one camera into one, weighted by their covariances, if they agree.

FILE is a calibration file that contains a covariance, the JSON that calibrate --json printed, or KEY[@REV] of an
entry. Two cameras are never averaged: the command refuses files of two cameras, of another focus, image size or lens
model, and files that disagree by more than their noise. It states which files disagree, and by how many px. A
calibration that only another program states is provisional at most, because its σ was never tested with halves of its
images.
"""
EXAMPLES = """\
examples:
  calibrary calibrate combine spring.json summer.json autumn.json --registry ../fleet --report combined.html
  calibrary calibrate combine flight1.json flight2.json --out camera.xml --to agisoft_xml
  calibrary calibrate combine metashape/cameras.xml --make DJI --model FC6310R --json

exit codes: 0 PASS; 1 PROVISIONAL or REFUSE, or an error of the registry's check; 3 unreadable input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "files", nargs="+", metavar="FILE", help="a calibration with its covariance, or KEY[@REV] of an entry"
    )
    parser.add_argument("--camera", type=int, metavar="N", help="which camera of files with several, from 1")
    outputs = parser.add_argument_group("what is written")
    outputs.add_argument(
        "--report",
        "--html",
        type=Path,
        metavar="FILE",
        help="a page with each calibration and the plot of fx, .html",
    )
    outputs.add_argument("--out", type=Path, metavar="FILE", help="K and distortion as a calibration file")
    outputs.add_argument("--to", metavar="FORMAT", help="format of --out (default: by its suffix)")
    add_registry_flags(parser).add_argument(
        "--as", dest="as_key", metavar="KEY", help="propose it for the camera of this entry"
    )
    add_provenance_flags(parser)
    add_camera_flags(parser, with_image_size=False)
    add_reading_flags(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.api.combining import combine_calibrations
    from calibrary.api.pages import check_page_place, write_page
    from calibrary.cli.calibrate.combine_display import CombineDisplay

    check_outputs(arguments)
    given = arguments
    if given.report is not None:
        check_page_place(given.report)
    fleet = opened(arguments) if writes_registry(arguments) else None
    display = CombineDisplay(arguments)
    done = combine_calibrations(
        given.files,
        reading=reading_of(given, camera=given.camera),
        registry=given.registry,
        date=given.date,
        operator=given.operator,
        camera=stated_camera(arguments, fleet),
    )
    display.sources(done.report)
    if given.out is not None:
        refused = done.report.calibration is None
        display.show_out(given.out, () if refused else done.write(given.out, given.to), refused=refused)
    if given.report is not None:
        write_page(given.report, done.to_html())
        display.say(f"wrote {given.report}")
    kept = fleet is None or keep(arguments, fleet, done, display)
    display.conclusion(done.report)
    if given.json:
        print_json(done.to_dict(), indent=None)
    return 0 if done.is_good and kept else EXIT_NOT_PASSED
