"""``calibrary calibrate FRAMES``: calibrate a camera from frames of a board; gives verdict, report, registry entry."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.calibrate.flags import (
    add_board_flags,
    add_file_flags,
    add_provenance_flags,
    add_registry_flags,
    add_solving_flags,
)
from calibrary.cli.camera_flags import add_camera_flags, camera_of
from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.progress import Bar
from calibrary.cli.registry.asking import agreed, can_ask
from calibrary.cli.registry.place import opened

if TYPE_CHECKING:
    from collections.abc import Callable

    from calibrary.api.boards import CalibrateResult, Places
    from calibrary.api.combining import CombineResult
    from calibrary.calibration import CameraKey
    from calibrary.cli.calibrate.solve_display import Display
    from calibrary.jobs.fleet import Fleet

__all__ = [
    "DESCRIPTION",
    "EXAMPLES",
    "EXIT_NOT_PASSED",
    "add_arguments",
    "check_outputs",
    "finish",
    "keep",
    "run",
    "stated_camera",
    "writes_registry",
]

DESCRIPTION = """\
Compute a camera's K and distortion from frames of a calibration board, and report how far to trust them.

FRAMES are files, folders and patterns: the frames of one camera at one focus. The verdict is PASS, PROVISIONAL or
REFUSE, with every reason and what to do next. A provisional calibration becomes a draft at most, with the larger
standard deviation that it states. A refused one writes only a report and its corners.
"""
EXAMPLES = """\
examples:
  calibrary calibrate frames/ --board checkerboard:11x8 --square-mm 40 --report camera.html
  calibrary calibrate 'frames/*.JPG' --square-mm 40 --out camera.xml --to agisoft_xml
  calibrary calibrate frames/ --board charuco:8x5 --square-mm 30 --corners corners.json --registry ../fleet
  calibrary calibrate --from corners.json --lens-model rational --json
  calibrary calibrate --from corners.vnl --board checkerboard:10x10 --image-size 6000x3376
  calibrary calibrate --points gcp.csv --image-size 5472x3648 --seed-k K_matrix_seed.npy --report camera.html

exit codes: 0 PASS; 1 PROVISIONAL or REFUSE, no board, or an error of the registry's check; 3 unreadable input
"""
EXIT_NOT_PASSED = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of a calibration."""
    parser.add_argument("frames", type=Path, nargs="*", metavar="FRAMES", help="files, folders or patterns")
    add_board_flags(
        parser,
        "side of a square; K does not depend on it; without it, poses and the board's warp are in squares",
    )
    parser.add_argument(
        "--skip-other-sizes",
        action="store_true",
        help="skip frames of another size than most frames (default: such a frame ends the run)",
    )
    others = parser.add_argument_group("in place of frames")
    others.add_argument(
        "--from",
        dest="corners_in",
        type=Path,
        metavar="CORNERS",
        help="the corners.json of an earlier run, or the corners of another detector: corners.vnl of mrcal and "
        "mrgingham, or a CSV with the columns image, x, y and id; these need --board, and also --image-size if "
        "the frames that they name are not beside them",
    )
    others.add_argument(
        "--points",
        type=Path,
        metavar="CSV",
        help="points at known places: a table of X,Y,Z,u,v,image in metres and px; needs --image-size",
    )
    others.add_argument(
        "--pixel-origin",
        choices=("corner", "centre"),
        help="pixel origin of a table: the outer corner of the first pixel (default of --points), or its centre as in "
        "OpenCV and mrcal (default of --from)",
    )
    outputs = add_file_flags(parser)
    outputs.add_argument("--corners", type=Path, metavar="FILE", help="keep the corners for --from, .json")
    add_registry_flags(parser).add_argument(
        "--as", dest="as_key", metavar="KEY", help="propose it for the camera of this entry"
    )
    add_provenance_flags(parser)
    add_camera_flags(parser)
    add_solving_flags(parser).add_argument(
        "--seed-k", type=Path, metavar="FILE", help="a K to start from, such as the seed that extract writes"
    )
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.api.boards import Places
    from calibrary.cli.calibrate.solve_display import Display

    _check_usage(arguments)
    given = arguments
    places = Places(report=given.report, corners=given.corners, out=given.out, format=given.to)
    places.check()
    fleet = opened(arguments) if writes_registry(arguments) else None
    display = Display(arguments)
    done = _calibrated(arguments, fleet)
    return finish(arguments, places, fleet, display, done)


def finish(
    arguments: argparse.Namespace,
    places: Places,
    fleet: Fleet | None,
    display: Display,
    done: CalibrateResult,
) -> int:
    """Show a calibration and write the requested outputs; returns the exit code that follows from the verdict."""
    display.show(done.result, done.collected, correlations=arguments.correlations)
    display.show_files(done.write(places))
    kept = fleet is None or keep(arguments, fleet, done, display)
    display.verdict(done.result, done.collected)
    if arguments.json:
        print_json(done.to_dict(), indent=None)
    return 0 if done.is_good and kept else EXIT_NOT_PASSED


def _calibrated(arguments: argparse.Namespace, fleet: Fleet | None) -> CalibrateResult:
    from calibrary.api.boards import calibrate
    from calibrary.cli.console import note

    given = arguments
    with Bar(note(arguments), "finding the board in") as bar:
        return calibrate(
            given.frames or None,
            square_mm=given.square_mm,
            board=given.board,
            marker_mm=given.marker_mm,
            corners=given.corners_in,
            points=given.points,
            image_size=given.image_size,
            pixel_origin=given.pixel_origin,
            lens_model=given.lens_model,
            warp=not given.no_warp,
            seed_k=given.seed_k,
            date=given.date,
            operator=given.operator,
            focus=given.focus,
            camera=stated_camera(arguments, fleet),
            keep_corners=given.corners,
            for_registry=fleet is not None,
            skip_other_sizes=given.skip_other_sizes,
            workers=given.workers,
            progress=bar,
        )


def stated_camera(arguments: argparse.Namespace, fleet: Fleet | None) -> Callable[[CameraKey], CameraKey]:
    """Function that completes the camera's key from the entry to replace and from flags, which take precedence."""
    from calibrary.api.boards import camera_of_entry

    if fleet is None or arguments.as_key is None:
        return partial(camera_of, arguments)
    of_entry = camera_of_entry(fleet, arguments.as_key)
    return lambda known: camera_of(arguments, of_entry(known))


def _check_usage(arguments: argparse.Namespace) -> None:
    """End with a usage error if the flags cannot be combined."""
    parser = arguments.parser
    given = [bool(arguments.frames), arguments.corners_in is not None, arguments.points is not None]
    if sum(given) != 1:
        parser.error("expected frames, --from CORNERS or --points CSV, and one of them only")
    table = arguments.corners_in is not None and arguments.corners_in.suffix.lower() != ".json"
    if not (arguments.frames or table) and (arguments.board or arguments.square_mm or arguments.marker_mm):
        parser.error(
            "--board, --square-mm and --marker-mm are of frames and of other detectors' corners; what a corners.json "
            "and --points hold is known"
        )
    if arguments.marker_mm is not None and arguments.square_mm is None:
        parser.error("--marker-mm needs the size of the squares too: say --square-mm MM")
    if arguments.points is not None and arguments.image_size is None:
        parser.error("--points needs the size of the images: say --image-size WxH")
    check_outputs(arguments)


def check_outputs(arguments: argparse.Namespace) -> None:
    """End with a usage error if a flag of files or of the registry lacks the flag it depends on."""
    parser = arguments.parser
    if arguments.to is not None and arguments.out is None:
        parser.error("--to is the format of --out FILE, which is missing")
    if writes_registry(arguments):
        if not arguments.yes and not can_ask():
            parser.error(
                "not a terminal, so nothing can be confirmed before the registry is written: give --yes"
            )
    elif arguments.approve or arguments.reason or arguments.override_held:
        parser.error(
            "--approve, --reason and --override-held are of a registry: say --registry PATH or --as KEY"
        )


def writes_registry(arguments: argparse.Namespace) -> bool:
    """Whether the flags ask for a registry entry."""
    return arguments.registry is not None or arguments.as_key is not None


def keep(
    arguments: argparse.Namespace, fleet: Fleet, done: CalibrateResult | CombineResult, display: Display
) -> bool:
    """Write the entry if the verdict, the check and the user allow it; returns whether there was no objection."""
    if done.verdict.value == "refuse":
        display.say("a refused calibration becomes no entry; nothing was written into the registry")
        return False
    if arguments.approve and not done.is_good:
        display.say("only a calibration that passes is approved; this one becomes a draft at most")
    change = fleet.propose_entry(
        done.entry,
        approve=arguments.approve and done.is_good,
        reason=arguments.reason,
        override_held=arguments.override_held,
    )
    [proposal] = change.proposals.items
    display.show_entry(proposal, change.proposals.findings)
    if change.proposals.errors:
        display.say("the check objects, so nothing was written into the registry")
        return False
    if not proposal.changes:
        return True
    if not agreed(arguments, f"Write {proposal.entry.id}?"):
        display.say("nothing was written into the registry")
        return True
    display.written(change.write(arguments.reason), proposal, done.verdict)
    return True
