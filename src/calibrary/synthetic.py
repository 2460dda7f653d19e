"""Image files with camera metadata, for ``calibrary demo`` and ``calibrary calibrate synth``.

Pillow encodes pixels and EXIF. XMP is written here in the two forms that cameras use most, attributes and elements.
The tests make the invalid files themselves.
"""

from __future__ import annotations

import io
import struct
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

Rational: TypeAlias = tuple[int, int]
ExifValue: TypeAlias = str | bytes | int | Rational

COMPONENTS_AS_UNDEFINED: Final = (b"\x01\x91\1\0\4\0\0\0", b"\x01\x91\7\0\4\0\0\0")
"""ComponentsConfiguration (0x9101) with its four bytes: Pillow writes type BYTE, EXIF requires UNDEFINED."""
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
    """Position of a camera: degrees north and east, metres above the ellipsoid."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


class Head(Struct, frozen=True, kw_only=True):
    """Metadata at the start of an image file.

    Attributes:
        exif: tags of the image and Exif directories, by their names in ``PIL.ExifTags.Base``.
        position: written as a GPS directory.
        xmp: an XMP packet.
        thumbnail: a JPEG that Exif holds besides; only in a JPEG.
        preview: a second image at the end of the file, which MPF's segment names; only in a JPEG.
        private: texts in the metadata that no output may contain.
    """

    exif: Mapping[str, ExifValue] = field(default_factory=dict)
    position: Position | None = None
    xmp: bytes | None = None
    thumbnail: bytes | None = None
    preview: bytes | None = None
    private: tuple[str, ...] = ()


def write_image(
    path: Path, pixels: NDArray[np.uint8] | NDArray[np.uint16], head: Head, *, quality: int = 75
) -> Path:
    """Write a TIFF if the suffix is ``.tif``, otherwise a JPEG.

    Args:
        path: output file; its folder is created.
        pixels: (H, W), or (H, W, 3) for RGB; uint16 only in a TIFF.
        head: metadata.
        quality: JPEG quality, 1 … 95.

    Returns:
        ``path``.
    """
    data = _tiff(pixels, head) if path.suffix == ".tif" else headed(jpeg(pixels, quality), head)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def description(
    about: str,
    *,
    attributes: Mapping[str, str] | None = None,
    elements: Mapping[str, str | tuple[str, ...]] | None = None,
) -> str:
    """Return one rdf:Description of simple properties.

    Args:
        about: the described resource.
        attributes: values by prefixed name, as DJI writes them.
        elements: values by prefixed name, as MicaSense writes them; a tuple of texts makes an rdf:Seq.
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
    """Return a complete XMP packet.

    Args:
        descriptions: results of :func:`description`, in document order.
        toolkit: name of the program to write as x:xmptk.
        length: length in bytes, reached by padding with blanks, as cameras do.
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


def jpeg(pixels: NDArray[np.uint8] | NDArray[np.uint16], quality: int) -> bytes:
    """Return a JPEG without metadata; arguments as of :func:`write_image`."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", quality=quality)
    encoded = stream.getvalue()
    start = 2
    # Remove the JFIF segment, which Pillow adds and cameras do not.
    while encoded[start + 1] & 0xF0 == 0xE0:
        start += 2 + int.from_bytes(encoded[start + 2 : start + 4], "big")
    tables, after = b"", start
    # Cameras write into one segment the tables that Pillow writes into several.
    while encoded[after + 1] == 0xDB:
        length = int.from_bytes(encoded[after + 2 : after + 4], "big")
        tables += encoded[after + 4 : after + 2 + length]
        after += 2 + length
    return encoded[:2] + _segment(tables, 0xDB) + encoded[after:]


def headed(encoded: bytes, head: Head) -> bytes:
    """Return a JPEG of :func:`jpeg` with Exif, then XMP, then the scan, in the order that cameras use."""
    segments = b""
    directories = _directories(head)
    if directories:
        written = directories.tobytes(8).replace(*COMPONENTS_AS_UNDEFINED)
        if head.thumbnail is not None:
            written = _with_thumbnail(written, head.thumbnail)
        segments += _segment(b"Exif\0\0" + b"II*\0\x08\0\0\0" + written)
    if head.xmp is not None:
        segments += _segment(b"http://ns.adobe.com/xap/1.0/\0" + head.xmp)
    if head.preview is not None:
        first = len(encoded) + len(segments) + 4 + len(_MULTI_PICTURE) + 2 * 16
        at = first - (2 + len(segments) + 4 + 4)
        entries = struct.pack("<IIIHH", 0x20030000, first, 0, 0, 0)
        entries += struct.pack("<IIIHH", 0x10001, len(head.preview), at, 0, 0)
        segments += _segment(_MULTI_PICTURE + entries, 0xE2)
    return encoded[:2] + segments + encoded[2:] + (head.preview or b"")


_MULTI_PICTURE: Final = b"MPF\0II*\0" + struct.pack(
    "<IHHHI4sHHIIHHIII", 8, 3, 0xB000, 7, 4, b"0100", 0xB001, 4, 1, 2, 0xB002, 7, 32, 50, 0
)
"""MPF's header and index of two images, whose entries follow it (CIPA DC-007 §5.2)."""


def _with_thumbnail(directories: bytes, thumbnail: bytes) -> bytes:
    """IFD0 and what it points to, followed by an IFD1 with a JPEG (CIPA DC-008 §4.5.3)."""
    header, entry, tags = 8, 12, ((0x0103, 3, 6), (0x0201, 4, 0), (0x0202, 4, len(thumbnail)))
    at = header + len(directories)
    data = at + 2 + entry * len(tags) + 4
    fields = b"".join(
        struct.pack("<HHII", tag, kind, 1, data if tag == 0x0201 else value) for tag, kind, value in tags
    )
    following = 2 + entry * int.from_bytes(directories[:2], "little")
    linked = directories[:following] + at.to_bytes(4, "little") + directories[following + 4 :]
    return linked + struct.pack("<H", len(tags)) + fields + bytes(4) + thumbnail


def _segment(payload: bytes, marker: int = 0xE1) -> bytes:
    if len(payload) > 0xFFFF - 2:
        raise InputError(f"a JPEG segment of {len(payload)} bytes, wanted at most {0xFFFF - 2}")
    return bytes((0xFF, marker)) + (len(payload) + 2).to_bytes(2, "big") + payload


def _tiff(pixels: NDArray[np.uint8] | NDArray[np.uint16], head: Head) -> bytes:
    from PIL import Image

    directories = _directories(head)
    if head.xmp is not None:
        directories[XMP_TAG] = head.xmp
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "TIFF", tiffinfo=directories)
    return stream.getvalue()


def _directories(head: Head) -> ImageFileDirectory_v2:
    """Return IFD0 with the Exif and GPS directories."""
    from PIL.ExifTags import GPS, Base
    from PIL.TiffImagePlugin import IFDRational, ImageFileDirectory_v2

    image = ImageFileDirectory_v2()
    exif: dict[int, object] = {}
    for name, value in head.exif.items():
        number = Base[name].value
        # TIFF's own tags are below 0x8000; all others that are written here belong to Exif.
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
    # Integer units of 0.0001 second of arc (3 mm on the ground), so that 59.99996″ carries over correctly.
    minutes, ticks = divmod(round(abs(degrees) * 36_000_000), 600_000)
    whole, minutes = divmod(minutes, 60)
    return (whole, 1), (minutes, 1), (ticks, 10_000)
