"""Writing of an XMP packet (tag 700) into a TIFF or DNG without moving any data that offsets refer to.

A packet that is not longer than the old one replaces it. Otherwise it is appended, and the entry of tag 700
refers to it. If there is no such entry, a copy of the first directory with the entry is appended, and the
header refers to it.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from calibrary.errors import ParseError
from calibrary.parsers.imagery.directory import MAX_ENTRIES, TYPE_SIZES
from calibrary.parsers.imagery.tiff import MAX_PAGES, SUB_IFDS, XMP

BYTE: Final = 1
COG: Final = b"GDAL_STRUCTURAL_METADATA_SIZE="
"""Start of the header of a cloud-optimised GeoTIFF, which guarantees that its directories come first."""


class _Layout(NamedTuple):
    """Layout of a TIFF's directories: classic (32 bits) or BigTIFF (64 bits)."""

    order: str
    counter: str
    offset: str
    header: int

    @property
    def entry(self) -> str:
        """Format of an entry for :mod:`struct`: tag, type, count, value or offset."""
        return f"{self.order}HH{self.offset}{self.offset}"

    def read(self, code: str, data: bytes | bytearray, at: int) -> int:
        """Read one number."""
        return int(struct.unpack_from(self.order + code, data, at)[0])


def with_xmp(data: bytes, merge: Callable[[bytes | None], bytes], source: str) -> bytes:
    """Change the XMP of a TIFF.

    Args:
        data: the whole file.
        merge: makes the new packet from the old one, or from None if there is none.
        source: name of the image, for messages.

    Raises:
        ParseError: the file is broken, or would be broken by the change.
    """
    order = {b"II": "<", b"MM": ">"}.get(data[:2], "<")
    big = struct.unpack_from(f"{order}H", data, 2)[0] == 43
    layout = _Layout(order, "Q", "Q", 8) if big else _Layout(order, "H", "I", 4)
    try:
        changed = _changed(bytearray(data), layout, merge, source)
    except struct.error:
        raise ParseError("a TIFF directory is not whole", source=source) from None
    if not big and len(changed) >= 1 << 32:
        raise ParseError("with its XMP it would pass 4 GiB, the most that a TIFF holds", source=source)
    return bytes(changed)


def _changed(
    data: bytearray, layout: _Layout, merge: Callable[[bytes | None], bytes], source: str
) -> bytearray:
    first = layout.read(layout.offset, data, layout.header)
    for directory in (first, *_children(data, layout, first, source)):
        for at, tag in _entries(data, layout, directory, source):
            if tag == XMP:
                return _replaced(data, layout, at, merge, source)
    if COG in data[:512]:
        raise ParseError(
            "a cloud-optimised GeoTIFF without XMP would lose its layout; convert it to a plain one",
            source=source,
        )
    place, packet = len(data) + len(data) % 2, merge(None)
    data += bytes(place - len(data)) + packet + bytes(len(packet) % 2)
    entries = list(_entries(data, layout, first, source))
    size, head = struct.calcsize(layout.entry), struct.calcsize(layout.order + layout.counter)
    new = struct.pack(layout.entry, XMP, BYTE, len(packet), place)
    before = sum(tag < XMP for _, tag in entries)
    body = bytes(data[first + head : first + head + len(entries) * size])
    behind = bytes(data[first + head + len(body) :][: struct.calcsize(layout.order + layout.offset)])
    struct.pack_into(layout.order + layout.offset, data, layout.header, len(data))
    data += struct.pack(layout.order + layout.counter, len(entries) + 1)
    data += body[: before * size] + new + body[before * size :] + behind
    return data


def _replaced(
    data: bytearray, layout: _Layout, entry: int, merge: Callable[[bytes | None], bytes], source: str
) -> bytearray:
    """Replace the packet of an entry: in place if it fits, else at the end of the file."""
    _, kind, count, offset = struct.unpack_from(layout.entry, data, entry)
    length = count * TYPE_SIZES.get(kind, 0)
    room = struct.calcsize(layout.order + layout.offset)
    at = offset if length > room else entry + struct.calcsize(layout.entry) - room
    if not length or at + length > len(data):
        raise ParseError("its XMP (tag 700) is not whole", source=source)
    packet = merge(bytes(data[at : at + length]))
    if len(packet) <= length:
        data[at : at + length] = packet.ljust(length)
        return data
    place = len(data) + len(data) % 2
    data += bytes(place - len(data)) + packet
    struct.pack_into(layout.entry, data, entry, XMP, BYTE, len(packet), place)
    return data


def _entries(data: bytearray, layout: _Layout, directory: int, source: str) -> Iterator[tuple[int, int]]:
    """Yield offset and tag of every entry."""
    count, start = (
        layout.read(layout.counter, data, directory),
        directory + struct.calcsize(layout.order + layout.counter),
    )
    if count > MAX_ENTRIES:
        raise ParseError(
            f"a TIFF directory of {count} entries; at most {MAX_ENTRIES} are read", source=source
        )
    size = struct.calcsize(layout.entry)
    for at in range(start, start + count * size, size):
        yield at, layout.read("H", data, at)


def _children(data: bytearray, layout: _Layout, first: int, source: str) -> Iterator[int]:
    """Yield the SubIFDs of the first directory; DJI's DNG files have their XMP in one of them."""
    for at, tag in _entries(data, layout, first, source):
        if tag == SUB_IFDS:
            _, kind, count, offset = struct.unpack_from(layout.entry, data, at)
            code = {4: "I", 13: "I", 16: "Q", 18: "Q"}.get(kind)
            if code is None or count > MAX_PAGES:
                return
            inline = struct.calcsize(layout.order + layout.offset)
            place = (
                offset if count * TYPE_SIZES[kind] > inline else at + struct.calcsize(layout.entry) - inline
            )
            for number in range(count):
                yield layout.read(code, data, place + number * TYPE_SIZES[kind])
