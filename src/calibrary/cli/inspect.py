"""``calibrary inspect``: show what a calibration file or image is, how it was recognised, and what it contains."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.commands import add_json_flag, add_table_flag, check_table_flag, print_json, write_table
from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.cli.tables import facts
from calibrary.jobs.inspect import inspect

if TYPE_CHECKING:
    from calibrary.calibration import Calibration
    from calibrary.cli.console import Screen
    from calibrary.jobs.inspect import UnsizedCalibration
    from calibrary.jobs.inspect.run import InspectedFile, InspectFilesReport
    from calibrary.jobs.tables.rows import Table

DESCRIPTION = "Show what a calibration file or image is, how calibrary recognised it, and what it contains."
EXAMPLES = """\
examples:
  calibrary inspect camera.xml                          what it is, K, distortion, conventions
  calibrary inspect flight/DJI_0001.JPG                 what an image states about its camera
  calibrary inspect flight/DJI_0001.JPG --tags          every EXIF tag of an image, MakerNote included
  calibrary inspect K.npy --image-size 5472x3648
  calibrary inspect handed-over/ --json                 every file of a folder, for machines
  calibrary inspect handed-over/ --table handed-over.csv

exit code 0: every file was read; 1: the same, but a K is hardly a camera's; 3: a file was not read.
"""

NOT_SHOWN = (
    "positions, serial numbers, people's names, thumbnails, binary values, and tags without a known name"
)

EXIT_IMPLAUSIBLE = 1
EXIT_UNREADABLE = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, inspect, positional={"files": "FILE"}, without=["camera"])
    add_json_flag(parser)
    add_table_flag(parser, "the calibrations")


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from msgspec.structs import asdict

    from calibrary.cli.console import note, out
    from calibrary.jobs.inspect.run import InspectReport

    if arguments.tags and arguments.table:
        arguments.parser.error("--table is a table of calibrations; --tags lists tags instead")
    check_table_flag(arguments)
    with Bar(note(arguments), "inspecting") as bar:
        done = call(inspect, arguments, progress=bar)
    write_table(arguments.table, lambda: _as_table(done))
    if arguments.json:
        alone = len(arguments.files) == 1 and not Path(arguments.files[0]).is_dir()
        print_json(InspectReport(**asdict(done.files[0])) if alone else done)
    else:
        screen = out(arguments)
        for one in done.files:
            _show(screen, one)
    if not done.is_read:
        return EXIT_UNREADABLE
    return 0 if done.is_plausible else EXIT_IMPLAUSIBLE


def _as_table(done: InspectFilesReport) -> Table:
    from calibrary.jobs.tables.rows import file_table

    return file_table(done.files)


def _show(screen: Screen, one: InspectedFile) -> None:
    from calibrary.cli.console import plain

    screen.say(f"[bold]{plain(str(one.path))}[/]")
    if one.error is not None:
        screen.say(f"  [red]not read[/]: {plain(one.error)}")
        screen.say("")
        return
    reason = f": {plain(one.why)}" if one.why else ""
    screen.say(f"  {plain(one.title or '')}{reason}")
    if one.tags is not None:
        screen.show(facts([(tag.name, tag.value) for tag in one.tags], screen.width - 2), indent=2)
    if one.tags_left_out:
        screen.say(f"  [dim]{one.tags_left_out} more are not shown: {NOT_SHOWN}[/]")
    for calibration in one.calibrations:
        _show_calibration(screen, calibration)
    for unsized in one.unsized:
        _show_calibration(screen, unsized)
    for reason in one.implausible:
        screen.say(f"  [bold red]an unlikely K[/]: {plain(reason)}")
    for sentence in one.conventions:
        screen.say(f"  [dim]{plain(sentence)}[/]")
    for warning in one.warnings:
        screen.say(f"  [yellow]{plain(warning)}[/]")
    screen.say("")


def _show_calibration(screen: Screen, calibration: Calibration | UnsizedCalibration) -> None:
    from calibrary.cli.console import plain

    K, distortion = calibration.intrinsics, calibration.distortion
    numbers = [
        f"{name} {value:.4f}" if value is not None else f"{name} unknown"
        for name, value in (("fx", K.fx), ("fy", K.fy), ("cx", K.cx), ("cy", K.cy))
    ]
    if K.skew:
        numbers.append(f"skew {K.skew:.6g}")
    frame = f"{K.image_size[0]}×{K.image_size[1]} px" if K.image_size else "an image of unknown size, px"
    lines = [
        f"  [cyan]{plain(str(calibration.camera))}[/]  {calibration.grade.value}",
        f"    {'  '.join(numbers)}  in {frame} from the outer corner",
    ]
    if distortion is None:
        lines.append("    distortion unknown")
    else:
        coefficients = "  ".join(f"{name} {value:.8g}" for name, value in distortion.shown.items())
        lines.append(f"    distortion {distortion.model}  {coefficients}")
    if calibration.quality is not None and calibration.quality.rms_px is not None:
        lines.append(f"    rms {calibration.quality.rms_px:.4g} px")
    lines += [f"    assumed: {plain(text)}" for text in calibration.provenance.assumptions]
    lines += [f"    note: {plain(text)}" for text in calibration.notes]
    for line in lines:
        screen.say(line)
