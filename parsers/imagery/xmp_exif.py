"""EXIF values repeated in XMP: tools that drop the EXIF block often keep Adobe's copy of it.

The ``exif:`` schema repeats EXIF's tags by name, with rationals as "88/10" (XMP specification part 2, §8.2).
It is used if a file has no EXIF block.
"""

from __future__ import annotations

from collections.abc import Mapping

from calibrary.evidence.metadata import XmpProperty, as_float
from calibrary.parsers.imagery.exif import ExifTag, ExifValues

__all__ = ["mirrored_exif"]

_TAGS = {
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
    """The EXIF values that XMP repeats, by tag number."""
    values: dict[int, object] = {}
    for name, tag in _TAGS.items():
        item = properties.get(("exif", name))
        if item is not None:
            values[tag] = [_number(text) for text in item.values]
    orientation = properties.get(("tiff", "Orientation"))
    if orientation is not None:
        values[ExifTag.ORIENTATION] = [_number(text) for text in orientation.values]
    return values


def _number(text: str) -> float | str:
    """The number, or the unchanged text: an error is reported where it is used."""
    over, _, under = text.partition("/")
    top, bottom = as_float(over), as_float(under or "1")
    return top / bottom if top is not None and bottom else text
