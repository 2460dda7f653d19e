"""Position and viewing direction of an image; not part of ImageMetadata, and read only on request.

CIPA DC-008, GPS IFD; DJI's XMP for the standard deviations of an RTK receiver (m) and the gimbal angles
(degrees, pitch −90 is nadir). The values are used for an adjustment and are never written.
"""

from __future__ import annotations

import math
import os
import re
import struct
from contextlib import suppress
from typing import Final

from msgspec import Struct

from calibrary.errors import InputError
from calibrary.evidence.metadata import TagFault
from calibrary.parsers.imagery import jpeg, tiff
from calibrary.parsers.imagery.directory import Directory, Tiff
from calibrary.parsers.imagery.source import Source, open_source
from calibrary.parsers.imagery.taken import exif_block

__all__ = ["Fix", "fix_of"]

GPS_POINTER: Final = 0x8825
LATITUDE_REF, LATITUDE, LONGITUDE_REF, LONGITUDE, ALTITUDE_REF, ALTITUDE = range(1, 7)
RATIONAL: Final = 5
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
