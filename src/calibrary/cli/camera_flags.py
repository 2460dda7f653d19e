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
    group = parser.add_argument_group("which camera", "for what the file does not state, or states wrongly")
    group.add_argument("--make", metavar="NAME", help="as written in EXIF")
    group.add_argument("--model", metavar="NAME", help="as written in EXIF")
    group.add_argument(
        "--sub-camera", metavar="NAME", help="wide, tele, thermal or a band, if one model has several cameras"
    )
    group.add_argument("--lens", metavar="NAME", help="the lens, if the camera has interchangeable lenses")
    group.add_argument(
        "--focal-mm", type=float, metavar="MM", help="nominal focal length, or that of the zoom"
    )
    group.add_argument(
        "--capture-mode", metavar="NAME", help='what the camera does to the image: "dewarped", …'
    )
    if with_image_size:
        group.add_argument(
            "--image-size", type=image_size, metavar="WxH", help="image size that K belongs to, in px"
        )
    group.add_argument("--serial", metavar="NUMBER", help="serial number; only its hash is stored")
    group.add_argument("--firmware", metavar="VERSION", help="as written by the camera")


def add_label_flag(parser: argparse.ArgumentParser) -> None:
    """Add ``--label``."""
    parser.add_argument(
        "--label", metavar="NAME", help="your name for the unit, as P4R-03; a KEY from then on"
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
        from calibrary.known_camera import hash_serial

        key = replace(key, serial=hash_serial(key.make, arguments.serial))
    return key
