"""Containers the synthetic camera does not write (BigTIFF, PNG with metadata, HEIF), and short cuts."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Sequence

from calibrary.calibration import ImageSize
from calibrary.evidence.metadata import ImageMetadata
from calibrary.parsers.imagery import Source, read_source
from tests.imagery import XmpDescription, XmpItem, XmpPacket
from tests.imagery.jpeg import Segment, assemble, exif_segment, flat_scan, xmp_segments

SIZE = (40, 30)
SCAN = flat_scan(SIZE)


def source_of(data: bytes, name: str = "image.jpg") -> Source:
    """A source over bytes in memory."""
    return Source(io.BytesIO(data), name=name, size=len(data))


def read(data: bytes, name: str = "image.jpg") -> ImageMetadata:
    """What is read from a file of these bytes."""
    return read_source(source_of(data, name))


def jpeg(*segments: Segment) -> bytes:
    """A JPEG of SIZE with these segments."""
    return assemble(segments, SCAN)


def jpeg_with_exif(block: bytes) -> bytes:
    """A JPEG of SIZE with this EXIF block."""
    return jpeg(exif_segment(block))


def jpeg_with_xmp(packet: bytes) -> bytes:
    """A JPEG of SIZE with this XMP packet."""
    return jpeg(*xmp_segments(packet))


def packet(*items: XmpItem) -> bytes:
    """An XMP packet with one description."""
    return XmpPacket(descriptions=(XmpDescription(items=items),)).encode()


def rdf(body: str, namespaces: str = "") -> bytes:
    """An XMP packet around hand-written RDF."""
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"'
        f" {namespaces}>{body}</rdf:RDF></x:xmpmeta>"
    ).encode()


def png(size: ImageSize, *chunks: tuple[bytes, bytes]) -> bytes:
    """A black grey PNG; the chunks stand between the image data and the end."""
    width, height = size
    rows = zlib.compress(bytes((1 + width) * height))
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    every = ((b"IHDR", header), (b"IDAT", rows), *chunks, (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, data) for kind, data in every)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def big_tiff(order: str, fields: Sequence[tuple[int, int, int, bytes]]) -> bytes:
    """A BigTIFF of one directory; a field is (tag, type, count, value), short values padded in place."""
    mark = b"II" if order == "<" else b"MM"
    data_start = 16 + 8 + 20 * len(fields) + 8
    entries, values = b"", b""
    for tag, kind, count, value in fields:
        place = (
            value.ljust(8, b"\0") if len(value) <= 8 else struct.pack(order + "Q", data_start + len(values))
        )
        entries += struct.pack(order + "HHQ", tag, kind, count) + place
        values += value if len(value) > 8 else b""
    head = mark + struct.pack(order + "HHHQQ", 43, 8, 0, 16, len(fields))
    return head + entries + bytes(8) + values


def box(kind: bytes, *parts: bytes) -> bytes:
    """An ISO base media box."""
    body = b"".join(parts)
    return struct.pack(">I", 8 + len(body)) + kind + body


def full_box(kind: bytes, version: int, *parts: bytes, flags: int = 0) -> bytes:
    """A box that begins with its version and flags."""
    return box(kind, struct.pack(">I", version << 24 | flags), *parts)


def heif(
    size: ImageSize, *, exif: bytes | None = None, xmp: bytes | None = None, in_idat: bool = False
) -> bytes:
    """A HEIF still with a thumbnail item before the primary one; its image data are nonsense."""
    primary, thumbnail, exif_item, xmp_item = 2, 1, 3, 4
    exif_data = b"" if exif is None else struct.pack(">I", 6) + b"Exif\0\0" + exif
    items = {primary: b"\1" * 10, thumbnail: b"\2" * 5, exif_item: exif_data, xmp_item: xmp or b""}
    present = {number: data for number, data in items.items() if data}
    kinds = {
        primary: b"hvc1\0",
        thumbnail: b"hvc1\0",
        exif_item: b"Exif\0",
        xmp_item: b"mime\0application/rdf+xml\0",
    }
    entries = [full_box(b"infe", 2, struct.pack(">HH", number, 0), kinds[number]) for number in present]
    properties = box(
        b"ipco",
        full_box(b"ispe", 0, struct.pack(">II", 16, 12)),
        box(b"irot", b"\1"),
        full_box(b"ispe", 0, struct.pack(">II", *size)),
    )
    ties = (
        struct.pack(">I", 2)
        + struct.pack(">HBB", thumbnail, 1, 1)
        + struct.pack(">HBBB", primary, 2, 2, 0x83)
    )

    def meta(start: int) -> bytes:
        offset, rows, stored = start, b"", b""
        for number, data in present.items():
            local = in_idat and number in {exif_item, xmp_item}
            place = len(stored) if local else offset
            rows += struct.pack(">HHHHII", number, 1 if local else 0, 0, 1, place, len(data))
            stored += data if local else b""
            offset += 0 if local else len(data)
        return full_box(
            b"meta",
            0,
            full_box(b"hdlr", 0, bytes(4), b"pict", bytes(13)),
            full_box(b"pitm", 0, struct.pack(">H", primary)),
            full_box(b"iloc", 1, b"\x44\x00", struct.pack(">H", len(present)), rows),
            full_box(b"iinf", 0, struct.pack(">H", len(entries)), *entries),
            box(b"iprp", properties, full_box(b"ipma", 0, ties)),
            box(b"idat", stored),
        )

    head = box(b"ftyp", b"heic", bytes(4), b"mif1heic")
    start = len(head) + len(meta(0)) + 8
    outside = b"".join(d for n, d in present.items() if not (in_idat and n in {exif_item, xmp_item}))
    return head + meta(start) + box(b"mdat", outside)
