"""Writing of an XMP packet into a JPEG: one APP1 segment is replaced or added, all other bytes are kept.

Offsets in EXIF and maker notes are relative to their own segment and stay valid. Only the index of a
multi-picture file (MPF, CIPA DC-007) refers to other segments: it contains the length of the first picture,
and the offsets of the others relative to the index. Both are corrected.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from calibrary.errors import ParseError

XMP: Final = b"http://ns.adobe.com/xap/1.0/\0"
EXTENSION: Final = b"http://ns.adobe.com/xmp/extension/\0"
EXIF: Final = b"Exif\0"
MPF: Final = b"MPF\0"
_APP0, _APP1, _APP2, _SOS, _EOI = 0xE0, 0xE1, 0xE2, 0xDA, 0xD9
_ALONE: Final = frozenset({0x01, *range(0xD0, 0xD9)})
_MP_ENTRY: Final = 0xB002
LONGEST: Final = 0xFFFF - 2
"""Most bytes of a segment's content."""


class _Segment(NamedTuple):
    """A marker segment: offsets of its marker, of its content, and of its end."""

    marker: int
    start: int
    content: int
    end: int

    def is_a(self, data: bytes, marker: int, identifier: bytes) -> bool:
        return self.marker == marker and data.startswith(identifier, self.content)


def with_xmp(
    data: bytes, merge: Callable[[bytes | None], bytes], foreign: frozenset[bytes], source: str
) -> bytes:
    """Change the XMP of a JPEG.

    Args:
        data: the whole file.
        merge: makes the new packet from the old one, or from None if there is none.
        foreign: words that must not occur in its extended XMP, which is kept.
        source: name of the image, for messages.

    Raises:
        ParseError: the file is broken, or the packet does not fit into a segment.
    """
    segments = list(_segments(data, source))
    packets = [one for one in segments if one.is_a(data, _APP1, XMP)]
    extended = b"".join(data[one.content : one.end] for one in segments if one.is_a(data, _APP1, EXTENSION))
    if any(word in extended for word in foreign):
        raise ParseError("its extended XMP has a calibration too, which is not changed", source=source)
    if len(packets) > 1:
        raise ParseError(f"it has {len(packets)} XMP packets, expected one at most", source=source)
    old = data[packets[0].content + len(XMP) : packets[0].end] if packets else None
    content = XMP + merge(old)
    if len(content) > LONGEST:
        raise ParseError(
            f"its XMP would have {len(content)} bytes, and a JPEG segment holds {LONGEST}", source=source
        )
    start, end = (packets[0].start, packets[0].end) if packets else [_place(data, segments)] * 2
    segment = struct.pack(">BBH", 0xFF, _APP1, len(content) + 2) + content
    grown = bytearray(data[:start] + segment + data[end:])
    for one in segments:
        if one.is_a(data, _APP2, MPF):
            _correct(grown, one, start, len(segment) - (end - start), source)
    return bytes(grown)


def _segments(data: bytes, source: str) -> Iterator[_Segment]:
    """The segments before the image data."""
    at = 2
    while True:
        start = data.find(b"\xff", at)
        marker = start
        while data[marker : marker + 1] == b"\xff":
            marker += 1
        code = data[marker] if start >= 0 and marker < len(data) else _EOI
        if code == _EOI:
            raise ParseError("the JPEG ends before its image data", source=source)
        at = marker + 1
        if code == _SOS:
            return
        if code in _ALONE or code == 0:
            continue
        length = int.from_bytes(data[at : at + 2], "big")
        if length < 2 or at + length > len(data):
            raise ParseError(f"a JPEG segment of {length} bytes is not whole", source=source)
        # Fill bytes before a marker belong to no segment.
        yield _Segment(code, marker - 1, at + 2, at + length)
        at += length


def _place(data: bytes, segments: list[_Segment]) -> int:
    """Offset of a new packet: after EXIF, else after JFIF, else first."""
    at = 2
    for one in segments:
        if one.marker == _APP0 or one.is_a(data, _APP1, EXIF):
            at = one.end
        else:
            break
    return at


def _correct(data: bytearray, index: _Segment, changed: int, delta: int, source: str) -> None:
    """Correct a multi-picture index after ``delta`` bytes were added at ``changed``.

    Raises:
        ParseError: the index is invalid.
    """
    header = index.content + len(MPF)
    moved = header + (delta if changed < header else 0)
    order = {b"II": "<", b"MM": ">"}.get(bytes(data[moved : moved + 2]), "")
    try:
        if not order or not delta:
            raise struct.error
        (first,) = struct.unpack_from(f"{order}I", data, moved + 4)
        (count,) = struct.unpack_from(f"{order}H", data, moved + first)
        for at in range(moved + first + 2, moved + first + 2 + 12 * count, 12):
            tag, _, length, offset = struct.unpack_from(f"{order}HHII", data, at)
            if tag != _MP_ENTRY:
                continue
            for entry in range(moved + offset, moved + offset + length, 16):
                size, place = struct.unpack_from(f"{order}II", data, entry + 4)
                if place == 0:
                    struct.pack_into(f"{order}I", data, entry + 4, size + delta)
                elif changed >= header:
                    struct.pack_into(f"{order}I", data, entry + 8, place + delta)
    except struct.error:
        if delta:
            raise ParseError(
                "its index of several pictures (MPF) cannot be read, and would no longer be right",
                source=source,
            ) from None
