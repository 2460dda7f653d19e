"""``calibrary calibrate synth``: frames of a board under a camera that is known exactly."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.calibrate.flags import add_size_flags, board_of, number
from calibrary.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from calibrary.calib.board import Board
    from calibrary.calib.synthesis import Settings, Truth
    from calibrary.calibration import Calibration
    from calibrary.known_camera import KnownCamera
    from calibrary.synthetic import Head

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = """\
Render frames of a board as a camera would have taken them, and write the truth beside them: K, distortion,
poses and corners in OUT/truth.json. So a set-up can be judged before anybody prints a board.
"""
EXAMPLES = """\
examples:
  calibrary calibrate synth frames/ --board checkerboard:11x8 --square-mm 40
  calibrary calibrate synth frames/ --board checkerboard:11x8 --square-mm 40 --camera FC6310 --bow-mm 0.2
  calibrary calibrate synth frames/ --board charuco:8x5 --square-mm 30 --calibration camera.yaml --blur 1.5
"""
LARGEST_COUNT = 1000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the word's arguments."""
    parser.add_argument("out", type=Path, metavar="OUT", help="a new or an empty folder")
    parser.add_argument("--board", required=True, metavar="BOARD", help="which board: checkerboard:11x8")
    add_size_flags(parser)
    parser.add_argument("--frames", type=_count, default=20, metavar="N", help="how many (default: 20)")
    parser.add_argument("--seed", type=_seed, default=1, metavar="N", help="the same seed, the same frames")
    camera = parser.add_mutually_exclusive_group()
    camera.add_argument(
        "--camera", metavar="NAME", help="a unit of a camera of the catalogue, by its Model or name"
    )
    camera.add_argument("--calibration", type=Path, metavar="FILE", help="the calibration to photograph with")
    poses = parser.add_argument_group("how the board is held")
    poses.add_argument(
        "--max-tilt-deg", type=number(0, 80), default=35.0, metavar="DEG", help="(default: 35)"
    )
    poses.add_argument(
        "--reach",
        type=number(0.05, 1),
        default=1.0,
        metavar="SHARE",
        help="share of the frame, about its middle, that is covered (default: 1)",
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
        "--quality", type=_quality, default=92, metavar="Q", help="of the JPEG (default: 92)"
    )


_FLAGS = (
    ("--blur", (0.0, 50.0), 0.8, "PX", "standard deviation of the blur"),
    ("--motion-px", (0.0, 200.0), 0.0, "PX", "motion along x while the shutter is open"),
    ("--noise", (0.0, 100.0), 2.0, "LEVELS", "standard deviation of the noise, of 255"),
    ("--glare", (0.0, 100.0), 0.0, "LIGHT", "of a lamp's mirror image; 1 saturates"),
    ("--bow-mm", (-100.0, 100.0), 0.0, "MM", "how far the board's middle stands behind its ends"),
    ("--stretch-pct", (-10.0, 10.0), 0.0, "PCT", "how much wider the print came out than asked for"),
    ("--readout-ms", (0.0, 1000.0), 0.0, "MS", "of a rolling shutter, first to last row"),
    ("--turn-deg-s", (-1000.0, 1000.0), 0.0, "DEG", "how fast the camera turns to the side meanwhile"),
)


def run(arguments: argparse.Namespace) -> int:
    """Render and write."""
    from calibrary.calib.synthesis import Truth, poses
    from calibrary.calib.synthesis.cameras import head
    from calibrary.calib.synthesis.files import check_empty
    from calibrary.cli.console import out, plain

    check_empty(arguments.out)
    board = board_of(arguments.board, arguments)
    calibration, known = _camera(arguments)
    settings = _settings(board, arguments)
    chosen = poses(
        board,
        calibration,
        arguments.frames,
        arguments.seed,
        max_tilt_deg=arguments.max_tilt_deg,
        reach=arguments.reach,
    )
    truth = Truth(board=board, calibration=calibration, poses=chosen, settings=settings)

    def head_of(number: int) -> Head:
        return head(calibration, known, number)

    _write(arguments, truth, head_of)
    K = calibration.intrinsics
    out(arguments).say(
        f"wrote {len(chosen)} frames of {K.image_size[0]}×{K.image_size[1]} px by {plain(str(calibration.camera))} to "
        f"{plain(str(arguments.out))}, and K (fx {K.fx:.2f} px) with everything else that is true in truth.json"
    )
    return 0


def _camera(arguments: argparse.Namespace) -> tuple[Calibration, KnownCamera | None]:
    """The camera to photograph with, and what the catalogue says of its model."""
    from calibrary.calib.synthesis.cameras import example_camera, unit_of

    if arguments.calibration is not None:
        return _from_file(arguments.calibration), None
    if arguments.camera is None:
        return example_camera(arguments.seed), None
    known = _known(arguments.camera)
    return unit_of(known, arguments.seed), known


def _from_file(path: Path) -> Calibration:
    from calibrary import parsers

    calibrations = parsers.read(path)
    if len(calibrations) != 1:
        raise InputError(
            f"holds {len(calibrations)} cameras; expected a file with one, which 'calibrary convert --camera N' writes",
            source=path.name,
        )
    return calibrations[0]


def _known(name: str) -> KnownCamera:
    """The one camera of the catalogue that bears a name, or has it as a part of one."""
    from calibrary.catalogue import load_catalogue

    found: Sequence[KnownCamera] = load_catalogue().search(name)
    wanted = name.strip().casefold()
    exact = [
        camera
        for camera in found
        if wanted in {camera.title.casefold(), *(model.casefold() for model in camera.models)}
    ]
    found = exact or found
    if len(found) != 1:
        titles = "; ".join(camera.title for camera in found[:8])
        raise InputError(
            f"camera {name!r}: the catalogue has "
            + (
                f"{len(found)} like it ({titles}{' …' if len(found) > 8 else ''})"
                if found
                else "none like it"
            )
            + "; expected one Model or title of those that 'calibrary catalogue' lists"
        )
    return found[0]


def _settings(board: Board, arguments: argparse.Namespace) -> Settings:
    from calibrary.calib.synthesis import Settings, Sheet, Shutter

    return Settings(
        sheet=Sheet.bowed(board, arguments.bow_mm, (1 + arguments.stretch_pct / 100, 1.0)),
        shutter=Shutter(readout_s=arguments.readout_ms / 1000, rate_deg_s=(0.0, arguments.turn_deg_s, 0.0)),
        blur_px=arguments.blur,
        motion_px=(arguments.motion_px, 0.0),
        noise=arguments.noise,
        glare=arguments.glare,
        quality=arguments.quality,
    )


def _write(arguments: argparse.Namespace, truth: Truth, head: Callable[[int], Head]) -> None:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from calibrary.calib.synthesis.files import write_frames
    from calibrary.cli.console import note

    columns = TextColumn("rendering"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    remarks = note(arguments)
    with Progress(*columns, console=remarks, transient=True, disable=remarks.quiet) as progress:
        task = progress.add_task("rendering", total=len(truth.poses))
        write_frames(
            arguments.out, truth, arguments.seed, head, lambda count: progress.update(task, completed=count)
        )


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
