"""Date, focus, position and direction of an image; not part of ImageMetadata, and read only on request.

CIPA DC-008: DateTimeOriginal, DateTimeDigitized, and TIFF's DateTime, each "2024:05:17 09:30:00" by the
camera's clock; SubjectDistance and SubjectDistanceRange. No standard tag states whether the focus was locked; if two
images differ in it, the lens was refocused in between.

The position is that of the GPS IFD, with DJI's XMP for the standard deviations of an RTK receiver (m) and the gimbal
angles (degrees, pitch −90 is nadir). The values are used for an adjustment and are never written.
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

from msgspec import Struct

from calibrary.errors import InputError
from calibrary.evidence.metadata import TagFault
from calibrary.parsers.imagery import heif, jpeg, png, tiff
from calibrary.parsers.imagery.directory import Directory, Tiff
from calibrary.parsers.imagery.exif import EXIF_POINTER
from calibrary.parsers.imagery.source import Block, Source, open_source

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
            if above and below:
                return f"{above / below:.4g} m"
    near = exif.entries.get(RANGE) if exif is not None else None
    if near is not None and near.kind == SHORT and near.count == 1:
        return RANGES.get(next(iter(tiff.integers(near)), 0))
    return None


GPS_POINTER: Final = 0x8825
LATITUDE_REF, LATITUDE, LONGITUDE_REF, LONGITUDE, ALTITUDE_REF, ALTITUDE = range(1, 7)
BELOW_SEA: Final = b"\1"
_XMP = re.compile(
    rb"drone-dji:(RtkStdLat|RtkStdLon|RtkStdHgt|GimbalPitchDegree|GimbalYawDegree)\s*(?:=\s*[\"']|>)\s*([+-]?[\d.]{1,16})"
)
LEAST_STD_M: Final = 0.02
"""Smallest standard deviation assumed: an RTK receiver states that of its antenna, not of the camera below it."""


class Fix(Struct, frozen=True, kw_only=True):
    """A position.

    Attributes:
        latitude_deg, longitude_deg: WGS 84, north and east.
        altitude_m: above the ellipsoid or sea level; 0 if not stated.
        std_m: standard deviations east, north and up from an RTK receiver; None if not stated.
        pitch_deg: of the gimbal, −90 is nadir; None if not stated.
        yaw_deg: of the gimbal, clockwise from north; None if not stated.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    std_m: tuple[float, float, float] | None = None
    pitch_deg: float | None = None
    yaw_deg: float | None = None


def fix_of(path: str | os.PathLike[str]) -> Fix | None:
    """The position that an image states; None if it states none or an impossible one.

    Raises:
        InputError: the file cannot be opened or read.
    """
    with open_source(path) as source, suppress(InputError):
        block = exif_block(source)
        if block is None:
            return None
        structure = Tiff(block)
        pointer = structure.directory(structure.first, frozenset({GPS_POINTER})).entries.get(GPS_POINTER)
        offsets = structure.integers(pointer) if pointer is not None else ()
        if len(offsets) != 1:
            return None
        return _fix(structure, structure.directory(offsets[0], frozenset(range(1, 7))), _xmp_values(source))
    return None


def _fix(structure: Tiff, gps: Directory, said: dict[str, float]) -> Fix | None:
    north, east = (_degrees(structure, gps, tag) for tag in (LATITUDE, LONGITUDE))
    if north is None or east is None or not (abs(north) <= 90 and abs(east) <= 180) or north == east == 0:
        return None
    up = next(iter(_ratios(structure, gps, ALTITUDE)), 0.0)
    if _bytes(structure, gps, ALTITUDE_REF)[:1] == BELOW_SEA:
        up = -up
    std = tuple(
        max(said.get(name, math.nan), LEAST_STD_M) for name in ("RtkStdLon", "RtkStdLat", "RtkStdHgt")
    )
    return Fix(
        latitude_deg=north * (-1 if _bytes(structure, gps, LATITUDE_REF)[:1] == b"S" else 1),
        longitude_deg=east * (-1 if _bytes(structure, gps, LONGITUDE_REF)[:1] == b"W" else 1),
        altitude_m=up if math.isfinite(up) else 0.0,
        std_m=(std[0], std[1], std[2]) if all(map(math.isfinite, std)) else None,
        pitch_deg=said.get("GimbalPitchDegree"),
        yaw_deg=said.get("GimbalYawDegree"),
    )


def _degrees(structure: Tiff, gps: Directory, tag: int) -> float | None:
    parts = _ratios(structure, gps, tag)
    if len(parts) != 3 or not all(map(math.isfinite, parts)):
        return None
    return parts[0] + parts[1] / 60 + parts[2] / 3600


def _ratios(structure: Tiff, gps: Directory, tag: int) -> tuple[float, ...]:
    entry = gps.entries.get(tag)
    data = _bytes(structure, gps, tag)
    if entry is None or entry.kind != RATIONAL or not data:
        return ()
    numbers = struct.unpack(f"{structure.byte_order}{2 * entry.count}I", data)
    return tuple(
        above / below if below else math.nan for above, below in zip(numbers[::2], numbers[1::2], strict=True)
    )


def _bytes(structure: Tiff, gps: Directory, tag: int) -> bytes:
    entry = gps.entries.get(tag)
    data = structure.value("GPS", entry, 64) if entry is not None else b""
    return b"" if isinstance(data, TagFault) else data


def _xmp_values(source: Source) -> dict[str, float]:
    """Values from DJI's XMP, by name."""
    packets: tuple[bytes, ...] = ()
    with suppress(InputError):
        if source.head.startswith(jpeg.SIGNATURE):
            packets = tuple(jpeg.read_jpeg(source).xmp)
        elif source.head.startswith(tiff.SIGNATURES):
            packets = tuple(tiff.read_tiff(source).head.xmp)
    said: dict[str, float] = {}
    for name, text in (pair for packet in packets for pair in _XMP.findall(packet)):
        with suppress(ValueError):
            said.setdefault(name.decode(), float(text))
    return said
