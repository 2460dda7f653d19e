"""TIFF directories: the structure shared by TIFF files, DNG and EXIF blocks.

TIFF 6.0 §2 and the BigTIFF design of 2007: a byte-order mark, the offset of a first directory, and
directories of entries (tag, type, count, value or offset). All of it may be invalid, so the number of entries
is limited, the caller bounds the size of values, and the caller must terminate a walk along a chain of
directories.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

from msgspec import Struct

from calibrary.evidence.metadata import TagFault
from calibrary.parsers.imagery.source import Block

MAX_ENTRIES = 4096
"""Most entries of a directory; the largest real ones contain about two hundred."""

TYPE_SIZES = {
    1: 1,
    2: 1,
    3: 2,
    4: 4,
    5: 8,
    6: 1,
    7: 1,
    8: 2,
    9: 4,
    10: 8,
    11: 4,
    12: 8,
    13: 4,
    16: 8,
    17: 8,
    18: 8,
    129: 1,
}
"""Bytes per value: TIFF 6.0 types 1 to 12, IFD (13), BigTIFF's LONG8, SLONG8, IFD8, and EXIF 3.0's UTF-8."""

_INTEGER_CODES = {1: "B", 3: "H", 4: "I", 13: "I", 16: "Q", 18: "Q"}


class Entry(Struct, frozen=True):
    """One tag of a directory: TIFF type, stated number of values, and the value or its offset."""

    kind: int
    count: int
    inline: bytes


class Directory(Struct, frozen=True):
    """The requested entries of a directory, and the offset of the next directory (0 at the end).

    Attributes:
        complete: whether all stated entries were present.
    """

    entries: Mapping[int, Entry]
    next_offset: int
    complete: bool


class Tiff:
    """A TIFF structure: a whole file, or the EXIF block of another file.

    Attributes:
        block: the bytes.
        byte_order: "<" or ">", as in :mod:`struct`.
        first: offset of the first directory.
    """

    __slots__ = ("_big", "_offset", "block", "byte_order", "first")

    def __init__(self, block: Block) -> None:
        """Read the header.

        Raises:
            ParseError: there is no TIFF header.
        """
        header = block.read(0, 16)
        orders = {b"II": "<", b"MM": ">"}
        if header[:2] not in orders or len(header) < 8:
            raise block.source.broken(
                f"found {header[:4]!r} where a TIFF header was expected (II*\\0 or MM\\0*)"
            )
        self.block = block
        self.byte_order = orders[header[:2]]
        magic = self._unpack("H", header[2:4])
        self._big = magic == 43
        # Like exifread and Pillow, accept the 42 in the wrong byte order, which some cameras write.
        if magic not in {42, 43, 42 << 8} or (self._big and len(header) < 16):
            raise block.source.broken(
                f"found {header[:4]!r} where a TIFF header was expected (II*\\0 or MM\\0*)"
            )
        self._offset = struct.Struct(self.byte_order + ("Q" if self._big else "I"))
        (self.first,) = self._offset.unpack(header[8:16] if self._big else header[4:8])

    def directory(self, offset: int, wanted: frozenset[int]) -> Directory:
        """Read one directory, reduced to the tags in ``wanted``; of a duplicate tag the last one counts.

        Raises:
            ParseError: there cannot be a directory at this offset.
        """
        count_code, entry_code, entry_size = ("Q", "HHQ8s", 20) if self._big else ("H", "HHI4s", 12)
        count_size = struct.calcsize(count_code)
        head = self.block.read(offset, count_size)
        if not offset or len(head) < count_size:
            raise self.block.source.broken(f"a TIFF directory at byte {offset}, past the end of its block")
        count = self._unpack(count_code, head)
        if count > MAX_ENTRIES:
            raise self.block.source.broken(
                f"a TIFF directory of {count} entries; at most {MAX_ENTRIES} are read"
            )
        start, length = offset + count_size, count * entry_size
        body = self.block.read(start, length)
        whole = body[: len(body) // entry_size * entry_size]
        entries = _entries(whole, self.byte_order + entry_code, wanted)
        tail = self.block.read(start + length, self._offset.size)
        (following,) = self._offset.unpack(tail) if len(tail) == self._offset.size else (0,)
        return Directory(entries, following, complete=len(body) == length)

    def value(self, name: str, entry: Entry, limit: int) -> bytes | TagFault:
        """Read the raw bytes of a tag's values; returns a fault if they are not available.

        Args:
            name: name of the tag as users know it, for the fault.
            entry: from a directory of this structure.
            limit: longest accepted value.
        """
        size = TYPE_SIZES.get(entry.kind)
        if size is None:
            return TagFault(
                name, f"values of the unknown TIFF type {entry.kind}", "a type of the TIFF standard"
            )
        length = size * entry.count
        if length > limit:
            return TagFault(name, f"{entry.count} values, {length} bytes", f"at most {limit} bytes")
        if length <= len(entry.inline):
            return entry.inline[:length]
        (offset,) = self._offset.unpack(entry.inline)
        data = self.block.read(offset, length)
        if len(data) < length:
            return TagFault(
                name, f"{length} bytes at {offset}, of which {len(data)} are there", "a whole value"
            )
        return data

    def integers(self, entry: Entry, limit: int = 64) -> tuple[int, ...]:
        """Unsigned values of one tag; empty if they are not integers or not available."""
        code = _INTEGER_CODES.get(entry.kind)
        data = self.value("", entry, limit * TYPE_SIZES.get(entry.kind, 1))
        if code is None or isinstance(data, TagFault):
            return ()
        return struct.unpack(f"{self.byte_order}{entry.count}{code}", data)

    def _unpack(self, code: str, data: bytes) -> int:
        (value,) = struct.unpack(self.byte_order + code, data)
        return int(value)


@lru_cache(maxsize=64)
def _entries(body: bytes, layout: str, wanted: frozenset[int]) -> Mapping[int, Entry]:
    """The entries of a directory by tag; cached, because most images of a camera have the same ones."""
    return MappingProxyType(
        {
            tag: Entry(kind, count, inline)
            for tag, kind, count, inline in struct.iter_unpack(layout, body)
            if tag in wanted
        }
    )
