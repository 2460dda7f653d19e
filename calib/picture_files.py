"""Decoding and encoding of JPEG, PNG and TIFF files, as stored: nothing is rotated or rescaled.

For JPEG and PNG, the EXIF block and the colour profile are preserved; OpenCV, which encodes the pixels, drops all
metadata. Tags about the original lens image are removed from the EXIF block, and a short XMP packet with Adobe's tags
states that the lens was corrected: a reader of Make and Model must not apply the camera's usual K to the new image.
"""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from enum import StrEnum
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary.calib.image_head import jpeg_end
from calibrary.calib.opencv_state import quiet
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.records import replace

if TYPE_CHECKING:
    from PIL.Image import Exif

Pixels: TypeAlias = NDArray[Any]

ORIENTATION = 0x0112
EXIF_IFD = 0x8769
MAKER_NOTE = 0x927C
PIXEL_DIMENSIONS = (0xA002, 0xA003)
IMAGE_DIMENSIONS = (0x0100, 0x0101)
OF_THE_FOCAL_LENGTH = {
    0x920A: "FocalLength",
    0xA20E: "FocalPlaneXResolution",
    0xA20F: "FocalPlaneYResolution",
    0xA404: "DigitalZoomRatio",
    0xA405: "FocalLengthIn35mmFilm",
}

LENS_CORRECTED = (
    b'<?xpacket begin="\xef\xbb\xbf" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
    b'<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about=""'
    b' xmlns:crs="http://ns.adobe.com/camera-raw-settings/1.0/" crs:HasSettings="True" crs:AlreadyApplied="True"'
    b' crs:LensProfileEnable="1"/></rdf:RDF></x:xmpmeta><?xpacket end="r"?>'
)
"""Tags that Adobe's programs write after applying a lens profile (XMP specification, camera raw schema)."""

_JPEG, _PNG = b"\xff\xd8", b"\x89PNG\r\n\x1a\n"
_MAX_SEGMENT = 65_533
_ICC_CHUNK = 65_519
_DEPTHS = ("uint8", "uint16", "int16", "float32", "float64")


class Kind(StrEnum):
    """File format of a picture."""

    JPEG = "jpg"
    PNG = "png"
    TIFF = "tif"


class Picture(Struct, frozen=True, kw_only=True):
    """A decoded picture.

    Attributes:
        pixels: (H, W) or (H, W, 3 or 4), in OpenCV's channel order.
        kind: file format it was read from.
        exif: EXIF block without its header, if it can be preserved.
        profile: ICC colour profile.
        xmp: XMP packet to write; never the one that was read.
    """

    pixels: Pixels
    kind: Kind
    exif: bytes | None = None
    profile: bytes | None = None
    xmp: bytes | None = None


def decode(data: bytes, *, source: str) -> Picture:
    """Decode a picture as stored; EXIF's orientation is not applied.

    Args:
        data: content of the file.
        source: name of the file in errors.

    Raises:
        ParseError: the file is damaged.
        UnsupportedModelError: the file is not a JPEG, PNG or TIFF, or one of a kind that OpenCV cannot read.
    """
    import cv2

    kind = _kind(data, source)
    # OpenCV always rotates TIFFs by their orientation.
    unturned = _with_tiff_orientation_1(data) if kind is Kind.TIFF else data
    try:
        with quiet():
            pixels = cv2.imdecode(np.frombuffer(unturned, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ParseError(f"the {kind.name} cannot be decoded: {error.err}", source=source) from None
    if pixels is None or (kind is Kind.JPEG and _is_cut_short(data)):
        raise ParseError(
            f"the {kind.name} cannot be decoded; it is broken, or of a kind OpenCV does not read",
            source=source,
        )
    if pixels.dtype.name not in _DEPTHS or (pixels.ndim == 3 and pixels.shape[2] not in (1, 3, 4)):
        channels = pixels.shape[2] if pixels.ndim == 3 else 1
        raise UnsupportedModelError(
            f"its pixels are {channels} × {pixels.dtype.name}, expected 1, 3 or 4 channels of {', '.join(_DEPTHS)}",
            source=source,
        )
    if kind is Kind.TIFF:
        return Picture(pixels=pixels, kind=kind)
    exif, profile = _beside_the_pixels(data)
    return Picture(pixels=pixels, kind=kind, exif=exif, profile=profile)


def encode(picture: Picture, *, quality: int = 95) -> bytes:
    """Encode a picture to the bytes of a file.

    Args:
        picture: picture and file format.
        quality: JPEG quality, 1 … 100; colours are stored at full resolution.

    Raises:
        UnsupportedModelError: the file format cannot store these pixels.
    """
    import cv2

    _refuse_unstorable(picture)
    settings = {
        Kind.JPEG: [
            cv2.IMWRITE_JPEG_QUALITY,
            quality,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
        ],
        Kind.PNG: [],
        Kind.TIFF: [],
    }[picture.kind]
    try:
        with quiet():
            is_done, encoded = cv2.imencode(f".{picture.kind}", picture.pixels, settings)
    except cv2.error as error:
        raise UnsupportedModelError(f"cannot be stored as {picture.kind.name}: {error.err}") from None
    if not is_done:
        raise UnsupportedModelError(f"cannot be stored as {picture.kind.name}")
    carry: Mapping[Kind, Callable[[bytes, Picture], bytes]] = {Kind.JPEG: _into_jpeg, Kind.PNG: _into_png}
    data = encoded.tobytes()
    return carry[picture.kind](data, picture) if picture.kind in carry else data


def reframed(picture: Picture, pixels: Pixels, *, keeps_focal: bool) -> Picture:
    """Return the picture with other pixels, and the EXIF tags that still apply to them.

    Maker notes, the thumbnail and, unless focal length and size are unchanged, the tags that state them are removed.
    XMP is never preserved, since cameras store their lens distortion there.
    """
    picture = replace(picture, xmp=LENS_CORRECTED)
    if picture.exif is None:
        return replace(picture, pixels=pixels)
    height, width = pixels.shape[:2]
    exif = _parsed(picture.exif)
    if exif is None:
        return replace(picture, pixels=pixels, exif=None)
    details = exif.get_ifd(EXIF_IFD)
    for tag in (MAKER_NOTE, *(() if keeps_focal else OF_THE_FOCAL_LENGTH)):
        details.pop(tag, None)
    for holder, tags in ((details, PIXEL_DIMENSIONS), (exif, IMAGE_DIMENSIONS)):
        for tag, side in zip(tags, (width, height), strict=True):
            if tag in holder:
                holder[tag] = side
    try:
        with _what_reads_is_kept():
            written = exif.tobytes().removeprefix(b"Exif\0\0")
    except _BAD_EXIF:
        return replace(picture, pixels=pixels, exif=None)
    return replace(picture, pixels=pixels, exif=written)


_BAD_EXIF = (
    OSError,
    ValueError,
    SyntaxError,
    KeyError,
    TypeError,
    struct.error,
    OverflowError,
    AttributeError,
)
"""Exceptions that Pillow raises for an invalid EXIF block."""


def _what_reads_is_kept() -> AbstractContextManager[object]:
    """Suppress Pillow's warnings about unreadable tags; the other tags are kept."""
    return warnings.catch_warnings(action="ignore")


def _kind(data: bytes, source: str) -> Kind:
    if data.startswith(_JPEG):
        return Kind.JPEG
    if data.startswith(_PNG):
        return Kind.PNG
    if _tiff_order(data) is not None:
        return Kind.TIFF
    raise UnsupportedModelError(
        "it is not a JPEG, PNG or TIFF; have your camera's or raw converter's program export it as one, with "
        "its lens corrections off",
        source=source,
    )


def _refuse_unstorable(picture: Picture) -> None:
    kind, depth = picture.kind, picture.pixels.dtype.name
    has_alpha = picture.pixels.ndim == 3 and picture.pixels.shape[2] == 4
    if kind is Kind.JPEG and (depth != "uint8" or has_alpha):
        what = "transparency" if depth == "uint8" else f"{depth} pixels"
        raise UnsupportedModelError(f"a JPEG does not hold {what}; write PNG or TIFF")
    if kind is Kind.PNG and depth not in {"uint8", "uint16"}:
        raise UnsupportedModelError(f"a PNG does not hold {depth} pixels; write TIFF")


def _is_cut_short(data: bytes) -> bool:
    """Return whether a JPEG is truncated; OpenCV 4.10 decodes the missing pixels as gray, later versions reject it."""
    try:
        return jpeg_end(data) is None
    except ParseError:
        return False  # OpenCV ignores data between segments


def _beside_the_pixels(data: bytes) -> tuple[bytes | None, bytes | None]:
    """Return the EXIF block and the colour profile of a JPEG or PNG."""
    from PIL import Image

    try:
        with _what_reads_is_kept(), Image.open(io.BytesIO(data)) as image:
            exif, profile = image.info.get("exif"), image.info.get("icc_profile")
    except (*_BAD_EXIF, Image.DecompressionBombError):
        return None, None
    exif = exif.removeprefix(b"Exif\0\0") if isinstance(exif, bytes) else None
    return exif or None, profile if isinstance(profile, bytes) and profile else None


def _parsed(block: bytes) -> Exif | None:
    from PIL import Image

    exif = Image.Exif()
    try:
        with _what_reads_is_kept():
            exif.load(block)
            list(exif.items())
            exif.get_ifd(EXIF_IFD)
    except _BAD_EXIF:
        return None
    return exif


def _into_jpeg(data: bytes, picture: Picture) -> bytes:
    """Insert EXIF as the first segment after SOI (Exif 3.0, 4.5.4), then XMP and the numbered profile (ICC.1, B.4)."""
    segments = b""
    if picture.exif is not None and len(picture.exif) + 6 <= _MAX_SEGMENT:
        segments += _segment(0xE1, b"Exif\0\0" + picture.exif)
    if picture.xmp is not None:
        segments += _segment(0xE1, b"http://ns.adobe.com/xap/1.0/\0" + picture.xmp)
    profile = picture.profile or b""
    parts = [profile[start : start + _ICC_CHUNK] for start in range(0, len(profile), _ICC_CHUNK)]
    if len(parts) <= 255:
        for number, part in enumerate(parts, start=1):
            segments += _segment(0xE2, b"ICC_PROFILE\0" + bytes([number, len(parts)]) + part)
    return data[:2] + segments + data[2:]


def _segment(marker: int, payload: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, len(payload) + 2) + payload


def _into_png(data: bytes, picture: Picture) -> bytes:
    """Insert all metadata before the pixels, right after IHDR (PNG 3rd edition, 11.3)."""
    chunks = b""
    if picture.profile is not None:
        chunks += _chunk(b"iCCP", b"profile\0\0" + zlib.compress(picture.profile))
    if picture.exif is not None:
        chunks += _chunk(b"eXIf", picture.exif)
    if picture.xmp is not None:
        chunks += _chunk(b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + picture.xmp)
    header_ends = len(_PNG) + 25
    return data[:header_ends] + chunks + data[header_ends:]


def _chunk(name: bytes, payload: bytes) -> bytes:
    return struct.pack(">I", len(payload)) + name + payload + struct.pack(">I", zlib.crc32(name + payload))


def _tiff_order(data: bytes) -> str | None:
    """Return the byte order of a TIFF or BigTIFF in struct's notation; None for other data."""
    return {b"II*\0": "<", b"MM\0*": ">", b"II+\0": "<", b"MM\0+": ">"}.get(data[:4])


def _with_tiff_orientation_1(data: bytes) -> bytes:
    """Return the same TIFF with the orientation of its first image (tag 274) reset to 1."""
    order = _tiff_order(data) or "<"
    is_big = data[2:4] in (b"+\0", b"\0+")
    # Format of the directory offset, of the number of entries, and of an entry (tag, type, count, value).
    where, count, entry = ("Q", "Q", "HHQ8s") if is_big else ("I", "H", "HHI4s")
    copy = bytearray(data)
    try:
        (start,) = struct.unpack_from(order + where, data, 8 if is_big else 4)
        (entries,) = struct.unpack_from(order + count, data, start)
        first = start + struct.calcsize(order + count)
        size = struct.calcsize(order + entry)
        for place in range(first, min(first + entries * size, len(data)), size):
            if struct.unpack_from(order + entry, data, place)[0] == ORIENTATION:
                struct.pack_into(order + "H", copy, place + (12 if is_big else 8), 1)
    except struct.error:
        return data
    return bytes(copy)
