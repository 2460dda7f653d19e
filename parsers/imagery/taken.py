"""Date and focus of an image; not part of ImageMetadata, and read only on request.

CIPA DC-008: DateTimeOriginal, DateTimeDigitized, and TIFF's DateTime, each "2024:05:17 09:30:00" by the
camera's clock; SubjectDistance and SubjectDistanceRange. No standard tag states whether the focus was locked; if two
images differ in it, the lens was refocused in between.
"""

from __future__ import annotations

import math
import os
import re
import struct
from collections.abc import Iterator
from contextlib import suppress
from datetime import date
from pathlib import Path
from typing import Final

from calibrary.errors import InputError
from calibrary.evidence.metadata import TagFault
from calibrary.parsers.imagery import heif, jpeg, png, tiff
from calibrary.parsers.imagery.directory import Directory, Tiff
from calibrary.parsers.imagery.exif import EXIF_POINTER
from calibrary.parsers.imagery.source import Block, Source, open_source

__all__ = ["day_of", "exif_block", "focus_of", "taken_on"]

ORIGINAL: Final = 0x9003
DIGITIZED: Final = 0x9004
MODIFIED: Final = 0x0132
LONGEST: Final = 64
_IMAGE: Final = frozenset({EXIF_POINTER, MODIFIED})
_SHUTTER: Final = frozenset({ORIGINAL, DIGITIZED})
_DAY = re.compile(rb"\s*(\d{4})[:\-](\d{2})[:\-](\d{2})")
FIRST_YEAR: Final = 1990
"""First plausible year; a clock that was never set starts in 1970, 1980 or the year 0."""

DISTANCE: Final = 0x9206
RANGE: Final = 0xA40C
RATIONAL, SHORT = 5, 3
INFINITY: Final = 0xFFFFFFFF
"""Numerator of a SubjectDistance that means infinity."""
RANGES: Final = {1: "macro", 2: "close", 3: "distant"}


def taken_on(path: str | os.PathLike[str], *, by_shutter: bool = False) -> date | None:
    """The date by the camera's clock; None if the image states none or an impossible one.

    Args:
        path: the image.
        by_shutter: whether to ignore TIFF's DateTime, which editors set to the date of editing.

    Raises:
        InputError: the file cannot be opened or read.
    """
    with open_source(path) as source:
        return day_of(source, by_shutter=by_shutter)


def day_of(source: Source, *, by_shutter: bool = False) -> date | None:
    """As :func:`taken_on`, for an open file."""
    with suppress(InputError):
        block = exif_block(source)
        if block is None:
            return None
        structure = Tiff(block)
        image = structure.directory(structure.first, _IMAGE)
        return next(_days(structure, image, by_shutter=by_shutter), None)
    return None


def exif_block(source: Source) -> Block | None:
    """The block that begins with a TIFF header: inside another file, or a whole TIFF."""
    if source.head.startswith(jpeg.SIGNATURE):
        return jpeg.read_jpeg(source).exif
    if source.head.startswith(png.SIGNATURE):
        return png.read_png(source).exif
    if heif.is_heif(source.head):
        return heif.read_heif(source).exif
    return Block(source, 0, source.size) if source.head.startswith(tiff.SIGNATURES) else None


def _days(structure: Tiff, image: Directory, *, by_shutter: bool) -> Iterator[date]:
    """Yield the dates in order: exposure, digitisation, editing."""
    pointer = image.entries.get(EXIF_POINTER)
    offsets = structure.integers(pointer) if pointer is not None else ()
    if len(offsets) == 1:
        with suppress(InputError):
            exif = structure.directory(offsets[0], _SHUTTER)
            yield from _dates_in(structure, exif, (ORIGINAL, DIGITIZED))
    if not by_shutter:
        yield from _dates_in(structure, image, (MODIFIED,))


def _dates_in(structure: Tiff, directory: Directory, tags: tuple[int, ...]) -> Iterator[date]:
    for tag in tags:
        entry = directory.entries.get(tag)
        data = structure.value("date", entry, LONGEST) if entry is not None else None
        if data is None or isinstance(data, TagFault) or (found := _DAY.match(data)) is None:
            continue
        year, month, day = (int(number) for number in found.groups())
        if year < FIRST_YEAR:
            continue
        with suppress(ValueError):
            yield date(year, month, day)


def focus_of(path: Path) -> str | None:
    """The focus distance in words; None if the image does not state it.

    Raises:
        InputError: the file cannot be read.
    """
    with open_source(path) as source, suppress(InputError):
        block = exif_block(source)
        if block is not None:
            tiff = Tiff(block)
            return _in_words(tiff, _exif_directory(tiff))
    return None


def _exif_directory(tiff: Tiff) -> Directory | None:
    pointer = tiff.directory(tiff.first, frozenset({EXIF_POINTER})).entries.get(EXIF_POINTER)
    offsets = tiff.integers(pointer) if pointer is not None else ()
    return tiff.directory(offsets[0], frozenset({DISTANCE, RANGE})) if len(offsets) == 1 else None


def _in_words(tiff: Tiff, exif: Directory | None) -> str | None:
    distance = exif.entries.get(DISTANCE) if exif is not None else None
    if distance is not None and distance.kind == RATIONAL and distance.count == 1:
        data = tiff.value("EXIF SubjectDistance", distance, 8)
        if not isinstance(data, TagFault):
            above, below = struct.unpack(f"{tiff.byte_order}II", data)
            if above == INFINITY:
                return "infinity"
            if above and below and math.isfinite(above / below):
                return f"{above / below:.4g} m"
    near = exif.entries.get(RANGE) if exif is not None else None
    if near is not None and near.kind == SHORT and near.count == 1:
        return RANGES.get(next(iter(tiff.integers(near)), 0))
    return None
