"""``calibrary undistort``: pictures as a pinhole would have taken them, and the K that then holds beside them."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.reading import Answers, add_reading_flags, image_size
from calibrary.cli.undistort_work import (
    ALPHAS,
    SAME_FOCAL,
    Cameras,
    Done,
    Job,
    refuse_the_calibration,
    undistorted,
)
from calibrary.errors import InputError

if TYPE_CHECKING:
    from calibrary.calibration import Calibration, ImageSize

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Take a lens's distortion out of images, and write the K that then holds beside them."
EXAMPLES = """\
examples:
  calibrary undistort flight/ --calibration camera.xml              into ./undistorted, K unchanged
  calibrary undistort a.jpg --calibration camera.xml --keep all     no pixel is lost
  calibrary undistort a.jpg --calibration camera.xml --keep valid   no pixel is empty
  calibrary undistort *.tif --calibration rig.xml --camera 2 --keep all --size same-focal
  calibrary undistort flight/ --calibration camera.xml --to colmap_text --mask

The new K is written beside the pictures, with no distortion. Pictures are taken as stored: EXIF's orientation
turns nothing. EXIF (without maker's notes and thumbnail; without focal lengths where these change) and colour
profile are kept in JPEG and PNG; XMP is not, for cameras keep their distortion there: it says "lens profile
applied" instead. TIFFs keep pixels alone.

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
        help="where to write (default: ./undistorted)",
    )
    parser.add_argument("--force", action="store_true", help="replace what is there already")
    _add_view_flags(parser)
    _add_output_flags(parser)
    add_reading_flags(parser)
    add_json_flag(parser)


def _add_view_flags(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("what the new pictures show")
    choice = group.add_mutually_exclusive_group()
    choice.add_argument(
        "--keep",
        choices=tuple(ALPHAS),
        default="same",
        help="same: K as it is (default); all: every pixel; valid: what leaves no pixel empty",
    )
    choice.add_argument(
        "--alpha", type=_alpha, metavar="A", help="between valid (0) and all (1), as OpenCV's alpha"
    )
    group.add_argument(
        "--size",
        type=_size,
        metavar="WxH|same-focal",
        help="size in px (default: the image's); same-focal: as many as keep the focal length in px",
    )
    group.add_argument(
        "--max-angle",
        type=float,
        default=80.0,
        metavar="DEG",
        help="of wide lenses, show so much off the axis (default: 80; a plane ends before 90)",
    )


def _add_output_flags(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("how they are written")
    group.add_argument(
        "--interpolation",
        choices=INTERPOLATIONS,
        default="cubic",
        help="default: cubic; nearest for masks and labels",
    )
    group.add_argument("--as", dest="kind", choices=KINDS, help="file type (default: the image's own)")
    group.add_argument("--quality", type=_quality, default=95, metavar="1-100", help="of JPEGs (default: 95)")
    group.add_argument("--mask", action="store_true", help="also write a mask of what is not empty")
    group.add_argument(
        "--to",
        default="opencv_storage",
        metavar="FORMAT",
        help="the new K's format (default: opencv_storage)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from rich.progress import track

    from calibrary.cli.console import note, out
    from calibrary.cli.undistort_display import report_of, show
    from calibrary.parsers.discovery import format_named

    calibration = _calibration(arguments)
    record = format_named(arguments.to)
    jobs = list(_jobs(arguments.images, arguments.out, arguments.kind))
    cameras = Cameras(arguments=arguments, calibration=calibration, record=record)
    _refuse_what_is_there(jobs, cameras.path(), arguments)
    cameras.rehearse()
    remarks = note(arguments)
    quiet = len(jobs) < 2 or not remarks.is_terminal or remarks.quiet
    tracked = track(jobs, "undistorting", console=remarks, transient=True, disable=quiet)
    done: list[Done] = []
    try:
        done.extend(undistorted(job, cameras) for job in tracked)
    except KeyboardInterrupt as error:
        error.args = (f"{len(done)} of {len(jobs)} images were undistorted",)
        raise
    if arguments.json:
        print_json(report_of(arguments, done, cameras.by_size))
    else:
        show(out(arguments), done, cameras.by_size, arguments.out)
    return EXIT_UNREADABLE if any(one.error is not None for one in done) else 0


def _calibration(arguments: argparse.Namespace) -> Calibration:
    """The one camera to undistort with.

    Raises:
        InputError: the file holds several, none of that number, or only a guess.
    """
    found = Answers.of(arguments).read(arguments.calibration)
    if arguments.camera is None and len(found) > 1:
        listed = "; ".join(f"{number} {one.camera}" for number, one in enumerate(found, start=1))
        raise InputError(
            f"holds {len(found)} cameras; say which took the images with --camera: {listed:.2000}",
            source=arguments.calibration.name,
        )
    number = arguments.camera or 1
    if not 1 <= number <= len(found):
        raise InputError(
            f"has no camera {number}; it holds {len(found)}, counted from 1",
            source=arguments.calibration.name,
            place="--camera",
        )
    calibration = found[number - 1]
    if not calibration.grade.is_metric:
        raise InputError(
            f"its K is a {calibration.grade.value}, a guess; pictures undistorted with it would pass for a "
            "pinhole's. Wanted a calibration",
            source=arguments.calibration.name,
        )
    return calibration


def _jobs(given: Sequence[Path], out: Path, kind: str | None) -> Iterator[Job]:
    """Every image, and its place below ``out`` as it lay below the folder that was given."""
    from calibrary.jobs.extract.gather import find_images

    target = out.resolve()
    for path in given:
        if not path.is_dir():
            yield Job(image=path, output=_renamed(out / path.name, kind))
            continue
        images = [one for one in find_images(path, recursive=True) if target not in one.resolve().parents]
        if not images:
            raise InputError("holds no image", source=str(path))
        for image in images:
            yield Job(image=image, output=_renamed(out / image.relative_to(path), kind))


def _renamed(path: Path, kind: str | None) -> Path:
    same = {"jpg": {".jpg", ".jpeg", ".jpe"}, "tif": {".tif", ".tiff"}, "png": {".png"}}
    if kind is None or path.suffix.lower() in same[kind]:
        return path
    return path.with_suffix(f".{kind}")


def _refuse_what_is_there(jobs: Sequence[Job], camera: Path, arguments: argparse.Namespace) -> None:
    """Settle before anything is written what would be overwritten.

    Raises:
        InputError: an image itself, one output by another, or, unless forced, what is there already.
    """
    images = {job.image.resolve() for job in jobs}
    outputs: dict[Path, Path] = {}
    for job in jobs:
        output = job.output.resolve()
        if output in images:
            raise InputError(
                "it would overwrite an image it is made from; give another --out", source=str(job.output)
            )
        other = outputs.setdefault(output, job.image)
        if other != job.image:
            raise InputError(
                f"both {other} and {job.image} would be written there; undistort them one by one",
                source=str(job.output),
            )
    refuse_the_calibration(camera, arguments)
    there = (
        [] if arguments.force else [path for path in (camera, *(job.output for job in jobs)) if path.exists()]
    )
    if there:
        more = f" (and {len(there) - 1} more)" if len(there) > 1 else ""
        raise InputError(
            f"is there already{more}; --force replaces it, --out writes elsewhere", source=str(there[0])
        )


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
    return SAME_FOCAL if text == SAME_FOCAL else image_size(text)
