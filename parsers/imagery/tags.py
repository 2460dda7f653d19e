"""All EXIF tags of an image as exifread reads them, MakerNote included: what an unknown camera states.

exifread trusts what a block states, so the amount that it may read is limited. Positions, serial numbers
and people's names are left out, and so are tags that exifread has no name for: in MicaSense's files one of them
contains serial numbers.
"""

from __future__ import annotations

import logging
import os
import re
from typing import BinaryIO, Final, cast

from calibrary.errors import InputError
from calibrary.parsers.imagery.directory import Tiff
from calibrary.parsers.imagery.facts import clean_text
from calibrary.parsers.imagery.reader import begins_as_image
from calibrary.parsers.imagery.source import Block, open_source
from calibrary.parsers.imagery.taken import exif_block

MAX_VALUE: Final = 80
"""Most characters of a value."""

MAX_READS: Final = 400_000
MAX_READ_BYTES: Final = 4 * 1024 * 1024
"""Most reads and bytes of one block; exifread reads a MakerNote byte by byte, so that one of 60 kB is 60 000 reads."""

MAX_BINARY: Final = 64
"""Longest value of bytes that is shown; longer ones are MakerNotes, profiles, XMP packets."""

_BYTE_TYPES: Final = frozenset({1, 6, 7})
_LEFT_OUT: Final = re.compile(
    r"^(GPS|Thumbnail|Image GPSInfo|Image ApplicationNotes)\b|JPEGThumbnail|Tag 0x|\bUnknown$"
    r"|Serial|UniqueID|CameraID|Owner|Artist|Author|Copyright|LocationInfo|IPTC"
)


def list_tags(path: str | os.PathLike[str]) -> tuple[dict[str, str], int]:
    """List the EXIF tags of an image in their order.

    Returns:
        Values of at most 80 characters by directory and name ("EXIF FocalLength"), and the number of tags left out.

    Raises:
        InputError: the file cannot be opened or read.
        ParseError: it is not an image, has no EXIF block, or the block cannot be read.
    """
    with open_source(path) as source:
        if not begins_as_image(source.head):
            raise source.broken("this is not a JPEG, TIFF, DNG, PNG or HEIF image, so it has no EXIF tags")
        block = exif_block(source)
        if block is None:
            raise source.broken("the image has no EXIF block, so there are no tags to list")
        Tiff(block)  # exifread would take a block that does not begin as a TIFF for another kind of file
        if b"+" in block.read(2, 2):
            raise source.broken("this is a BigTIFF; exifread reads the tags of other TIFF files only")
        return _read(block)


def _read(block: Block) -> tuple[dict[str, str], int]:
    import exifread

    # At level DEBUG exifread would log every value, including serial numbers, to the calling program's log.
    logging.getLogger("exifread").setLevel(logging.CRITICAL + 1)
    file = _File(block)
    try:
        found = exifread.process_file(cast("BinaryIO", file), extract_thumbnail=False)
        shown = {name: _text(tag) for name, tag in found.items() if _is_shown(name, tag)}
    except Exception as error:  # noqa: BLE001  exifread raises errors of every kind on a hostile block
        reason = file.refused or block.source.broken(
            f"exifread cannot read its EXIF block ({type(error).__name__})"
        )
        raise reason from None
    if file.refused is not None:  # within a MakerNote exifread ignores it
        raise file.refused
    return shown, len(found) - len(shown)


def _is_shown(name: str, tag: object) -> bool:
    binary = getattr(tag, "field_type", None) in _BYTE_TYPES and getattr(tag, "field_length", 0) > MAX_BINARY
    return not binary and not _LEFT_OUT.search(name)


def _text(tag: object) -> str:
    values = getattr(tag, "values", None)
    text = clean_text(values if isinstance(values, bytes) else str(tag)) or ""
    return text if len(text) <= MAX_VALUE else f"{text[: MAX_VALUE - 1]}…"


class _File:
    """A block as the file that exifread reads, with a limit on how much it reads.

    Attributes:
        refused: the error that ended the reading.
    """

    def __init__(self, block: Block) -> None:
        self.refused: InputError | None = None
        self._block = block
        self._at = self._reads = self._bytes = 0

    def seek(self, offset: int) -> None:
        self._at = offset

    def read(self, size: int) -> bytes:
        self._reads += 1
        try:
            data = self._block.read(self._at, size) if self._at >= 0 else b""
            self._bytes += len(data)
            if self._reads > MAX_READS or self._bytes > MAX_READ_BYTES:
                raise self._block.source.broken(
                    "its EXIF block is too large or refers to itself again and again"
                )
        except InputError as error:
            self.refused = error
            raise
        self._at += len(data)
        return data
