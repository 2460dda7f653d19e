"""Result of a container reader: the raw parts of an image's header."""

from __future__ import annotations

from msgspec import Struct

from calibrary.calibration import ImageSize
from calibrary.evidence.metadata import Encoding, TagFault
from calibrary.parsers.imagery.source import Block, Source

MAX_XMP_BYTES = 2 * 1024 * 1024
"""Longest XMP packet. Longer ones contain a depth map and nothing about the camera; a hostile packet of this length
takes about 130 MB as a tree."""

MAX_SIDE = 1 << 24
"""Largest side in px; a larger one means a broken header."""


class Head(Struct, frozen=True, kw_only=True):
    """The unparsed parts of one image's header.

    Attributes:
        size: (width, height) px of the full-resolution image, as stated by the container.
        exif: the block that begins with the TIFF byte-order mark.
        xmp: the packets, main one first.
        gdal_metadata: the XML of a GeoTIFF's tag 42112.
        encoding: of a JPEG.
        faults: parts that are present but unusable.
    """

    size: ImageSize
    exif: Block | None = None
    xmp: tuple[bytes, ...] = ()
    gdal_metadata: bytes | None = None
    encoding: Encoding | None = None
    faults: tuple[TagFault, ...] = ()


def checked_size(source: Source, width: int, height: int) -> ImageSize:
    """(width, height) after checking that an image can have it.

    Raises:
        ParseError: a side is zero or impossibly large.
    """
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise source.broken(f"its header claims an image of {width} × {height} pixels")
    return width, height
