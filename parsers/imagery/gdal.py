"""EXIF as text after a conversion to GeoTIFF: the items of GDAL_METADATA, tag 42112.

GDAL's JPEG driver provides EXIF as ``EXIF_<name>=<text>``, rationals in brackets (``(8.8)``, ``(45) (37)
(37.5)``), and its GeoTIFF driver writes that as ``<Item name="EXIF_FocalLength">(8.8)</Item>``. Six digits
are preserved. An XMP packet may be included as text in the domain ``xml:XMP``, if it is not in its own tag.
"""

from __future__ import annotations

import re

from msgspec import Struct

from calibrary.errors import ParseError
from calibrary.evidence.metadata import TagFault, as_float
from calibrary.parsers.imagery.exif import TAG_NAMES, TEXT_TAGS
from calibrary.parsers.xml import parse_xml

__all__ = ["GdalMetadata", "read_gdal_metadata"]

_PREFIX = "EXIF_"
_XMP_DOMAIN = "xml:XMP"
_NUMBERS = {f"{_PREFIX}{name}": tag for tag, name in TAG_NAMES.items() if tag not in TEXT_TAGS}
_TEXTS = {f"{_PREFIX}{name}": tag for tag, name in TAG_NAMES.items() if tag in TEXT_TAGS}
_VALUE = re.compile(r"[^\s()]{1,40}")


class GdalMetadata(Struct, frozen=True):
    """EXIF values by tag number, XMP packets and faults from GDAL_METADATA."""

    values: tuple[tuple[int, object], ...] = ()
    xmp: tuple[bytes, ...] = ()
    faults: tuple[TagFault, ...] = ()


def read_gdal_metadata(data: bytes, source: str) -> GdalMetadata:
    """Read EXIF and XMP from the XML of a GeoTIFF's GDAL_METADATA tag."""
    try:
        root = parse_xml(data.strip(b"\0 \t\r\n"), source=source)
    except ParseError as error:
        fault = TagFault("GDAL_METADATA", error.message, "well-formed XML without a document type")
        return GdalMetadata(faults=(fault,))
    values: dict[int, object] = {}
    packets: list[bytes] = []
    for item in root.iter("Item"):
        name, text = str(item.get("name")), item.text or ""
        if name in _TEXTS:
            values[_TEXTS[name]] = text
        elif name in _NUMBERS:
            values[_NUMBERS[name]] = tuple(_number(word) for word in _VALUE.findall(text)[:8])
        elif item.get("domain") == _XMP_DOMAIN and text:
            packets.append(text.encode())
    return GdalMetadata(tuple(values.items()), tuple(packets))


def _number(word: str) -> float | str:
    """The number, or the unchanged word: an error is reported where it is used."""
    number = as_float(word)
    return word if number is None else number
