"""TIFF files: classic, BigTIFF and DNG, of one page or many.

The size is that of the full-resolution image: IFD0, unless it states that it is a reduced copy
(NewSubfileType bit 0, as in DNG, in which IFD0 is the thumbnail), else the largest full image among the pages
and SubIFDs. Strips and tiles are not read. The size of a DNG is that of the raw image, before DefaultCrop.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from calibrary.calibration import ImageSize
from calibrary.errors import ParseError
from calibrary.evidence.metadata import TagFault
from calibrary.parsers.imagery.directory import Directory, Tiff
from calibrary.parsers.imagery.exif import (
    EXIF_POINTER,
    TAG_NAMES,
    ExifFields,
    ExifTag,
    decode,
    read_directories,
)
from calibrary.parsers.imagery.head import MAX_XMP_BYTES, Head, checked_size
from calibrary.parsers.imagery.source import Source

SIGNATURES = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")

NEW_SUBFILE_TYPE, SUBFILE_TYPE, WIDTH, LENGTH, SUB_IFDS = 0x00FE, 0x00FF, 0x0100, 0x0101, 0x014A
XMP, GDAL_METADATA = 0x02BC, 0xA480
_WANTED = frozenset(TAG_NAMES) | {
    EXIF_POINTER,
    NEW_SUBFILE_TYPE,
    SUBFILE_TYPE,
    WIDTH,
    LENGTH,
    SUB_IFDS,
    XMP,
    GDAL_METADATA,
}

MAX_PAGES = 64
MAX_GDAL_BYTES = 1024 * 1024
_NOT_THE_IMAGE = 0b1101
"""NewSubfileType: reduced resolution, transparency mask, depth map. A page of many (bit 1) is an image."""
_PLAIN_TIFF_TAGS = frozenset({ExifTag.ORIENTATION, ExifTag.SOFTWARE})
"""Tags that every scanner program writes; they do not count as EXIF."""


class TiffHead(Struct, frozen=True, kw_only=True):
    """A TIFF's header, and the EXIF fields, which are in its own directories."""

    head: Head
    exif: ExifFields
    has_exif: bool


def read_tiff(source: Source) -> TiffHead:
    """Read size, EXIF values, XMP packet (tag 700) and GDAL metadata (tag 42112) of a TIFF.

    Raises:
        ParseError: its first directory cannot be read, or no directory describes an image.
    """
    tiff = Tiff(source.block())
    first = tiff.directory(tiff.first, _WANTED)
    children = tuple(_children(tiff, first))
    size = _full_size(tiff, first, children)
    if size is None:
        raise source.broken("the TIFF has no directory with an image width and length")
    exif = read_directories(tiff, first)
    packet = _bulk(tiff, (first, *children), XMP, "XMP", MAX_XMP_BYTES)
    gdal = _bulk(tiff, (first,), GDAL_METADATA, "GDAL_METADATA", MAX_GDAL_BYTES)
    faults = exif.faults + tuple(item for item in (packet, gdal) if isinstance(item, TagFault))
    head = Head(
        size=checked_size(source, *size),
        xmp=(packet,) if isinstance(packet, bytes) else (),
        gdal_metadata=gdal if isinstance(gdal, bytes) else None,
        faults=faults,
    )
    has_exif = EXIF_POINTER in first.entries or bool(decode(exif).keys() - _PLAIN_TIFF_TAGS)
    return TiffHead(head=head, exif=exif, has_exif=has_exif)


def _full_size(tiff: Tiff, first: Directory, children: tuple[Directory, ...]) -> ImageSize | None:
    if _is_full(tiff, first) and (size := _size(tiff, first)):
        return size
    pages = [first, *children, *_following(tiff, first)]
    sizes = [(_is_full(tiff, page), size) for page in pages if (size := _size(tiff, page))]
    return max(sizes, key=lambda item: (item[0], item[1][0] * item[1][1]))[1] if sizes else None


def _size(tiff: Tiff, page: Directory) -> ImageSize | None:
    width, length = _integer(tiff, page, WIDTH), _integer(tiff, page, LENGTH)
    return (width, length) if width is not None and length is not None else None


def _is_full(tiff: Tiff, page: Directory) -> bool:
    old_reduced_image = 2
    return not (_integer(tiff, page, NEW_SUBFILE_TYPE) or 0) & _NOT_THE_IMAGE and (
        _integer(tiff, page, SUBFILE_TYPE) != old_reduced_image
    )


def _integer(tiff: Tiff, page: Directory, tag: int) -> int | None:
    values = tiff.integers(page.entries[tag]) if tag in page.entries else ()
    return values[0] if values else None


def _children(tiff: Tiff, page: Directory) -> Iterator[Directory]:
    """Yield the SubIFDs of a page; unreadable ones are skipped."""
    offsets = tiff.integers(page.entries[SUB_IFDS], MAX_PAGES) if SUB_IFDS in page.entries else ()
    for offset in dict.fromkeys(offsets):
        try:
            yield tiff.directory(offset, _WANTED)
        except ParseError:
            continue


def _following(tiff: Tiff, page: Directory) -> Iterator[Directory]:
    """Yield the pages after ``page``, until the chain ends or repeats."""
    seen: set[int] = set()
    while page.next_offset and page.next_offset not in seen and len(seen) < MAX_PAGES:
        seen.add(page.next_offset)
        try:
            page = tiff.directory(page.next_offset, _WANTED)
        except ParseError:
            return
        yield page


def _bulk(
    tiff: Tiff, pages: tuple[Directory, ...], tag: int, name: str, limit: int
) -> bytes | TagFault | None:
    """The first value of a long tag in any page; DJI's DNG files have their XMP in a SubIFD."""
    for page in pages:
        if tag in page.entries:
            return tiff.value(name, page.entries[tag], limit)
    return None
