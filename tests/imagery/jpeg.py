"""JPEG files whose segments are laid down one by one, before pixels that cost almost nothing.

What matters to a reader of metadata stands before the scan: the marker segments of ITU-T T.81 annex B, Exif
and XMP in APP1, and the frame's size. So a file is assembled from segments and a *scan* (the tables, the
frame header and the entropy-coded data), and one scan serves any number of files.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrary.calibration import ImageSize
from calibrary.errors import InputError
from calibrary.synthetic import jpeg
from tests.imagery.exif import ExifTags
from tests.imagery.xmp import XmpPacket

_SOI, _EOI = b"\xff\xd8", b"\xff\xd9"
_MAX_PAYLOAD = 65533
"""A segment's length is two bytes that count themselves (T.81, B.1.1.4)."""
_MAX_SIDE = 65535


@dataclass(frozen=True, slots=True)
class Segment:
    """One marker segment, such as APP1 (0xE1) with its payload."""

    marker: int
    payload: bytes

    def encode(self) -> bytes:
        """Marker, length, payload.

        Raises:
            InputError: the payload is longer than a segment can be.
        """
        if len(self.payload) > _MAX_PAYLOAD:
            raise InputError(
                f"a payload of {len(self.payload)} bytes, expected at most {_MAX_PAYLOAD}; split it",
                place=f"JPEG marker 0xFF{self.marker:02X}",
            )
        return struct.pack(">BBH", 0xFF, self.marker, len(self.payload) + 2) + self.payload


JFIF = Segment(0xE0, b"JFIF\0" + struct.pack(">HBHHBB", 0x0102, 0, 1, 1, 0, 0))
"""The APP0 that image programs write and most cameras do not."""


def exif_segment(exif: ExifTags | bytes) -> Segment:
    """APP1 with an EXIF block; bytes are taken as the TIFF part, whatever they hold."""
    return Segment(0xE1, b"Exif\0\0" + (exif if isinstance(exif, bytes) else exif.encode()))


def xmp_segments(xmp: XmpPacket | bytes, *, chunk: int = 65_000) -> tuple[Segment, ...]:
    """APP1 with an XMP packet, and one more for every ``chunk`` bytes of its extended part."""
    if isinstance(xmp, bytes):
        return (_xmp_segment(xmp),)
    extended = xmp.encode_extended()
    guid = xmp.guid().encode()
    parts = (
        Segment(
            0xE1,
            b"http://ns.adobe.com/xmp/extension/\0"
            + guid
            + struct.pack(">II", len(extended), start)
            + extended[start : start + chunk],
        )
        for start in range(0, len(extended), chunk)
    )
    return (_xmp_segment(xmp.encode()), *parts)


def _xmp_segment(packet: bytes) -> Segment:
    return Segment(0xE1, b"http://ns.adobe.com/xap/1.0/\0" + packet)


def icc_segments(profile: bytes, *, chunk: int = 65_519) -> tuple[Segment, ...]:
    """APP2 with a colour profile, numbered where it takes several (ICC.1, annex B.4)."""
    parts = [profile[start : start + chunk] for start in range(0, len(profile), chunk)]
    return tuple(
        Segment(0xE2, b"ICC_PROFILE\0" + bytes([number, len(parts)]) + part)
        for number, part in enumerate(parts, start=1)
    )


def flat_scan(size: ImageSize) -> bytes:
    """A mid-grey frame of any size at two bits per 8×8 block, without encoding a pixel.

    Both Huffman tables hold one code of one bit: no change of the block's mean, and end of block. A frame of
    20 megapixels is 78 kB and takes microseconds; every decoder reads it.

    Raises:
        InputError: a side outside 1 … 65535.
    """
    width, height = size
    if not (1 <= width <= _MAX_SIDE and 1 <= height <= _MAX_SIDE):
        raise InputError(f"a JPEG of {width}×{height} pixels, expected sides of 1 … {_MAX_SIDE}")
    quantisation = Segment(0xDB, b"\0" + bytes([16]) * 64)
    frame = Segment(0xC0, struct.pack(">BHHB", 8, height, width, 1) + b"\1\x11\0")
    one_code = b"\1" + bytes(15) + b"\0"
    tables = (Segment(0xC4, bytes([table_class]) + one_code) for table_class in (0x00, 0x10))
    scan = Segment(0xDA, b"\1\1\0\0\x3f\0")
    bits = 2 * -(-width // 8) * -(-height // 8)
    # The last byte is filled up with ones (T.81, F.1.2.3).
    data = bytes(bits // 8) + (bytes([0xFF >> bits % 8]) if bits % 8 else b"")
    head = b"".join(segment.encode() for segment in (quantisation, frame, *tables, scan))
    return head + data + _EOI


def pixel_scan(pixels: NDArray[np.uint8], *, quality: int = 75) -> bytes:
    """Real pixels, encoded by Pillow, without the segments it adds.

    Args:
        pixels: (H, W) grey or (H, W, 3) RGB.
        quality: of the JPEG, 1 … 95.
    """
    return jpeg(pixels, quality)[len(_SOI) :]


def assemble(segments: Iterable[Segment], scan: bytes) -> bytes:
    """A JPEG file of these segments, in this order, before a scan."""
    return _SOI + b"".join(segment.encode() for segment in segments) + scan


def write_jpeg(
    path: Path,
    size: ImageSize,
    *,
    exif: ExifTags | bytes | None = None,
    xmp: XmpPacket | bytes | None = None,
    segments: tuple[Segment, ...] = (),
    pixels: NDArray[np.uint8] | None = None,
    quality: int = 75,
) -> Path:
    """Write a decodable JPEG: Exif, XMP, the further segments, the scan, as cameras order them.

    Args:
        path: of the file; its folder is made.
        size: (width, height) px.
        exif: tags, or the TIFF part of an EXIF block as it shall stand there.
        xmp: a packet, or its bytes as they shall stand there.
        segments: what follows Exif and XMP; :func:`assemble` gives any other order.
        pixels: (H, W) or (H, W, 3) of ``size``; mid-grey where there are none.
        quality: of the JPEG where there are pixels.

    Returns:
        ``path``.

    Raises:
        InputError: the pixels are not of ``size``, or something does not fit the format.
    """
    if pixels is not None and pixels.shape[1::-1] != size:
        raise InputError(f"pixels of shape {pixels.shape}, expected those of {size[0]}×{size[1]}")
    head: list[Segment] = []
    if exif is not None:
        head.append(exif_segment(exif))
    if xmp is not None:
        head.extend(xmp_segments(xmp))
    scan = flat_scan(size) if pixels is None else pixel_scan(pixels, quality=quality)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(assemble([*head, *segments], scan))
    return path
