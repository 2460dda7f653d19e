"""``calibrary calibrate flight``: self-calibration of a camera from the images of a flight, without a board."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.calibrate.flags import (
    LENS_MODELS,
    add_file_flags,
    add_provenance_flags,
    add_registry_flags,
    number,
)
from calibrary.cli.calibrate.solve import (
    check_outputs,
    finish,
    stated_camera,
    writes_registry,
)
from calibrary.cli.camera_flags import add_camera_flags
from calibrary.cli.output import add_json_flag
from calibrary.cli.progress import Bar
from calibrary.cli.registry.place import opened

if TYPE_CHECKING:
    from calibrary.api.boards import CalibrateResult
    from calibrary.api.flights import Survey
    from calibrary.jobs.fleet import Fleet

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = """\
Compute a camera's K and distortion from the images of a flight, and report how far to trust them.

The command chooses some 30 images that overlap, of different heights, headings and tilts if there are any. It finds
the points that they share, and adjusts lens, poses and points together. It weights positions in the images by their
own standard deviation and writes them nowhere. A flight over flat ground at one height, straight down, does not
determine the focal length: the command reports that, with what is certain nevertheless and what to fly. Needs
"calibrary[sfm]".

With --from the points are those of a finished reconstruction: COLMAP's sparse model, or the result of OpenSfM or ODM.
They are adjusted and judged in the same way and need no other library. DIR then states the camera and where the images
were taken; you may omit it.

With --points the command also uses surveyed points on the ground, with marks that show where images see them: the
gcp_list.txt of ODM and WebODM, whose first line names the coordinate system. Points at different heights help most.
A constant offset to the positions in the images, such as the height of the geoid, is solved for;
--same-datum states how small it is.
"""
EXAMPLES = """\
examples:
  calibrary calibrate flight flight/ --report flight.html
  calibrary calibrate flight flight/ --images 40 --registry ../fleet
  calibrary calibrate flight flight/ --from-registry dji/fc6310r/5472x3648 --registry ../fleet --json
  calibrary calibrate flight flight/ --start 3650 --out camera.xml --to agisoft_xml
  calibrary calibrate flight flight/ --from project/sparse/0 --registry ../fleet
  calibrary calibrate flight flight/ --points gcp_list.txt --points-std 0.02 --report flight.html
  calibrary calibrate flight --from odm_project --make DJI --model FC6310R --report flight.html

exit codes: 0 PASS; 1 PROVISIONAL or REFUSE, images that do not fit together, or the registry's check objects; 3 \
unreadable input
"""
MODELS = tuple(
    name for name in LENS_MODELS if name in {"auto", "k1k2", "k1k2p1p2", "brown", "rational", "fisheye"}
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("images", type=Path, nargs="*", metavar="DIR", help="folders, files or patterns")
    parser.add_argument(
        "--images",
        dest="most",
        type=_count,
        metavar="N",
        help="number of images to choose (default: 30; from a reconstruction 60)",
    )
    others = parser.add_argument_group("a finished reconstruction")
    others.add_argument(
        "--from",
        dest="result_of",
        type=Path,
        metavar="FOLDER",
        help="COLMAP's cameras, images and points3D (.bin or .txt), or reconstruction.json "
        "and tracks.csv of OpenSfM or ODM",
    )
    others.add_argument(
        "--camera", type=int, metavar="N", help="which camera of several, from 1, if no DIR states it"
    )
    control = parser.add_argument_group("ground control")
    control.add_argument(
        "--points",
        type=Path,
        metavar="FILE",
        help="gcp_list.txt: coordinate system, then x y z im_x im_y image [name]",
    )
    control.add_argument(
        "--points-std",
        type=number(1e-4, 100),
        metavar="M",
        help="σ of each coordinate of a point (default: 0.03)",
    )
    control.add_argument(
        "--mark-std", type=number(0.01, 100), metavar="PX", help="σ of each coordinate of a mark (default: 1)"
    )
    control.add_argument(
        "--same-datum",
        type=number(0.001, 1000),
        metavar="M",
        help="positions in the images have the points' datum and height system, within this σ (default: unknown)",
    )
    begin = parser.add_argument_group("where the search begins").add_mutually_exclusive_group()
    begin.add_argument("--start", metavar="K", help="start: focal length in px, or calibration file")
    begin.add_argument("--from-registry", metavar="KEY", help="start from the K of this entry of --registry")
    add_file_flags(parser)
    add_registry_flags(parser).add_argument(
        "--as", dest="as_key", metavar="KEY", help="propose it for the camera of this entry"
    )
    add_provenance_flags(parser)
    add_camera_flags(parser)
    solving = parser.add_argument_group("how to solve")
    solving.add_argument(
        "--lens-model",
        choices=MODELS,
        default="auto",
        help="distortion model (default: auto, chosen by the images)",
    )
    solving.add_argument(
        "--max-side",
        type=number(400, 8000),
        metavar="PX",
        help="image size for finding points (default: 1600); twice the size takes four times the time and memory",
    )
    solving.add_argument("--focus", metavar="TEXT", help='how the lens was focused: "locked at infinity"')
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.api.boards import Places
    from calibrary.cli.calibrate.solve_display import Display

    _check_usage(arguments)
    given = arguments
    places = Places(report=given.report, out=given.out, format=given.to)
    places.check()
    reads = writes_registry(arguments) or given.from_registry is not None
    fleet = opened(arguments) if reads else None
    display = Display(arguments)
    done = _calibrated(arguments, fleet)
    return finish(arguments, places, fleet if writes_registry(arguments) else None, display, done)


def _check_usage(arguments: argparse.Namespace) -> None:
    given, parser = arguments, arguments.parser
    if given.result_of is None and not given.images:
        parser.error("expected DIR, the images of a flight, or --from FOLDER, a finished reconstruction")
    if given.result_of is not None and (given.start or given.from_registry or given.max_side is not None):
        parser.error("--start, --from-registry and --max-side are of images: a reconstruction has its points")
    if given.camera is not None and (given.result_of is None or given.images):
        parser.error("--camera is of a reconstruction by several cameras, --from FOLDER without DIR")
    if given.points is None and (given.points_std or given.mark_std or given.same_datum):
        parser.error("--points-std, --mark-std and --same-datum are of ground control, --points FILE")
    check_outputs(arguments)


def _survey(given: argparse.Namespace) -> Survey | None:
    from calibrary.api.flights import ground_control

    if given.points is None:
        return None
    stated = {"std_m": given.points_std, "mark_px": given.mark_std, "offset_std_m": given.same_datum}
    return ground_control(
        given.points, **{name: value for name, value in stated.items() if value is not None}
    )


def _calibrated(arguments: argparse.Namespace, fleet: Fleet | None) -> CalibrateResult:
    from calibrary.api.flights import calibrate_flight, calibrate_reconstruction
    from calibrary.cli.console import note

    given = arguments
    if given.result_of is not None:
        return calibrate_reconstruction(
            given.result_of,
            given.images,
            camera_number=given.camera,
            **({"most": given.most} if given.most is not None else {}),
            lens_model=given.lens_model,
            points=_survey(given),
            date=given.date,
            operator=given.operator,
            focus=given.focus,
            camera=stated_camera(arguments, fleet),
            for_registry=writes_registry(arguments),
        )
    with Bar(note(arguments), "flight:") as bar:
        return calibrate_flight(
            given.images,
            most=given.most or 30,
            start=given.start,
            fleet=fleet,
            from_registry=given.from_registry,
            lens_model=given.lens_model,
            max_side=round(given.max_side or 1600),
            points=_survey(given),
            date=given.date,
            operator=given.operator,
            focus=given.focus,
            camera=stated_camera(arguments, fleet),
            for_registry=writes_registry(arguments),
            progress=bar,
        )


def _count(text: str) -> int:
    if not text.isdecimal() or not 3 <= int(text[:6]) <= 200:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a whole number of images, 3 … 200")
    return int(text)
