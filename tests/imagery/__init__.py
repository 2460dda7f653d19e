"""Image files made by hand: any EXIF, any XMP, true to the camera or wrong on purpose.

Tests and benchmarks need what image libraries will not write: a tag of the wrong type or that points outside
the file, XMP under a misspelt namespace, twenty megapixels in a millisecond.
"""

from tests.imagery.exif import TAGS, ExifField, ExifTags, GpsPosition
from tests.imagery.jpeg import Segment, write_jpeg
from tests.imagery.png import write_png
from tests.imagery.structure import ByteOrder, FieldType, Rational
from tests.imagery.tiff import TiffPage, encode_tiff, write_tiff
from tests.imagery.xmp import (
    ListKind,
    Namespace,
    StructForm,
    XmpDescription,
    XmpItem,
    XmpList,
    XmpPacket,
    XmpStruct,
    XmpText,
    attributes,
    elements,
)

__all__ = [
    "TAGS",
    "ByteOrder",
    "ExifField",
    "ExifTags",
    "FieldType",
    "GpsPosition",
    "ListKind",
    "Namespace",
    "Rational",
    "Segment",
    "StructForm",
    "TiffPage",
    "XmpDescription",
    "XmpItem",
    "XmpList",
    "XmpPacket",
    "XmpStruct",
    "XmpText",
    "attributes",
    "elements",
    "encode_tiff",
    "write_jpeg",
    "write_png",
    "write_tiff",
]
