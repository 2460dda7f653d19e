"""Reading of image file headers, and rejection of files that are not camera images.

Decoders are too tolerant: they fill the missing half of a JPEG with gray, convert CMYK, return the thumbnail of a DNG
and read a colour mosaic as a gray image. Corners found there are useless for calibration. So the header is checked
before anything is decoded.

Sources: ITU-T T.81 annex B (JPEG), W3C PNG 3, TIFF 6.0 with BigTIFF, DNG 1.7 (tags of TIFF/EP), Microsoft's
BITMAPFILEHEADER and BITMAPINFOHEADER, Netpbm's pgm(5) and ppm(5), ITU-T T.800 annexes A and I (JPEG 2000).
"""

from __future__ import annotations

import mmap
import re
import struct
from collections.abc import Callable, Mapping
from typing import Final, TypeAlias

from msgspec import Struct

from calibrary.calibration import ImageSize
from calibrary.errors import ParseError, UnknownFormatError

FileBytes: TypeAlias = bytes | mmap.mmap

LARGEST_PIXELS: Final = 400_000_000
"""The largest airborne sensors have 280 million pixels; a header with more is damaged or malicious."""

SMALLEST_SIDE: Final = 64
"""px; a smaller image cannot show a board."""

MOST_ENTRIES: Final = 4096
"""Per TIFF directory; real ones have fewer than a hundred."""


class ImageHead(Struct, frozen=True, kw_only=True):
    """Pixel format of an image file.

    Attributes:
        kind: "jpeg", "png", "tiff", "bmp", "pnm" or "jp2".
        size: (width, height) px as stored, without EXIF rotation.
        channels: samples per pixel, including alpha.
        bits: bits per sample.
    """

    kind: str
    size: ImageSize
    channels: int
    bits: int


def read_head(content: FileBytes) -> ImageHead:
    """Read the header of an image file.

    Raises:
        UnknownFormatError: the file is of no kind of :class:`ImageHead`.
        ParseError: the file is damaged, or unsuitable for measuring corners: CMYK, a colour mosaic, a raw image,
            floating point, several images, too many or too few pixels.
    """
    start = content[:16]
    if start[:3] == b"\xff\xd8\xff":
        head = _jpeg_head(content)
    elif start[:8] == b"\x89PNG\r\n\x1a\n":
        head = _png_head(content)
    elif start[:4] in {b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"}:
        head = _tiff_head(content)
    elif start[:2] == b"BM":
        head = _bmp_head(content)
    elif start[:2] in {b"P2", b"P3", b"P5", b"P6"} and start[2:3].isspace():
        head = _pnm_head(content)[0]
    elif start[:12] == JP2_SIGNATURE or start[:4] == JP2_CODESTREAM:
        head = _jp2_head(content)
    else:
        found = "an empty file" if not start else f"starts with {start[:8].hex(' ')}"
        raise UnknownFormatError(
            f"{found}; expected a JPEG, PNG, TIFF, BMP, PGM, PPM or JPEG 2000 as the camera wrote it"
        )
    width, height = head.size
    if min(head.size) < SMALLEST_SIDE or width * height > LARGEST_PIXELS:
        raise ParseError(
            f"an image of {width}×{height} px; expected at least {SMALLEST_SIDE} px a side and at most "
            f"{LARGEST_PIXELS // 1_000_000} million pixels"
        )
    return head


def check_complete(content: FileBytes, head: ImageHead) -> None:
    """Check that the file is complete up to the end of its pixels.

    Raises:
        ParseError: the file is truncated.
    """
    end = ENDS[head.kind](content)
    if end is None:
        raise ParseError(
            f"the {head.kind.upper()} is cut short after {len(content)} bytes; copy it from the camera again"
        )


JPEG_END, JPEG_SCAN = 0xD9, 0xDA
JPEG_FRAMES: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
JPEG_MARKER_IN_SCAN: Final = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
"""A marker that ends entropy-coded data, without the bytes that may fill up to it; stuffed zeros and restart markers
are excluded. It begins with a single byte, which is searched for twenty times as fast as a repeated one."""


def _jpeg_segment(content: FileBytes, at: int) -> tuple[int, int, int] | None:
    """Return (marker, start, end of the payload) of the segment at ``at``; None at the end of the file."""
    while content[at : at + 2] == b"\xff\xff":
        at += 1
    head = content[at : at + 4]
    if len(head) >= 2 and head[0] == 0xFF and head[1] == JPEG_END:
        return JPEG_END, at + 2, at + 2
    if len(head) < 4:
        return None
    length = int.from_bytes(head[2:])
    if head[0] != 0xFF or length < 2:
        raise ParseError(
            f"no JPEG segment at byte {at}, where one should start; copy it from the camera again"
        )
    return head[1], at + 4, at + 2 + length


def _jpeg_head(content: FileBytes) -> ImageHead:
    at = 2
    while (segment := _jpeg_segment(content, at)) is not None:
        marker, start, at = segment
        if marker in {JPEG_END, JPEG_SCAN}:
            break
        if marker not in JPEG_FRAMES:
            continue
        payload = content[start : start + 6]
        if len(payload) < 6:
            break
        bits, height, width, channels = struct.unpack(">BHHB", payload)
        if channels == 4:
            raise ParseError(
                "a CMYK JPEG, made by a program for print; expected the frame as the camera wrote it"
            )
        if bits != 8 or channels not in {1, 3}:
            raise ParseError(f"a JPEG of {channels} components of {bits} bits; expected 1 or 3 of 8")
        return ImageHead(kind="jpeg", size=(width, height), channels=channels, bits=bits)
    raise ParseError(f"a JPEG of {len(content)} bytes without a frame; copy it from the camera again")


def jpeg_end(content: FileBytes) -> int | None:
    """Return the position where a JPEG ends; None if it is truncated.

    Raises:
        ParseError: there is no segment where one should start.
    """
    at = 2
    while (segment := _jpeg_segment(content, at)) is not None:
        marker, _, at = segment
        if marker == JPEG_END:
            return at
        if marker == JPEG_SCAN:
            found = JPEG_MARKER_IN_SCAN.search(content, at)
            if found is None:
                return None
            at = found.start()
    return None


def _png_head(content: FileBytes) -> ImageHead:
    chunk = content[8:33]
    if len(chunk) < 25 or chunk[4:8] != b"IHDR":
        raise ParseError("a PNG without its header; copy it from the camera again")
    width, height, bits, colour = struct.unpack(">IIBB", chunk[8:18])
    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}.get(colour)
    if channels is None:
        raise ParseError(f"a PNG of colour type {colour}, which there is not; copy it from the camera again")
    at = 33
    while (kind := content[at + 4 : at + 8]) and kind not in {b"IDAT", b"IEND"}:
        if kind == b"acTL":
            raise ParseError("an animated PNG; expected one frame a file")
        at += 12 + int.from_bytes(content[at : at + 4])
    return ImageHead(kind="png", size=(width, height), channels=channels, bits=bits)


def _png_end(content: FileBytes) -> int | None:
    at = 8
    while len(kind := content[at + 4 : at + 8]) == 4:
        at += 12 + int.from_bytes(content[at : at + 4])
        if kind == b"IEND":
            return at
    return None


NEW_SUBFILE_TYPE, WIDTH, HEIGHT, BITS, PHOTOMETRIC = 254, 256, 257, 258, 262
STRIP_OFFSETS, CHANNELS, STRIP_SIZES = 273, 277, 279
TILE_OFFSETS, TILE_SIZES, SAMPLE_FORMAT, DNG_VERSION = 324, 325, 339, 50706
TIFF_TYPES: Final = {1: "B", 3: "H", 4: "I", 16: "Q"}
"""BYTE, SHORT, LONG and LONG8: the only types of the tags that are read."""

UNFIT_PHOTOMETRIC: Final = {
    5: "a CMYK TIFF, made by a program for print; expected the frame as the camera wrote it",
    32803: "a TIFF that holds the sensor's raw colour mosaic (Bayer); develop it to gray or RGB first",
    34892: "a TIFF of raw linear data; develop it to gray or RGB first",
}

TiffTags: TypeAlias = dict[int, tuple[int, ...]]


def _tiff_directory(content: FileBytes, at: int, order: str, *, big: bool) -> tuple[TiffTags, int]:
    """Return the numeric tags of the directory at ``at``, and the position of the next one."""
    count_type, entry_size, word = ("Q", 20, "Q") if big else ("H", 12, "I")
    head, inline = struct.calcsize(count_type), struct.calcsize(word)
    (count,) = _unpack(content, at, order + count_type)
    if count > MOST_ENTRIES:
        raise ParseError(f"a TIFF directory of {count} entries; copy it from the camera again")
    tags: TiffTags = {}
    for entry in range(at + head, at + head + count * entry_size, entry_size):
        tag, kind = _unpack(content, entry, order + "HH")
        (number,) = _unpack(content, entry + 4, order + word)
        if kind not in TIFF_TYPES or number > LARGEST_PIXELS // SMALLEST_SIDE:
            continue
        values = f"{order}{number}{TIFF_TYPES[kind]}"
        place = entry + 4 + inline
        if struct.calcsize(values) > inline:
            (place,) = _unpack(content, place, order + word)
        tags[tag] = _unpack(content, place, values)
    (following,) = _unpack(content, at + head + count * entry_size, order + word)
    return tags, following


def _unpack(content: FileBytes, at: int, form: str) -> tuple[int, ...]:
    size = struct.calcsize(form)
    raw = content[at : at + size]
    if len(raw) < size:
        raise ParseError(
            f"the TIFF is cut short after {len(content)} bytes: its directory points to byte {at}; "
            "copy it from the camera again"
        )
    return struct.unpack(form, raw)


def _tiff_first(content: FileBytes) -> tuple[TiffTags, TiffTags | None]:
    """Return the tags of the first directory, and of the second if there is one."""
    order = "<" if content[:1] == b"I" else ">"
    big = b"+" in content[2:4]
    (at,) = _unpack(content, 8, order + "Q") if big else _unpack(content, 4, order + "I")
    tags, following = _tiff_directory(content, at, order, big=big)
    second = _tiff_directory(content, following, order, big=big)[0] if following else None
    return tags, second


def _tiff_head(content: FileBytes) -> ImageHead:
    tags, second = _tiff_first(content)
    if DNG_VERSION in tags:
        raise ParseError("a raw DNG; develop it to a TIFF with lens corrections off")
    if any(tag not in tags or not tags[tag] for tag in (WIDTH, HEIGHT, PHOTOMETRIC)):
        raise ParseError("a TIFF with a first directory that is not an image; copy it from the camera again")
    photometric = tags[PHOTOMETRIC][0]
    if photometric in UNFIT_PHOTOMETRIC:
        raise ParseError(UNFIT_PHOTOMETRIC[photometric])
    if second is not None and WIDTH in second and not (_subfile_type(second) & 1):
        raise ParseError("a TIFF of several images; expected one frame a file")
    bits = max(tags.get(BITS) or (1,))
    if bits not in {8, 16} or set(tags.get(SAMPLE_FORMAT) or (1,)) != {1}:
        kind = "floating-point or signed" if set(tags.get(SAMPLE_FORMAT) or (1,)) != {1} else "packed"
        raise ParseError(f"a TIFF of {kind} samples of {bits} bits; expected unsigned ones of 8 or 16")
    channels = (tags.get(CHANNELS) or (1,))[0]
    return ImageHead(kind="tiff", size=(tags[WIDTH][0], tags[HEIGHT][0]), channels=channels, bits=bits)


def _subfile_type(tags: TiffTags) -> int:
    """Return NewSubfileType; bit 0 marks a reduced copy of another image."""
    return (tags.get(NEW_SUBFILE_TYPE) or (0,))[0]


def _tiff_end(content: FileBytes) -> int | None:
    tags, _ = _tiff_first(content)
    offsets = tags.get(STRIP_OFFSETS) or tags.get(TILE_OFFSETS) or ()
    sizes = tags.get(STRIP_SIZES) or tags.get(TILE_SIZES) or ()
    end = max((at + size for at, size in zip(offsets, sizes, strict=False)), default=0)
    return end if 0 < end <= len(content) else None


BI_RGB, BI_BITFIELDS = 0, 3


def _bmp_head(content: FileBytes) -> ImageHead:
    header = content[:34]
    if len(header) < 34 or (size := int.from_bytes(header[14:18], "little")) < 40:
        raise ParseError("a BMP without the header of Windows 3; save it again as PNG")
    # The height is negative where the rows are stored from the top.
    width, height, planes, bits, compression = struct.unpack("<iiHHI", header[18:34])
    if planes != 1 or bits not in {8, 24, 32} or compression not in {BI_RGB, BI_BITFIELDS}:
        raise ParseError(
            f"a BMP of {bits} bits with compression {compression} and a header of {size} bytes; expected one of 8, 24 "
            "or 32 bits that is not compressed"
        )
    return ImageHead(kind="bmp", size=(width, abs(height)), channels=1 if bits == 8 else 3, bits=8)


def _bmp_end(content: FileBytes) -> int | None:
    width, height = _bmp_head(content).size
    (start, bits) = (int.from_bytes(content[at : at + count], "little") for at, count in ((10, 4), (28, 2)))
    end = start + (bits * width + 31) // 32 * 4 * height
    return end if end <= len(content) else None


PNM_NUMBER: Final = re.compile(rb"(?:\s|#[^\r\n]*[\r\n])*+(\d{1,9})(?=\s)")
"""Possessive: a head that is nothing but spaces is refused without trying every way to part them."""
PNM_LONGEST_HEAD: Final = 4096
"""Bytes; comments are a line or two."""


def _pnm_head(content: FileBytes) -> tuple[ImageHead, int]:
    """Return the head of a PGM or PPM, and where its pixels start."""
    at, numbers = 2, []
    for _ in range(3):
        found = PNM_NUMBER.match(content, at, PNM_LONGEST_HEAD)
        if found is None:
            raise ParseError(
                "a PGM or PPM without its width, height and largest value; copy it from the camera again"
            )
        numbers.append(int(found[1]))
        at = found.end()
    width, height, largest = numbers
    if not 1 <= largest <= 65535:
        raise ParseError(f"a PGM or PPM whose largest value is {largest}; expected one up to 65535")
    channels = 1 if content[1:2] in b"25" else 3
    return (
        ImageHead(kind="pnm", size=(width, height), channels=channels, bits=8 if largest < 256 else 16),
        at + 1,
    )


def _pnm_end(content: FileBytes) -> int | None:
    head, at = _pnm_head(content)
    count = head.size[0] * head.size[1] * head.channels
    if content[1:2] in b"23":  # numbers in words
        return len(content) if len(content[at:].split()) >= count else None
    end = at + count * head.bits // 8
    return end if end <= len(content) else None


JP2_SIGNATURE: Final = bytes.fromhex("0000000c6a5020200d0a870a")
JP2_CODESTREAM: Final = bytes.fromhex("ff4fff51")
JP2_END: Final = b"\xff\xd9"


def _jp2_codestream(content: FileBytes) -> tuple[int, int]:
    """Return where the codestream starts and ends; the whole of a file that is nothing else."""
    if content[:4] == JP2_CODESTREAM:
        return 0, len(content)
    at = 0
    while len(box := content[at : at + 16]) >= 8:
        length, head = int.from_bytes(box[:4]), 8
        if length == 1:
            length, head = int.from_bytes(box[8:16]), 16
        if box[4:8] == b"jp2c":
            return at + head, at + length if length else len(content)
        if length < head:
            break
        at += length
    raise ParseError("a JPEG 2000 without a codestream; copy it from the camera again")


def _jp2_head(content: FileBytes) -> ImageHead:
    start, _ = _jp2_codestream(content)
    siz = content[start + 6 : start + 43]
    if content[start : start + 4] != JP2_CODESTREAM or len(siz) < 37:
        raise ParseError("a JPEG 2000 without its size (SIZ); copy it from the camera again")
    right, bottom, left, top = struct.unpack(">4I", siz[2:18])
    (channels,), depth = struct.unpack(">H", siz[34:36]), siz[36]
    bits = (depth & 0x7F) + 1
    if depth & 0x80 or bits > 16 or channels not in {1, 3}:
        kind = "signed " if depth & 0x80 else ""
        raise ParseError(
            f"a JPEG 2000 of {channels} components of {kind}{bits} bits; expected 1 or 3 of up to 16"
        )
    return ImageHead(kind="jp2", size=(right - left, bottom - top), channels=channels, bits=bits)


def _jp2_end(content: FileBytes) -> int | None:
    _, end = _jp2_codestream(content)
    return end if end <= len(content) and content[end - 2 : end] == JP2_END else None


ENDS: Final[Mapping[str, Callable[[FileBytes], int | None]]] = {
    "jpeg": jpeg_end,
    "png": _png_end,
    "tiff": _tiff_end,
    "bmp": _bmp_end,
    "pnm": _pnm_end,
    "jp2": _jp2_end,
}
