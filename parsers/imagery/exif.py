"""EXIF: the values of the tags that concern the camera, and the broken tags.

Sixteen tags are read, where they stand. So thumbnails, MakerNotes and GPS directories take no time, a block
designed to overload a decoder has no effect, BigTIFF can be read, and errors that a decoder would log or skip
(an offset outside the block, an invalid type) are reported as named faults. exifread reads the same values
(a test compares them); :mod:`calibrary.parsers.imagery.tags` lists with it what else a block contains.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from fractions import Fraction
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple, TypeAlias

from calibrary.errors import ParseError
from calibrary.evidence.metadata import TagFault
from calibrary.parsers.imagery.directory import Directory, Entry, Tiff
from calibrary.parsers.imagery.source import Block

__all__ = [
    "EXIF_POINTER",
    "NO_EXIF",
    "TAG_NAMES",
    "TEXT_TAGS",
    "ExifFields",
    "ExifTag",
    "ExifValues",
    "decode",
    "read_block",
    "read_directories",
]


class ExifTag:
    """Numbers of the tags that are read, from TIFF 6.0, CIPA DC-008, and DNG for the serial number."""

    MAKE = 0x010F
    MODEL = 0x0110
    ORIENTATION = 0x0112
    SOFTWARE = 0x0131
    FOCAL_LENGTH = 0x920A
    PIXEL_X = 0xA002
    PIXEL_Y = 0xA003
    FOCAL_PLANE_X = 0xA20E
    FOCAL_PLANE_Y = 0xA20F
    FOCAL_PLANE_UNIT = 0xA210
    DIGITAL_ZOOM = 0xA404
    FOCAL_LENGTH_35MM = 0xA405
    BODY_SERIAL = 0xA431
    LENS_MODEL = 0xA434
    LENS_SERIAL = 0xA435
    DNG_SERIAL = 0xC62F


_TEXT_NAMES = {
    ExifTag.MAKE: "Make",
    ExifTag.MODEL: "Model",
    ExifTag.SOFTWARE: "Software",
    ExifTag.BODY_SERIAL: "BodySerialNumber",
    ExifTag.LENS_MODEL: "LensModel",
    ExifTag.LENS_SERIAL: "LensSerialNumber",
    ExifTag.DNG_SERIAL: "CameraSerialNumber",
}
_NUMBER_NAMES = {
    ExifTag.ORIENTATION: "Orientation",
    ExifTag.FOCAL_LENGTH: "FocalLength",
    ExifTag.FOCAL_LENGTH_35MM: "FocalLengthIn35mmFilm",
    ExifTag.DIGITAL_ZOOM: "DigitalZoomRatio",
    ExifTag.PIXEL_X: "PixelXDimension",
    ExifTag.PIXEL_Y: "PixelYDimension",
    ExifTag.FOCAL_PLANE_X: "FocalPlaneXResolution",
    ExifTag.FOCAL_PLANE_Y: "FocalPlaneYResolution",
    ExifTag.FOCAL_PLANE_UNIT: "FocalPlaneResolutionUnit",
}
TEXT_TAGS = frozenset(_TEXT_NAMES)
TAG_NAMES = MappingProxyType(_TEXT_NAMES | _NUMBER_NAMES)
"""Standard names of the tags that are read, by number."""

_FAULT_NAMES = {tag: f"EXIF {name}" for tag, name in TAG_NAMES.items()}

EXIF_POINTER = 0x8769
_TAGS = frozenset(TAG_NAMES)
_TAGS_AND_POINTER = _TAGS | {EXIF_POINTER}

MAX_TEXT_BYTES = 1000
MAX_NUMBER_BYTES = 64

_TEXT_TYPES = frozenset({1, 2, 7, 129})
_NUMBER_CODES = {
    1: "B",
    3: "H",
    4: "I",
    5: "II",
    6: "b",
    8: "h",
    9: "i",
    10: "ii",
    11: "f",
    12: "d",
    13: "I",
    16: "Q",
    18: "Q",
}
"""Codes of :mod:`struct` by TIFF type; the two of a ratio are numerator and denominator."""

ExifValues: TypeAlias = Mapping[int, object]
"""Values by tag number: text as str or bytes, numbers as a sequence of fractions, floats or ints.

A ratio with denominator zero is its text, such as "5/0".
"""


class _Field(NamedTuple):
    """A field that can be decoded: text up to its NUL, or numbers as they are stored."""

    tag: int
    kind: int
    data: bytes


class ExifFields(NamedTuple):
    """Undecoded fields of an EXIF block; equal for all images of one camera.

    Attributes:
        byte_order: "<" or ">".
        fields: the fields that can be decoded.
        faults: faults of the others.
    """

    byte_order: str
    fields: tuple[_Field, ...]
    faults: tuple[TagFault, ...]


NO_EXIF = ExifFields("<", (), ())


def read_block(block: Block) -> ExifFields:
    """Read the fields of an EXIF block inside another file."""
    try:
        tiff = Tiff(block)
        image = tiff.directory(tiff.first, _TAGS_AND_POINTER)
    except ParseError as error:
        return NO_EXIF._replace(faults=(TagFault("EXIF", error.message, "a readable EXIF block"),))
    return read_directories(tiff, image)


def read_directories(tiff: Tiff, image: Directory) -> ExifFields:
    """Read the fields of ``image``, a structure's IFD0, and of the EXIF directory that it points to."""
    faults: list[TagFault] = []
    entries = {tag: entry for tag, entry in image.entries.items() if tag in _TAGS}
    complete = image.complete
    if EXIF_POINTER in image.entries:
        offsets = tiff.integers(image.entries[EXIF_POINTER])
        try:
            exif = tiff.directory(offsets[0] if len(offsets) == 1 else 0, _TAGS)
        except ParseError as error:
            faults.append(TagFault("EXIF", error.message, "a readable EXIF directory"))
        else:
            # Some writers put EXIF tags into IFD0; if both have one, the EXIF directory counts.
            entries |= exif.entries
            complete = complete and exif.complete
    if not complete:
        faults.append(TagFault("EXIF", "a directory that is cut off", "the whole EXIF block"))
    fields: list[_Field] = []
    for tag, entry in entries.items():
        item = _text_field(tiff, tag, entry) if tag in TEXT_TAGS else _number_field(tiff, tag, entry)
        if isinstance(item, TagFault):
            faults.append(item)
        else:
            fields.append(item)
    return ExifFields(tiff.byte_order, tuple(fields), tuple(faults))


def _text_field(tiff: Tiff, tag: int, entry: Entry) -> _Field | TagFault:
    name = _FAULT_NAMES[tag]
    if entry.kind not in _TEXT_TYPES:
        return TagFault(name, f"no text (TIFF type {entry.kind})", "text")
    if entry.count > MAX_TEXT_BYTES:
        entry = Entry(entry.kind, MAX_TEXT_BYTES, entry.inline)
    data = tiff.value(name, entry, MAX_TEXT_BYTES)
    if isinstance(data, TagFault):
        return data
    return _Field(tag, entry.kind, data.partition(b"\0")[0])


def _number_field(tiff: Tiff, tag: int, entry: Entry) -> _Field | TagFault:
    name = _FAULT_NAMES[tag]
    if entry.kind not in _NUMBER_CODES or not entry.count:
        return TagFault(name, f"{entry.count} values of TIFF type {entry.kind}", "a number")
    data = tiff.value(name, entry, MAX_NUMBER_BYTES)
    return data if isinstance(data, TagFault) else _Field(tag, entry.kind, data)


@lru_cache(maxsize=64)
def decode(found: ExifFields) -> ExifValues:
    """Decode the fields; returns values by tag number."""
    return MappingProxyType(
        {
            field.tag: field.data if field.tag in TEXT_TAGS else _numbers(found.byte_order, field)
            for field in found.fields
        }
    )


def _numbers(byte_order: str, field: _Field) -> tuple[float | Fraction | str, ...]:
    items = struct.iter_unpack(byte_order + _NUMBER_CODES[field.kind], field.data)
    return tuple(item[0] if len(item) == 1 else _ratio(*item) for item in items)


def _ratio(numerator: int, denominator: int) -> Fraction | str:
    return Fraction(numerator, denominator) if denominator else f"{numerator}/0"
