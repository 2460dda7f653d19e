"""EXIF: the values of the tags that concern the camera, the broken tags, and the copies in GDAL's metadata and XMP.

Sixteen tags and the two of the interoperability directory are read, where they stand; of a MakerNote and a thumbnail,
that they are there. So these and GPS directories take no time, a block
designed to overload a decoder has no effect, BigTIFF can be read, and errors that a decoder would log or skip
(an offset outside the block, an invalid type) are reported as named faults. exifread reads the same values
(a test compares them); :mod:`calibrary.parsers.imagery.tags` lists with it what else a block contains.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from fractions import Fraction
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple, TypeAlias

from msgspec import Struct

from calibrary.calibration import ImageSize
from calibrary.errors import ParseError
from calibrary.evidence.metadata import TagFault, XmpProperty, as_float
from calibrary.parsers.imagery.directory import Directory, Entry, Tiff
from calibrary.parsers.imagery.source import Block
from calibrary.parsers.xml import parse_xml


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
_MAKER_NOTE, _INTEROPERABILITY = 0x927C, 0xA005
_RELATED_SIZE = (0x1001, 0x1002)
_MAIN_SIZE = (0x0100, 0x0101)
_TAGS = frozenset(TAG_NAMES)
_IMAGE_TAGS = _TAGS | {EXIF_POINTER}
_EXIF_TAGS = _TAGS | {_MAKER_NOTE, _INTEROPERABILITY}
_LONG = 4
_RELATED_KINDS = frozenset({3, _LONG})
_RELATED_ENTRIES = 6
_RELATED_BYTES = 2 + 12 * _RELATED_ENTRIES
_SHORTEST_MAKER_NOTE = 20
"""Programs that drop a MakerNote's content may keep a few bytes."""

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
        has_maker_note: whether there is a MakerNote of more than a few bytes.
        has_thumbnail: whether a second directory follows, which is that of a thumbnail.
        related_size: of the interoperability directory.
        main_size: of the first directory, in a JPEG.
    """

    byte_order: str
    fields: tuple[_Field, ...]
    faults: tuple[TagFault, ...]
    has_maker_note: bool = False
    has_thumbnail: bool = False
    related_size: ImageSize | None = None
    main_size: ImageSize | None = None


NO_EXIF = ExifFields("<", (), ())


def read_block(block: Block) -> ExifFields:
    """Read the fields of an EXIF block inside another file."""
    try:
        tiff = Tiff(block)
        image = tiff.directory(tiff.first, _IMAGE_TAGS.union(_MAIN_SIZE))
    except ParseError as error:
        return NO_EXIF._replace(faults=(TagFault("EXIF", error.message, "a readable EXIF block"),))
    sides = [tiff.integers(image.entries[tag]) for tag in _MAIN_SIZE if tag in image.entries]
    is_size = len(sides) == 2 and all(len(side) == 1 and side[0] > 0 for side in sides)
    return read_directories(tiff, image)._replace(main_size=(sides[0][0], sides[1][0]) if is_size else None)


def read_directories(tiff: Tiff, image: Directory) -> ExifFields:
    """Read the fields of ``image``, a structure's IFD0, and of the EXIF directory that it points to."""
    faults: list[TagFault] = []
    has_maker_note, related_size = False, None
    entries = {tag: entry for tag, entry in image.entries.items() if tag in _TAGS}
    complete = image.complete
    if EXIF_POINTER in image.entries:
        offsets = tiff.integers(image.entries[EXIF_POINTER])
        try:
            exif = tiff.directory(offsets[0] if len(offsets) == 1 else 0, _EXIF_TAGS)
        except ParseError as error:
            faults.append(TagFault("EXIF", error.message, "a readable EXIF directory"))
        else:
            # Some writers put EXIF tags into IFD0; if both have one, the EXIF directory counts.
            entries |= {tag: entry for tag, entry in exif.entries.items() if tag in _TAGS}
            complete = complete and exif.complete
            note = exif.entries.get(_MAKER_NOTE)
            has_maker_note = note is not None and note.count > _SHORTEST_MAKER_NOTE
            related_size = _related_size(tiff, exif.entries.get(_INTEROPERABILITY))
    if not complete:
        faults.append(TagFault("EXIF", "a directory that is cut off", "the whole EXIF block"))
    fields: list[_Field] = []
    for tag, entry in entries.items():
        item = _text_field(tiff, tag, entry) if tag in TEXT_TAGS else _number_field(tiff, tag, entry)
        if isinstance(item, TagFault):
            faults.append(item)
        else:
            fields.append(item)
    return ExifFields(
        tiff.byte_order,
        tuple(fields),
        tuple(faults),
        has_maker_note=has_maker_note,
        has_thumbnail=image.next_offset > 0,
        related_size=related_size,
    )


def _related_size(tiff: Tiff, pointer: Entry | None) -> ImageSize | None:
    if pointer is None or pointer.count != 1 or pointer.kind != _LONG:
        return None
    (offset,) = struct.unpack(f"{tiff.byte_order}I", pointer.inline[:4])
    return _sides(tiff.byte_order, tiff.block.read(offset, _RELATED_BYTES)) if offset else None


# Cached: it is the same in all images of a camera.
@lru_cache(maxsize=64)
def _sides(byte_order: str, directory: bytes) -> ImageSize | None:
    """RelatedImageWidth and RelatedImageHeight among the first entries of an interoperability directory."""
    sides: dict[int, int] = {}
    count = min(int.from_bytes(directory[:2], "little" if byte_order == "<" else "big"), _RELATED_ENTRIES)
    for at in range(2, min(2 + 12 * count, len(directory) - 11), 12):
        tag, kind, values, value = struct.unpack(f"{byte_order}HHI4s", directory[at : at + 12])
        if tag in _RELATED_SIZE and kind in _RELATED_KINDS and values == 1:
            code = _NUMBER_CODES[kind]
            (sides[tag],) = struct.unpack(byte_order + code, value[: struct.calcsize(code)])
    width, height = (sides.get(tag, 0) for tag in _RELATED_SIZE)
    return (width, height) if width and height else None


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


_GDAL_PREFIX = "EXIF_"
_XMP_DOMAIN = "xml:XMP"
_GDAL_NUMBERS = {f"{_GDAL_PREFIX}{name}": tag for tag, name in TAG_NAMES.items() if tag not in TEXT_TAGS}
_GDAL_TEXTS = {f"{_GDAL_PREFIX}{name}": tag for tag, name in TAG_NAMES.items() if tag in TEXT_TAGS}
_GDAL_VALUE = re.compile(r"[^\s()]{1,40}")


class GdalMetadata(Struct, frozen=True):
    """EXIF values by tag number, XMP packets and faults from GDAL_METADATA."""

    values: tuple[tuple[int, object], ...] = ()
    xmp: tuple[bytes, ...] = ()
    faults: tuple[TagFault, ...] = ()


def read_gdal_metadata(data: bytes, source: str) -> GdalMetadata:
    """Read EXIF and XMP from the XML of a GeoTIFF's GDAL_METADATA tag, 42112.

    GDAL's JPEG driver provides EXIF as ``EXIF_<name>=<text>``, rationals in brackets (``(8.8)``, ``(45) (37)
    (37.5)``), and its GeoTIFF driver writes that as ``<Item name="EXIF_FocalLength">(8.8)</Item>``. Six digits are
    preserved. An XMP packet may be included as text in the domain ``xml:XMP``, if it is not in its own tag.
    """
    try:
        root = parse_xml(data.strip(b"\0 \t\r\n"), source=source)
    except ParseError as error:
        fault = TagFault("GDAL_METADATA", error.message, "well-formed XML without a document type")
        return GdalMetadata(faults=(fault,))
    values: dict[int, object] = {}
    packets: list[bytes] = []
    for item in root.iter("Item"):
        name, text = str(item.get("name")), item.text or ""
        if name in _GDAL_TEXTS:
            values[_GDAL_TEXTS[name]] = text
        elif name in _GDAL_NUMBERS:
            values[_GDAL_NUMBERS[name]] = tuple(_gdal_number(word) for word in _GDAL_VALUE.findall(text)[:8])
        elif item.get("domain") == _XMP_DOMAIN and text:
            packets.append(text.encode())
    return GdalMetadata(tuple(values.items()), tuple(packets))


def _gdal_number(word: str) -> float | str:
    """The number, or the unchanged word: an error is reported where it is used."""
    number = as_float(word)
    return word if number is None else number


_XMP_TAGS = {
    "FocalLength": ExifTag.FOCAL_LENGTH,
    "FocalLengthIn35mmFilm": ExifTag.FOCAL_LENGTH_35MM,
    "DigitalZoomRatio": ExifTag.DIGITAL_ZOOM,
    "FocalPlaneXResolution": ExifTag.FOCAL_PLANE_X,
    "FocalPlaneYResolution": ExifTag.FOCAL_PLANE_Y,
    "FocalPlaneResolutionUnit": ExifTag.FOCAL_PLANE_UNIT,
    "PixelXDimension": ExifTag.PIXEL_X,
    "PixelYDimension": ExifTag.PIXEL_Y,
}


def mirrored_exif(properties: Mapping[tuple[str, str], XmpProperty]) -> ExifValues:
    """The EXIF values that XMP repeats, by tag number; used if a file has no EXIF block, which some tools drop.

    The ``exif:`` schema repeats EXIF's tags by name, with rationals as "88/10" (XMP specification part 2, §8.2).
    """
    values: dict[int, object] = {}
    for name, tag in _XMP_TAGS.items():
        item = properties.get(("exif", name))
        if item is not None:
            values[tag] = [_xmp_number(text) for text in item.values]
    orientation = properties.get(("tiff", "Orientation"))
    if orientation is not None:
        values[ExifTag.ORIENTATION] = [_xmp_number(text) for text in orientation.values]
    return values


def _xmp_number(text: str) -> float | str:
    """The number, or the unchanged text: an error is reported where it is used."""
    over, _, under = text.partition("/")
    top, bottom = as_float(over), as_float(under or "1")
    return top / bottom if top is not None and bottom else text
