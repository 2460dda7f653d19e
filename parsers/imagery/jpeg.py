"""JPEG: reading of the marker segments up to the scan, by seeking from one to the next.

ITU-T T.81 annex B for the markers, CIPA DC-008 §4.7 for EXIF in APP1, XMP part 3 §1.1.3 for XMP and
extended XMP. Of the other application segments only the first bytes are read, which name them; FLIR's and DJI's raw
temperatures and MPF's images are skipped. The quantisation tables are compared with those of the standard's annex K.
"""

from __future__ import annotations

import hashlib
import re
from functools import lru_cache
from typing import NamedTuple

from msgspec import Struct, field

from calibrary.calibration import ImageSize
from calibrary.evidence.metadata import Encoding, TagFault
from calibrary.parsers.imagery.head import MAX_XMP_BYTES, Head, checked_size
from calibrary.parsers.imagery.source import FIRST_CHUNK, Block, Source

SIGNATURE = b"\xff\xd8\xff"
EXIF_HEADER = b"Exif\0"
XMP_HEADER = b"http://ns.adobe.com/xap/1.0/\0"
EXTENDED_XMP_HEADER = b"http://ns.adobe.com/xmp/extension/\0"
_EXTENSION_FIELDS = len(EXTENDED_XMP_HEADER) + 32 + 4 + 4

MAX_SEGMENTS = 5000
"""Most segments; a 1280 × 1024 thermal image of DJI has sixty."""
MAX_XMP_PACKETS = 4
MAX_JUNK = 64 * 1024
"""Most bytes skipped in search of the next marker, as decoders do."""

_TABLES = 1024
"""Bytes read at the first table that is not in the buffer: mostly all tables and the frame header follow."""
_PROBE = 64
"""Bytes read at a segment that is not in the buffer: its marker, length and identifier."""

_MARKER = re.compile(rb"\xff[^\x00\xff]", re.DOTALL)
_SOI, _EOI, _SOS, _APP1, _TEM, _DQT, _DHT, _DRI = 0xD8, 0xD9, 0xDA, 0xE1, 0x01, 0xDB, 0xC4, 0xDD
_PROGRESSIVE = 0xC2
_NAMED_SEGMENTS = {
    0xE0: {b"JFIF\0": "JFIF"},
    0xE2: {b"MPF\0": "MPF", b"ICC_PROFILE\0": "ICC", b"FPXR\0": "FPXR"},
    0xED: {b"Photoshop ": "Photoshop"},
    0xEE: {b"Adobe": "Adobe"},
}
"""Segments that tell kinds of programs apart; those with a camera's data differ from image to image."""
_LONGEST_NAME = 12
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_STANDALONE = frozenset(range(0xD0, 0xD8)) | {_TEM, _SOI}


_LONGEST_FRAME, _LONGEST_TABLES, _MOST_TABLES = 6 + 3 * 4, 4 * 65, 4
_COMPONENTS = 5
"""Offset of the number of components in a frame header (T.81, B.2.2)."""
_CODE_LENGTHS = 1 + 16
_STANDARD_CODES = bytes([0, 0, 1, 5, 1, 1, 1, 1, 1, 1]).ljust(_CODE_LENGTHS, b"\0")
"""Numbers of codes of each length in table K.3, which encoders use that do not compute their own."""
_LUMINANCE = bytes.fromhex(
    "100b0c0e0c0a100e0d0e1211101318281a181616183123251d283a333d3c3933"
    "383740485c4e404457453738506d51575f626768673e4d71797064785c656763"
)
_CHROMINANCE = bytes.fromhex(
    "1112121815182f1a1a2f63423842636363636363636363636363636363636363"
    "6363636363636363636363636363636363636363636363636363636363636363"
)
"""ITU-T T.81 tables K.1 and K.2 in the order of the zigzag."""


class _Extension(NamedTuple):
    """One part of an extended XMP packet."""

    guid: bytes
    full_length: int
    position: int
    start: int
    length: int


class _Found(Struct):
    """Parts found so far."""

    size: ImageSize | None = None
    frame: bytes = b""
    progressive: bool = False
    restarts: bool = False
    codes: bytes = b""
    segments: list[str] = field(default_factory=list)
    tables: list[bytes] = field(default_factory=list)
    exif: Block | None = None
    xmp: list[bytes] = field(default_factory=list)
    extensions: list[_Extension] = field(default_factory=list)


def read_jpeg(source: Source) -> Head:
    """Read size, EXIF block and XMP packets of a JPEG.

    Raises:
        ParseError: the file ends, or the image data begin, before the frame header.
    """
    found = _Found()
    _walk(source, found)
    if found.size is None:
        raise source.broken("the JPEG has no frame header, so it has no size; it is cut off or damaged")
    packets, faults = _with_extensions(source, found.xmp, found.extensions)
    encoding = _encoding(
        tuple(found.segments),
        found.frame,
        b"".join(found.tables),
        found.codes,
        split_tables=len(found.tables) > 1,
        progressive=found.progressive,
        restarts=found.restarts,
    )
    return Head(size=found.size, exif=found.exif, xmp=packets, encoding=encoding, faults=faults)


def _walk(source: Source, found: _Found) -> None:
    offset, ahead = 2, _PROBE
    for _ in range(MAX_SEGMENTS):
        header = source.read(offset, 4, ahead=ahead)
        ahead = _PROBE
        if len(header) < 2 or header[0] != 0xFF or header[1] in {0x00, 0xFF}:
            offset = _next_marker(source, offset)
            header = source.read(offset, 4, ahead=_PROBE)
        marker = header[1] if len(header) >= 2 else _EOI
        if marker in _STANDALONE:
            offset += 2
            continue
        if marker in {_EOI, _SOS} or len(header) < 4:
            return
        start, size = offset + 4, max(int.from_bytes(header[2:4], "big") - 2, 0)
        _take(source, found, marker, start, size)
        offset = start + size
        if marker == _APP1:
            # Read XMP and the short segments after it at once; a server's first response ends with a whole chunk.
            ahead = FIRST_CHUNK - offset % FIRST_CHUNK
    raise source.broken(f"the JPEG has more than {MAX_SEGMENTS} segments before its image data")


def _take(source: Source, found: _Found, marker: int, start: int, size: int) -> None:
    """Read what is needed of a segment."""
    if marker == _APP1:
        _application_1(source, found, start, size)
    elif marker in _FRAMES and found.size is None:
        found.frame = source.read(start, min(size, _LONGEST_FRAME), ahead=_PROBE)
        found.size = _frame_size(source, found.frame)
        found.progressive = marker == _PROGRESSIVE
    elif marker == _DQT and len(found.tables) < _MOST_TABLES:
        found.tables.append(source.read(start, min(size, _LONGEST_TABLES), ahead=_TABLES))
    elif marker == _DHT and not found.codes:
        found.codes = source.read(start, min(size, _CODE_LENGTHS), ahead=_PROBE)
    elif marker == _DRI:
        found.restarts = True
    elif marker in _NAMED_SEGMENTS:
        _application(source, found, marker, start, size)


def _next_marker(source: Source, offset: int) -> int:
    """Offset of the next marker, after padding and junk as in decoders; the file's end if there is none."""
    junk = source.read(offset, MAX_JUNK)
    if marker := _MARKER.search(junk):
        return offset + marker.start()
    if len(junk) < MAX_JUNK:
        return source.size
    raise source.broken(f"the JPEG has {MAX_JUNK} bytes without a marker where its next segment should be")


def _frame_size(source: Source, frame: bytes) -> ImageSize:
    if len(frame) < 5:
        raise source.broken("the JPEG ends within its frame header")
    height, width = int.from_bytes(frame[1:3], "big"), int.from_bytes(frame[3:5], "big")
    return checked_size(source, width, height)


def _application(source: Source, found: _Found, marker: int, start: int, size: int) -> None:
    named = source.read(start, min(size, _LONGEST_NAME), ahead=_PROBE)
    for identifier, name in _NAMED_SEGMENTS[marker].items():
        if named.startswith(identifier) and name not in found.segments:
            found.segments.append(name)


# Cached: images of one camera have few combinations of them.
@lru_cache(maxsize=256)
def _encoding(
    segments: tuple[str, ...],
    frame: bytes,
    tables: bytes,
    codes: bytes,
    *,
    split_tables: bool,
    progressive: bool,
    restarts: bool,
) -> Encoding:
    count = frame[_COMPONENTS] if len(frame) > _COMPONENTS else 0
    factors = frame[_COMPONENTS + 2 : _COMPONENTS + 1 + 3 * count : 3]
    return Encoding(
        segments=segments,
        sampling=tuple((factor >> 4, factor & 15) for factor in factors),
        standard_tables=_are_among(tables, _standard_tables()),
        turned_tables=_are_among(tables, _turned_tables()),
        split_tables=split_tables,
        standard_codes=codes == _STANDARD_CODES,
        progressive=progressive,
        restarts=restarts,
    )


def _are_among(data: bytes, known: frozenset[bytes]) -> bool:
    """Whether each table of DQT segments is a known one."""
    at = 0
    while at < len(data):
        if data[at] >> 4 or data[at + 1 : at + 65] not in known:
            return False
        at += 65
    return bool(data)


@lru_cache(maxsize=1)
def _standard_tables() -> frozenset[bytes]:
    """The tables K.1 and K.2 in the order of the zigzag, scaled for each quality as libjpeg does."""
    scales = [5000 // quality if quality < 50 else 200 - 2 * quality for quality in range(1, 101)]
    return frozenset(
        bytes(min(max((value * scale + 50) // 100, 1), 255) for value in table)
        for table in (_LUMINANCE, _CHROMINANCE)
        for scale in scales
    )


@lru_cache(maxsize=1)
def _turned_tables() -> frozenset[bytes]:
    """The same with rows and columns exchanged; both are the same table at a quality of 100."""
    # The zigzag: along each diagonal, every other one upwards.
    cells = sorted(
        ((row, column) for row in range(8) for column in range(8)),
        key=lambda cell: (sum(cell), cell[sum(cell) % 2]),
    )
    order = [cells.index((column, row)) for row, column in cells]
    return frozenset(bytes(table[at] for at in order) for table in _standard_tables())


def _application_1(source: Source, found: _Found, start: int, size: int) -> None:
    identifier = source.read(start, min(size, _PROBE - 4), ahead=_PROBE)
    if identifier.startswith(EXIF_HEADER):
        if found.exif is None:
            found.segments.append("Exif")
            found.exif = source.block(start + 6, max(size - 6, 0))
    elif identifier.startswith(XMP_HEADER):
        if len(found.xmp) < MAX_XMP_PACKETS:
            found.xmp.append(source.read(start, size)[len(XMP_HEADER) :])
    elif identifier.startswith(EXTENDED_XMP_HEADER):
        fields = source.read(start, min(size, _EXTENSION_FIELDS), ahead=_EXTENSION_FIELDS)
        if len(fields) == _EXTENSION_FIELDS:
            guid, numbers = fields[len(EXTENDED_XMP_HEADER) : -8], fields[-8:]
            full_length, position = int.from_bytes(numbers[:4], "big"), int.from_bytes(numbers[4:], "big")
            data_start, length = start + _EXTENSION_FIELDS, size - _EXTENSION_FIELDS
            found.extensions.append(_Extension(guid, full_length, position, data_start, length))


def _with_extensions(
    source: Source, packets: list[bytes], extensions: list[_Extension]
) -> tuple[tuple[bytes, ...], tuple[TagFault, ...]]:
    """The packets, followed by the extension that one of them names (``xmpNote:HasExtendedXMP``)."""
    named = sorted({part.guid for part in extensions if any(part.guid in packet for packet in packets)})
    faults: list[TagFault] = []
    for guid in named[:MAX_XMP_PACKETS]:
        joined = _joined(
            source, sorted((part for part in extensions if part.guid == guid), key=lambda p: p.position)
        )
        if isinstance(joined, TagFault):
            faults.append(joined)
        else:
            packets = [*packets, joined]
    return tuple(packets), tuple(faults)


def _joined(source: Source, parts: list[_Extension]) -> bytes | TagFault:
    full_length, wanted = parts[0].full_length, "a whole extended XMP packet"
    if full_length > MAX_XMP_BYTES:
        return TagFault("XMP extension", f"{full_length} bytes", f"at most {MAX_XMP_BYTES} bytes")
    due = 0
    for part in parts:
        if part.position != due or part.full_length != full_length:
            return TagFault(
                "XMP extension", f"a part for byte {part.position} where byte {due} was due", wanted
            )
        due += part.length
    if due != full_length:
        return TagFault("XMP extension", f"{due} of {full_length} bytes", wanted)
    data = b"".join(source.read(part.start, part.length) for part in parts)
    if hashlib.md5(data, usedforsecurity=False).hexdigest().upper().encode() != parts[0].guid.upper():
        return TagFault("XMP extension", "bytes that do not match their digest", wanted)
    return data
