"""Flags that supply what a calibration file does not state, shared by all commands that read one."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.arguments import Reading
    from calibrary.calibration import ImageSize

__all__ = ["add_reading_flags", "image_size", "reading_of"]

LARGEST_MIB = 1 << 20


def reading_of(arguments: argparse.Namespace, *, camera: int | None = None) -> Reading:
    """The user's statements about files, from the flags of :func:`add_reading_flags`.

    Args:
        arguments: of the command.
        camera: number of one of several cameras, from 1.
    """
    from calibrary.arguments import Reading

    return Reading(
        format=arguments.format,
        image_size=arguments.image_size,
        size_from_centre=arguments.size_from_centre,
        set=dict(arguments.set or ()),
        camera=camera,
        max_size_mib=arguments.max_size or 64,
    )


def add_reading_flags(parser: argparse.ArgumentParser) -> None:
    """Add ``--format``, ``--image-size``, ``--size-from-centre``, ``--set`` and ``--max-size-mib``."""
    parser.add_argument(
        "--format", metavar="NAME", help="format of the file, if the file itself does not show it"
    )
    parser.add_argument(
        "--image-size", type=image_size, metavar="WxH", help="image size in px, if the file states none"
    )
    parser.add_argument(
        "--size-from-centre",
        action="store_true",
        help="if nothing states the image size, assume twice the principal point",
    )
    parser.add_argument(
        "--set",
        action="append",
        type=_option,
        metavar="NAME=VALUE",
        help="an answer that only the owner of the file knows, as the error message asks for it",
    )
    parser.add_argument(
        "--max-size-mib",
        dest="max_size",
        type=_mebibytes,
        metavar="MIB",
        help="largest file that is read, in MiB (default: 64)",
    )


def image_size(text: str) -> ImageSize:
    """Parse "5472x3648" to (width, height)."""
    width, _, height = text.lower().replace("×", "x").partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) > 0 and int(height) > 0):
        raise argparse.ArgumentTypeError(f"{text!r}: expected WxH in whole pixels, such as 5472x3648")
    return int(width), int(height)


def _mebibytes(text: str) -> int:
    if not text.isdecimal() or not 0 < int(text) <= LARGEST_MIB:
        raise argparse.ArgumentTypeError(f"{text!r}: expected whole MiB, 1 to {LARGEST_MIB}")
    return int(text)


def _option(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise argparse.ArgumentTypeError(f"{text!r}: expected NAME=VALUE")
    return name, value
