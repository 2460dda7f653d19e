"""Flags that identify a camera, shared by all commands that need a camera key without reading an image."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.reading import image_size

if TYPE_CHECKING:
    from calibrary.calibration import CameraKey

__all__ = ["add_camera_flags", "add_label_flag", "camera_of"]

TEXTS = ("make", "model", "sub_camera", "lens", "capture_mode", "firmware")


def add_camera_flags(parser: argparse.ArgumentParser, *, with_image_size: bool = True) -> None:
    """Add ``--make --model --sub-camera --lens --focal-mm --capture-mode --image-size --serial --firmware``."""
    group = parser.add_argument_group("which camera", "what the file or image does not say, or says wrong")
    group.add_argument("--make", metavar="NAME", help="as EXIF writes it")
    group.add_argument("--model", metavar="NAME", help="as EXIF writes it")
    group.add_argument(
        "--sub-camera", metavar="NAME", help="wide, tele, thermal, a band: cameras of one model"
    )
    group.add_argument("--lens", metavar="NAME", help="of a camera whose lens comes off")
    group.add_argument(
        "--focal-mm", type=float, metavar="MM", help="nominal focal length, or the zoom's state"
    )
    group.add_argument(
        "--capture-mode", metavar="NAME", help='what the camera does to the frame: "dewarped", …'
    )
    if with_image_size:
        group.add_argument(
            "--image-size", type=image_size, metavar="WxH", help="frame that K counts in, in px"
        )
    group.add_argument("--serial", metavar="NUMBER", help="of one unit; only a hash of it is kept")
    group.add_argument("--firmware", metavar="VERSION", help="as the camera writes it")


def add_label_flag(parser: argparse.ArgumentParser) -> None:
    """Add ``--label``."""
    parser.add_argument(
        "--label", metavar="NAME", help="what you call the unit, as P4R-03; a KEY from then on"
    )


def camera_of(arguments: argparse.Namespace, known: CameraKey) -> CameraKey:
    """The camera key ``known``, with the fields that the user stated replaced."""
    from calibrary.records import replace

    said: dict[str, str] = {
        name: getattr(arguments, name) for name in TEXTS if getattr(arguments, name) is not None
    }
    key = replace(known, **said)
    if arguments.focal_mm is not None:
        key = replace(key, focal_mm=arguments.focal_mm)
    if arguments.image_size is not None:
        key = replace(key, image_size=arguments.image_size)
    if arguments.serial is not None:
        from calibrary.api.stated import hash_serial

        key = replace(key, serial=hash_serial(key.make, arguments.serial))
    return key
