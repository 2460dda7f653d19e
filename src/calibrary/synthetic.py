"""Image files with the metadata a camera writes, for ``calibrary demo`` and ``calibrary calibrate synth``.

Pillow encodes pixels and EXIF; XMP is written out here in the two spellings cameras use most, attributes and
elements. Files that no camera should write are made by the tests.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray

from calibrary.errors import InputError

if TYPE_CHECKING:
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

__all__ = ["ExifValue", "Head", "Position", "Rational", "description", "packet", "write_image"]

Rational: TypeAlias = tuple[int, int]
ExifValue: TypeAlias = str | bytes | int | Rational

COMPONENTS_AS_UNDEFINED: Final = (b"\x01\x91\1\0\4\0\0\0", b"\x01\x91\7\0\4\0\0\0")
"""ComponentsConfiguration (0x9101) with its four bytes: Pillow writes the type BYTE, EXIF wants UNDEFINED."""
EXIF_IFD, GPS_IFD, XMP_TAG = 0x8769, 0x8825, 700

NAMESPACES: Final = {
    "Camera": "http://pix4d.com/1.0",
    "DLS": "http://micasense.com/DLS/1.0/",
    "MicaSense": "http://micasense.com/MicaSense/1.0/",
    "crs": "http://ns.adobe.com/camera-raw-settings/1.0/",
    "dc": "http://purl.org/dc/elements/1.1/",
    "drone-dji": "http://www.dji.com/drone-dji/1.0/",
    "tiff": "http://ns.adobe.com/tiff/1.0/",
    "xmp": "http://ns.adobe.com/xap/1.0/",
}


class Position(Struct, frozen=True, kw_only=True):
    """Where a camera was: degrees north and east, metres above the ellipsoid."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


class Head(Struct, frozen=True, kw_only=True):
    """What stands before an image's pixels.

    Attributes:
        exif: tags of the image and Exif directories by the names of ``PIL.ExifTags.Base``.
        position: makes a GPS directory.
        xmp: a packet.
        private: texts in it that no output may repeat.
    """

    exif: Mapping[str, ExifValue] = field(default_factory=dict)
    position: Position | None = None
    xmp: bytes | None = None
    private: tuple[str, ...] = ()


def write_image(
    path: Path, pixels: NDArray[np.uint8] | NDArray[np.uint16], head: Head, *, quality: int = 75
) -> Path:
    """Write a TIFF or, with any other suffix than ``.tif``, a JPEG.

    Args:
        path: of the file; its folder is made.
        pixels: (H, W) or, RGB, (H, W, 3); uint16 only in a TIFF.
        head: its metadata.
        quality: of a JPEG, 1 … 95.

    Returns:
        ``path``.
    """
    data = _tiff(pixels, head) if path.suffix == ".tif" else _jpeg(pixels, head, quality)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def description(
    about: str,
    *,
    attributes: Mapping[str, str] | None = None,
    elements: Mapping[str, str | tuple[str, ...]] | None = None,
) -> str:
    """One rdf:Description of simple properties.

    Args:
        about: what it describes.
        attributes: by prefixed name, as DJI writes them.
        elements: by prefixed name, as MicaSense writes them; several texts make an rdf:Seq.
    """
    attributes, elements = attributes or {}, elements or {}
    prefixes = sorted({name.partition(":")[0] for name in (*attributes, *elements)})
    lines = [f'  <rdf:Description rdf:about="{escape(about)}"']
    lines += [f'    xmlns:{prefix}="{NAMESPACES[prefix]}"' for prefix in prefixes]
    lines += [f'   {name}="{escape(text)}"' for name, text in attributes.items()]
    lines += ["  >"]
    lines += [f"   <{name}>{_content(text)}</{name}>" for name, text in elements.items()]
    return "\n".join([*lines, "  </rdf:Description>"])


def packet(descriptions: Iterable[str], *, toolkit: str | None = None, length: int = 0) -> bytes:
    """A whole XMP packet.

    Args:
        descriptions: of :func:`description`, in document order.
        toolkit: the program that claims to have written it.
        length: bytes that it is filled up to with blanks, as cameras do.
    """
    tool = f' x:xmptk="{escape(toolkit)}"' if toolkit is not None else ""
    body = "\n".join(
        [
            '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>',
            f'<x:xmpmeta xmlns:x="adobe:ns:meta/"{tool}>',
            ' <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">',
            *descriptions,
            " </rdf:RDF>",
            "</x:xmpmeta>\n",
        ]
    ).encode()
    end = b'<?xpacket end="w"?>'
    return body.ljust(length - len(end)) + end


def _content(text: str | tuple[str, ...]) -> str:
    if isinstance(text, str):
        return escape(text)
    return f"<rdf:Seq>{''.join(f'<rdf:li>{escape(item)}</rdf:li>' for item in text)}</rdf:Seq>"


def _jpeg(pixels: NDArray[np.uint8] | NDArray[np.uint16], head: Head, quality: int) -> bytes:
    """Exif, then XMP, then the scan, as cameras order them."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", quality=quality)
    encoded = stream.getvalue()
    start = 2
    # Without the JFIF segment that Pillow adds and cameras do not.
    while encoded[start + 1] & 0xF0 == 0xE0:
        start += 2 + int.from_bytes(encoded[start + 2 : start + 4], "big")
    segments = b""
    directories = _directories(head)
    if directories:
        written = directories.tobytes(8).replace(*COMPONENTS_AS_UNDEFINED)
        segments += _segment(b"Exif\0\0" + b"II*\0\x08\0\0\0" + written)
    if head.xmp is not None:
        segments += _segment(b"http://ns.adobe.com/xap/1.0/\0" + head.xmp)
    return encoded[:2] + segments + encoded[start:]


def _segment(payload: bytes) -> bytes:
    if len(payload) > 0xFFFF - 2:
        raise InputError(f"a JPEG segment of {len(payload)} bytes, wanted at most {0xFFFF - 2}")
    return b"\xff\xe1" + (len(payload) + 2).to_bytes(2, "big") + payload


def _tiff(pixels: NDArray[np.uint8] | NDArray[np.uint16], head: Head) -> bytes:
    from PIL import Image

    directories = _directories(head)
    if head.xmp is not None:
        directories[XMP_TAG] = head.xmp
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "TIFF", tiffinfo=directories)
    return stream.getvalue()


def _directories(head: Head) -> ImageFileDirectory_v2:
    """IFD0 with the Exif and GPS directories in it."""
    from PIL.ExifTags import GPS, Base
    from PIL.TiffImagePlugin import IFDRational, ImageFileDirectory_v2

    image = ImageFileDirectory_v2()
    exif: dict[int, object] = {}
    for name, value in head.exif.items():
        number = Base[name].value
        # TIFF's own tags lie below 0x8000; all others that a camera writes here are Exif's.
        (image if number < 0x8000 else exif)[number] = (
            IFDRational(*value) if isinstance(value, tuple) else value
        )
    if exif:
        image[EXIF_IFD] = exif
    if head.position is not None:
        north, east, up = head.position.latitude_deg, head.position.longitude_deg, head.position.altitude_m
        image[GPS_IFD] = {
            GPS.GPSVersionID: b"\2\3\0\0",
            GPS.GPSLatitudeRef: "N" if north >= 0 else "S",
            GPS.GPSLatitude: tuple(IFDRational(*part) for part in _sexagesimal(north)),
            GPS.GPSLongitudeRef: "E" if east >= 0 else "W",
            GPS.GPSLongitude: tuple(IFDRational(*part) for part in _sexagesimal(east)),
            GPS.GPSAltitudeRef: b"\0" if up >= 0 else b"\1",
            GPS.GPSAltitude: IFDRational(round(abs(up) * 1000), 1000),
            GPS.GPSMapDatum: "WGS-84",
        }
    return image


def _sexagesimal(degrees: float) -> tuple[Rational, ...]:
    # Ten-thousandths of a second (3 mm on the ground), counted as whole numbers so that 59.99996″ carries.
    minutes, ticks = divmod(round(abs(degrees) * 36_000_000), 600_000)
    whole, minutes = divmod(minutes, 60)
    return (whole, 1), (minutes, 1), (ticks, 10_000)
