"""EXIF: the values of the tags that concern the camera, and the broken tags.

exifread decodes the values, not from the camera's own block but from a reduced one: sixteen tags with their
bytes unchanged. So thumbnails, MakerNotes and GPS directories take no time, a block designed to overload a
decoder has no effect, BigTIFF can be read, and errors that exifread would log or skip (an offset outside the
block, an invalid type) are reported as named faults.
"""

from __future__ import annotations

import io
import logging
import struct
from collections.abc import Mapping, Sequence
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

_ASCII, _LONG, _UNDEFINED = 2, 4, 7
_TEXT_TYPES = frozenset({1, _ASCII, _UNDEFINED, 129})
_TYPES_OF_EXIFREAD = frozenset({1, 3, _LONG, 5, 6, 8, 9, 10, 11, 12})
_NUMBER_TYPES = _TYPES_OF_EXIFREAD | {13, 16, 18}

ExifValues: TypeAlias = Mapping[int, object]
"""Values by tag number: text as str or bytes, numbers as a sequence of ratios, floats or ints."""


class _Field(NamedTuple):
    """A field in a form that exifread reads without a warning."""

    tag: int
    kind: int
    values: int
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
    text = data.partition(b"\0")[0]
    # exifread logs ASCII that is not UTF-8 as corrupt; with type UNDEFINED it returns the bytes.
    return _Field(tag, _ASCII if text.isascii() or _is_utf_8(text) else _UNDEFINED, len(text), text)


def _number_field(tiff: Tiff, tag: int, entry: Entry) -> _Field | TagFault:
    name = _FAULT_NAMES[tag]
    if entry.kind not in _NUMBER_TYPES or not entry.count:
        return TagFault(name, f"{entry.count} values of TIFF type {entry.kind}", "a number")
    data = tiff.value(name, entry, MAX_NUMBER_BYTES)
    if isinstance(data, TagFault):
        return data
    if entry.kind in _TYPES_OF_EXIFREAD:
        return _Field(tag, entry.kind, entry.count, data)
    integers = tiff.integers(entry)
    if max(integers) > 0xFFFFFFFF:
        return TagFault(name, str(max(integers)), "a number of 32 bits")
    return _Field(tag, _LONG, entry.count, struct.pack(f"{tiff.byte_order}{entry.count}I", *integers))


def _is_utf_8(text: bytes) -> bool:
    try:
        text.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True


@lru_cache(maxsize=64)
def decode(found: ExifFields) -> ExifValues:
    """Decode the fields with exifread; returns values by tag number."""
    import exifread

    # At level DEBUG exifread would log every value, including serial numbers, to the calling program's log.
    logging.getLogger("exifread").setLevel(logging.CRITICAL + 1)
    if not found.fields:
        return {}
    block = io.BytesIO(_encode(found.byte_order, found.fields))
    tags = exifread.process_file(block, details=False, extract_thumbnail=False)
    values = {tag.tag: tag.values for tag in tags.values()}
    flat = {field.tag: _flat(field, values[field.tag]) for field in found.fields if field.tag in values}
    return MappingProxyType(flat)


def _flat(field: _Field, values: str | list[object]) -> object:
    """The value as text, bytes or a tuple of numbers; exifread returns floats as tuples of one."""
    if isinstance(values, str):
        return values
    if field.kind == _UNDEFINED:
        return bytes(number for number in values if isinstance(number, int))
    return tuple(value[0] if isinstance(value, tuple) else value for value in values)


def _encode(byte_order: str, fields: Sequence[_Field]) -> bytes:
    """Make a minimal EXIF block: an IFD0 with only a pointer, and the EXIF directory with all fields."""
    exif_offset = 8 + 2 + 12 + 4
    data_offset = exif_offset + 2 + 12 * len(fields) + 4
    mark = b"II" if byte_order == "<" else b"MM"
    pointer = struct.pack(byte_order + "HHII", EXIF_POINTER, _LONG, 1, exif_offset)
    head = mark + struct.pack(byte_order + "HIH", 42, 8, 1) + pointer + bytes(4)
    entries, values = bytearray(struct.pack(byte_order + "H", len(fields))), bytearray()
    for field in sorted(fields, key=lambda field: field.tag):
        entries += struct.pack(byte_order + "HHI", field.tag, field.kind, field.values)
        if len(field.data) <= 4:
            entries += field.data.ljust(4, b"\0")
        else:
            entries += struct.pack(byte_order + "I", data_offset + len(values))
            values += field.data
    return head + bytes(entries) + bytes(4) + bytes(values)
