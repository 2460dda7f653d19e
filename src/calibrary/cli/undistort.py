"""``calibrary undistort``: undistort images, and write the K that applies to the undistorted images."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.progress import Bar
from calibrary.cli.reading import add_reading_flags, image_size, reading_of

if TYPE_CHECKING:
    from calibrary.calibration import ImageSize

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Remove lens distortion from images, and write the new K beside them."
EXAMPLES = """\
examples:
  calibrary undistort flight/ --calibration camera.xml              into ./undistorted
  calibrary undistort a.jpg --calibration camera.xml --keep all     no pixel is lost
  calibrary undistort a.jpg --calibration camera.xml --keep valid   no pixel is empty
  calibrary undistort *.tif --calibration rig.xml --camera 2 --keep all --size same-focal
  calibrary undistort flight/ --calibration camera.xml --to colmap_text --mask

The new K is written beside the pictures, without distortion. The orientation of EXIF is not applied. JPEG and PNG
keep the colour profile and EXIF (without maker's notes and thumbnail; without focal lengths if these change). They do
not keep XMP, because cameras store their distortion there; it states "lens profile applied" instead. TIFFs keep only
the pixels.

exit code 0: every picture was undistorted; 3: at least one was not.
"""

EXIT_UNREADABLE = 3
Size: TypeAlias = "ImageSize | Literal['same-focal'] | None"
INTERPOLATIONS = ("nearest", "linear", "cubic", "lanczos")
KINDS = ("jpg", "png", "tif")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("images", nargs="+", type=Path, metavar="IMAGE", help="images, or folders of them")
    parser.add_argument(
        "--calibration", type=Path, required=True, metavar="FILE", help="the camera's calibration file"
    )
    parser.add_argument("--camera", type=int, metavar="N", help="the Nth camera of a file with several")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("undistorted"),
        metavar="DIR",
        help="folder to write to (default: ./undistorted)",
    )
    parser.add_argument("--force", action="store_true", help="replace existing files")
    _add_view_flags(parser)
    _add_output_flags(parser)
    add_reading_flags(parser)
    add_json_flag(parser)


def _add_view_flags(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("what the new pictures show")
    choice = group.add_mutually_exclusive_group()
    choice.add_argument(
        "--keep",
        choices=("auto", "same", "all", "valid"),
        default="auto",
        help="auto: same K, or for a wide lens the view that loses least (default); same: same K; all: keep every "
        "pixel; valid: leave no pixel empty",
    )
    choice.add_argument(
        "--alpha", type=_alpha, metavar="A", help="a view between valid (0) and all (1), like OpenCV's alpha"
    )
    group.add_argument(
        "--size",
        type=_size,
        metavar="WxH|same-focal",
        help="size in px (default: that of the image); same-focal: the size that keeps the focal length in px",
    )
    group.add_argument(
        "--max-angle",
        type=float,
        default=80.0,
        metavar="DEG",
        help="largest angle off the axis for wide lenses (default: 80; a plane ends before 90)",
    )


def _add_output_flags(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("how they are written")
    group.add_argument(
        "--interpolation",
        choices=INTERPOLATIONS,
        default="cubic",
        help="default: cubic; nearest for masks and labels",
    )
    group.add_argument("--as", dest="kind", choices=KINDS, help="file type (default: that of the image)")
    group.add_argument(
        "--quality", type=_quality, default=95, metavar="1-100", help="quality of JPEGs (default: 95)"
    )
    group.add_argument(
        "--mask", action="store_true", help="also write a mask of the pixels that are not empty"
    )
    group.add_argument(
        "--to",
        default="opencv_storage",
        metavar="FORMAT",
        help="format of the new K (default: opencv_storage)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.api.pictures import undistort
    from calibrary.cli.console import note, out
    from calibrary.cli.undistort_display import show

    given = arguments
    with Bar(note(arguments), "undistorting") as bar:
        done = undistort(
            given.images,
            given.calibration,
            given.out,
            reading=reading_of(arguments, camera=given.camera),
            keep=given.alpha if given.alpha is not None else given.keep,
            size=given.size,
            max_angle_deg=given.max_angle,
            interpolation=given.interpolation,
            kind=given.kind,
            quality=given.quality,
            mask=given.mask,
            format=given.to,
            force=given.force,
            progress=bar,
        )
    if arguments.json:
        print_json(done.report())
    else:
        show(out(arguments), done)
    return 0 if done.is_good else EXIT_UNREADABLE


def _alpha(text: str) -> float:
    return _number(text, 0.0, 1.0)


def _quality(text: str) -> int:
    value = _number(text, 1, 100)
    if value % 1:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a whole number")
    return int(value)


def _number(text: str, low: float, high: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a number from {low:g} to {high:g}")
    return value


def _size(text: str) -> Size:
    return "same-focal" if text == "same-focal" else image_size(text)
