"""Image files made by hand: any EXIF, any XMP, true to the camera or wrong on purpose.

Tests, the demonstration and the benchmarks need what image libraries will not write: a focal length of 0/0, a
tag of the wrong type, XMP under a misspelt namespace, twenty megapixels in a millisecond.
"""

from calibrary.synthetic.exif import TAGS, ExifField, ExifTags, GpsPosition
from calibrary.synthetic.jpeg import Segment, write_jpeg
from calibrary.synthetic.png import write_png
from calibrary.synthetic.structure import ByteOrder, FieldType, Rational
from calibrary.synthetic.tiff import TiffPage, encode_tiff, write_tiff
from calibrary.synthetic.xmp import (
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
