"""What a container reader finds in a file's head, before any of it is understood."""

from __future__ import annotations

from msgspec import Struct

from calibrary.calibration import ImageSize
from calibrary.evidence.metadata import TagFault
from calibrary.parsers.imagery.source import Block, Source

__all__ = ["MAX_SIDE", "MAX_XMP_BYTES", "Head", "checked_size"]

MAX_XMP_BYTES = 2 * 1024 * 1024
"""A packet with a depth map in it can be longer; nothing about the camera is in there. What is built to cost
memory takes some 130 MB as a tree at this length."""

MAX_SIDE = 1 << 24
"""px; sixteen million columns are a broken header, not an image."""


class Head(Struct, frozen=True, kw_only=True):
    """The undigested parts of one image's head.

    Attributes:
        size: (width, height) px as the container states it for the full-resolution image.
        exif: the block that begins with the TIFF byte-order mark.
        xmp: the packets, main one first.
        gdal_metadata: the XML of a GeoTIFF's tag 42112.
        faults: parts that are there but could not be taken.
    """

    size: ImageSize
    exif: Block | None = None
    xmp: tuple[bytes, ...] = ()
    gdal_metadata: bytes | None = None
    faults: tuple[TagFault, ...] = ()


def checked_size(source: Source, width: int, height: int) -> ImageSize:
    """(width, height) if an image can have it.

    Raises:
        ParseError: a side is zero or absurd.
    """
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise source.broken(f"its header claims an image of {width} × {height} pixels")
    return width, height
