"""Pictures out of the bytes of JPEG, PNG and TIFF files and back, as stored: nothing is turned or rescaled.

Of what a file says beside its pixels, JPEG and PNG take the EXIF block and the colour profile along; OpenCV,
which encodes them, drops everything. The EXIF block loses what speaks of the picture as the lens drew it, and a
short XMP packet says, in Adobe's words, that the lens was corrected: whoever reads Make and Model there must not
take the camera's usual K for the picture's.
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

__all__ = ["Kind", "Picture", "decode", "encode", "reframed"]

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
"""What Adobe's programs write of a picture whose lens profile was applied (XMP specification, camera raw schema)."""

_JPEG, _PNG = b"\xff\xd8", b"\x89PNG\r\n\x1a\n"
_MAX_SEGMENT = 65_533
_ICC_CHUNK = 65_519
_DEPTHS = ("uint8", "uint16", "int16", "float32", "float64")


class Kind(StrEnum):
    """What a picture is stored as."""

    JPEG = "jpg"
    PNG = "png"
    TIFF = "tif"


class Picture(Struct, frozen=True, kw_only=True):
    """A decoded picture.

    Attributes:
        pixels: (H, W) or (H, W, 3 or 4), in OpenCV's order of channels.
        kind: what it was stored as.
        exif: the EXIF block without its header, where there is one that can be taken along.
        profile: the ICC colour profile.
        xmp: an XMP packet; never the one that was read.
    """

    pixels: Pixels
    kind: Kind
    exif: bytes | None = None
    profile: bytes | None = None
    xmp: bytes | None = None


def decode(data: bytes, *, source: str) -> Picture:
    """A picture as stored: EXIF's orientation turns nothing.

    Args:
        data: a whole file.
        source: what errors call it.

    Raises:
        ParseError: it is broken.
        UnsupportedModelError: it is not a JPEG, PNG or TIFF, or one of a kind that OpenCV does not read.
    """
    import cv2

    kind = _kind(data, source)
    # OpenCV turns TIFFs upright whatever it is asked for.
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
    """The bytes of a file.

    Args:
        picture: what to store, and as what.
        quality: of a JPEG, 1 … 100; its colours are stored at full resolution.

    Raises:
        UnsupportedModelError: the kind of file does not hold such pixels.
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
    """The picture with other pixels, and its EXIF with what is still true of them.

    Gone are the maker's notes, the thumbnail and, unless the focal length and the size are the same, the tags
    that tell it. XMP is never taken along: cameras keep their lens's distortion there.
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
"""What Pillow raises on an EXIF block that breaks its own rules."""


def _what_reads_is_kept() -> AbstractContextManager[object]:
    """Pillow warns of every tag it cannot read; the others are as good as ever."""
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
    """Whether a JPEG ends before its pixels do, which OpenCV 4.10 decodes as gray and later ones refuse."""
    try:
        return jpeg_end(data) is None
    except ParseError:
        return False  # OpenCV skips what is between segments


def _beside_the_pixels(data: bytes) -> tuple[bytes | None, bytes | None]:
    """EXIF block and colour profile of a JPEG or PNG."""
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
    """EXIF as the first segment after SOI (Exif 3.0, 4.5.4), then XMP, the profile in numbered ones (ICC.1, B.4)."""
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
    """All before the pixels, right after IHDR (PNG 3rd edition, 11.3)."""
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
    """The byte order of a TIFF or BigTIFF in struct's letters, None for what is neither."""
    return {b"II*\0": "<", b"MM\0*": ">", b"II+\0": "<", b"MM\0+": ">"}.get(data[:4])


def _with_tiff_orientation_1(data: bytes) -> bytes:
    """The same TIFF with the orientation of its first picture (tag 274) as if there were none."""
    order = _tiff_order(data) or "<"
    is_big = data[2:4] in (b"+\0", b"\0+")
    # Where the first directory is, how many entries it has, and one entry's type, count and value.
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
