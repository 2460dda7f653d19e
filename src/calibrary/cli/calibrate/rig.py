"""``calibrary calibrate --rig``: calibrate the lenses and relative poses of cameras that form a rig."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.calibrate.flags import (
    add_board_flags,
    add_provenance_flags,
    add_registry_flags,
    add_solving_flags,
)
from calibrary.cli.calibrate.solve import EXIT_NOT_PASSED
from calibrary.cli.camera_flags import add_camera_flags, camera_of
from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.progress import Bar
from calibrary.cli.registry.asking import agreed, can_ask
from calibrary.cli.registry.place import opened

if TYPE_CHECKING:
    from calibrary.api.rigs import CalibrateRigResult
    from calibrary.cli.calibrate.rig_display import RigDisplay
    from calibrary.jobs.fleet import Fleet

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = """\
Compute K and distortion of every camera of a rig and their poses relative to one another, in one adjustment.

FRAMES are folders, one for each camera, in which frames of one shot have the same name or number; or a folder or
files whose names state camera and shot: MicaSense (IMG_0001_1.tif), P4 Multispectral, Mavic 3 Multispectral, Sequoia,
left01/right01, or as --pattern states. If only one camera shows the board in a shot, that frame serves the lens of that
camera. The verdict is PASS, PROVISIONAL or REFUSE, for each camera and for the rig.
"""
EXAMPLES = """\
examples:
  calibrary calibrate --rig left/ right/ --board checkerboard:11x8 --square-mm 40 --report rig.html
  calibrary calibrate --rig SET/ --square-mm 40 --reference 5 --out rig_config.json
  calibrary calibrate --rig 'shots/*.png' --pattern '{shot}_{camera}.png' --square-mm 40 --out camchain.yaml
  calibrary calibrate --rig left/ right/ --square-mm 40 --compare extrinsics.yml --corners corners/
  calibrary calibrate --rig --from corners/rig.json --registry ../fleet --rig-name mapper-2

exit codes: 0 PASS; 1 PROVISIONAL or REFUSE, no board, or an error of the registry's check; 3 unreadable input
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "frames",
        type=Path,
        nargs="*",
        metavar="FRAMES",
        help="folders, one for each camera; or files, patterns",
    )
    pairing = parser.add_argument_group("which frames belong together")
    pairing.add_argument(
        "--pattern",
        metavar="PATTERN",
        help="how names state it, such as '{camera}/{shot}.png'; * is anything",
    )
    pairing.add_argument("--in-order", action="store_true", help="pair the n-th frames of all folders")
    pairing.add_argument(
        "--reference", metavar="CAMERA", help="the camera to which poses refer (default: the first)"
    )
    pairing.add_argument(
        "--from",
        dest="corners_in",
        type=Path,
        metavar="FILE",
        help="use the rig.json of an earlier run instead of frames",
    )
    add_board_flags(parser, "side of a square; distances scale with it")
    outputs = parser.add_argument_group("what is written")
    outputs.add_argument(
        "--report", "--html", type=Path, metavar="FILE", help="a page with every number and plot, .html"
    )
    outputs.add_argument("--corners", type=Path, metavar="DIR", help="keep the corners for --from")
    outputs.add_argument("--out", type=Path, metavar="FILE", help="the rig as another program's file")
    outputs.add_argument(
        "--to",
        choices=("kalibr", "opencv_stereo", "colmap_rig", "micasense_rig"),
        help="its format (default: by its name: camchain.yaml, extrinsics.yml, rig_config.json)",
    )
    outputs.add_argument(
        "--compare", type=Path, metavar="FILE", help="show how far a file's poses are from these"
    )
    add_registry_flags(parser, "put an entry for each camera into this registry").add_argument(
        "--rig-name", metavar="NAME", help="name of the rig in the entries"
    )
    add_provenance_flags(parser)
    add_camera_flags(parser)
    add_solving_flags(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.api.rigs import RigPlaces
    from calibrary.cli.calibrate.rig_display import RigDisplay

    _check_usage(arguments)
    given = arguments
    places = RigPlaces(report=given.report, corners=given.corners, out=given.out, format=given.to)
    places.check()
    fleet = opened(arguments) if given.registry is not None else None
    display = RigDisplay(arguments)
    done = _calibrated(arguments)
    display.show(done)
    display.show_files(done.write(places))
    kept = fleet is None or _keep(arguments, fleet, done, display)
    display.verdict(done)
    if given.json:
        print_json(done.to_dict(), indent=None)
    return 0 if done.is_good and kept else EXIT_NOT_PASSED


def _calibrated(arguments: argparse.Namespace) -> CalibrateRigResult:
    from calibrary.api.rigs import calibrate_rig
    from calibrary.cli.console import note

    given = arguments
    with Bar(note(arguments), "finding the board in") as bar:
        return calibrate_rig(
            given.frames or None,
            square_mm=given.square_mm,
            board=given.board,
            marker_mm=given.marker_mm,
            corners=given.corners_in,
            pattern=given.pattern,
            in_order=given.in_order,
            reference=given.reference,
            lens_model=given.lens_model,
            warp=not given.no_warp,
            date=given.date,
            operator=given.operator,
            focus=given.focus,
            camera=partial(camera_of, arguments),
            compare=given.compare,
            workers=given.workers,
            progress=bar,
        )


def _check_usage(arguments: argparse.Namespace) -> None:
    """End with a usage error if the flags cannot be combined."""
    parser, given = arguments.parser, arguments
    if bool(given.frames) is (given.corners_in is not None):
        parser.error("expected frames or --from FILE, and one of them only")
    if given.frames and given.square_mm is None:
        parser.error("distances between cameras need the side of a square: say --square-mm MM")
    if given.pattern is not None and given.in_order:
        parser.error("--pattern and --in-order are two ways to pair frames; give one")
    if given.to is not None and given.out is None:
        parser.error("--to is the format of --out FILE, which is missing")
    if given.registry is not None:
        if given.rig_name is None:
            parser.error("entries of a rig name it: say --rig-name NAME")
        if not given.yes and not can_ask():
            parser.error(
                "not a terminal, so nothing can be confirmed before the registry is written: give --yes"
            )
    elif given.approve or given.reason or given.override_held or given.rig_name:
        parser.error(
            "--approve, --reason, --override-held and --rig-name are of a registry: say --registry PATH"
        )


def _keep(arguments: argparse.Namespace, fleet: Fleet, done: CalibrateRigResult, display: RigDisplay) -> bool:
    """Write the entries if the verdict, the check and the user allow it; returns whether there was no objection."""
    if done.verdict.value == "refuse":
        display.say("a refused rig becomes no entries; nothing was written into the registry")
        return False
    if arguments.approve and not done.is_good:
        display.say("only a rig that passes is approved; this one becomes drafts at most")
    change = fleet.propose_entries(
        done.entries(arguments.rig_name),
        approve=arguments.approve and done.is_good,
        reason=arguments.reason,
        override_held=arguments.override_held,
    )
    display.show_entries(change)
    if change.proposals.errors:
        display.say("the check objects, so nothing was written into the registry")
        return False
    if not any(proposal.changes for proposal in change.proposals.items):
        return True
    count = len(change.proposals.items)
    if not agreed(arguments, f"Write {count} entries of the rig {arguments.rig_name}?"):
        display.say("nothing was written into the registry")
        return True
    display.written(change.write(arguments.reason), count)
    return True
