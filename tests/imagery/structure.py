"""TIFF structures from their parts: the container that EXIF blocks and TIFF images share.

TIFF 6.0, section 2: a header, then directories of twelve-byte fields in ascending order of their tags, with
values of more than four bytes elsewhere. What a broken or hostile file gets wrong can be written as well: a
field of the wrong type, one that claims more values than it has or points outside the file, a directory that
names itself as its successor.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import TypeAlias

from calibrary.errors import InputError

Rational: TypeAlias = tuple[int, int]
"""(numerator, denominator) as stored, so that 0/0 and n/0 can be said."""
FieldValues: TypeAlias = str | bytes | tuple[int, ...] | tuple[float, ...] | tuple[Rational, ...]
"""Text (a NUL is added), bytes as they are, or one or more numbers."""


class ByteOrder(Enum):
    """The header's first two bytes; each value is the prefix that :mod:`struct` knows the order by."""

    LITTLE = "<"
    BIG = ">"

    def pack(self, codes: str, *values: float) -> bytes:
        """The values in this order."""
        return struct.pack(self.value + codes, *values)


class FieldType(IntEnum):
    """The twelve types of TIFF 6.0."""

    BYTE = 1
    ASCII = 2
    SHORT = 3
    LONG = 4
    RATIONAL = 5
    SBYTE = 6
    UNDEFINED = 7
    SSHORT = 8
    SLONG = 9
    SRATIONAL = 10
    FLOAT = 11
    DOUBLE = 12


_STRUCT_CODE = {
    FieldType.BYTE: "B",
    FieldType.SHORT: "H",
    FieldType.LONG: "I",
    FieldType.RATIONAL: "II",
    FieldType.SBYTE: "b",
    FieldType.SSHORT: "h",
    FieldType.SLONG: "i",
    FieldType.SRATIONAL: "ii",
    FieldType.FLOAT: "f",
    FieldType.DOUBLE: "d",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One entry of a directory.

    Attributes:
        tag: its number.
        type: a :class:`FieldType`, or a code that no reader knows (then ``values`` must be bytes).
        values: what it holds.
        count: how many values it claims, where that is not how many it has.
        offset: where it claims they are, where that is not where they are.
    """

    tag: int
    type: int
    values: FieldValues
    count: int | None = None
    offset: int | None = None

    def encoded(self, order: ByteOrder) -> tuple[int, bytes]:
        """(count, value bytes).

        Raises:
            InputError: the values do not fit the type.
        """
        if isinstance(self.values, str):
            text = self.values.encode() + b"\0"
            return len(text), text
        if isinstance(self.values, bytes):
            return len(self.values), self.values
        try:
            code = _STRUCT_CODE[FieldType(self.type)]
            rows = [value if isinstance(value, tuple) else (value,) for value in self.values]
            return len(rows), b"".join(order.pack(code, *row) for row in rows)
        except (KeyError, ValueError, TypeError, struct.error) as error:
            raise InputError(
                f"{self.values!r} cannot be stored as TIFF type {self.type}; expected values of that type",
                place=f"tag 0x{self.tag:04X}",
            ) from error


@dataclass(frozen=True, slots=True, kw_only=True)
class Chunks:
    """Data beside the directory with the two tags that lead to it: strips, tiles, a thumbnail.

    One bytes object that occurs several times is stored once, which makes a flat image of any size cheap.
    """

    offsets_tag: int
    counts_tag: int
    chunks: tuple[bytes, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ifd:
    """One image file directory.

    Attributes:
        fields: in any order; they are written in ascending order of their tags.
        children: (pointer tag, directory) pairs, such as 0x8769 for EXIF's.
        chunks: the data it describes.
        successor: where it claims the next directory is, where that is not where it is.
    """

    fields: tuple[Field, ...]
    children: tuple[tuple[int, Ifd], ...] = ()
    chunks: Chunks | None = None
    successor: int | None = None


def encode(
    directories: Sequence[Ifd], order: ByteOrder = ByteOrder.LITTLE, *, chunks_first: bool = False
) -> bytes:
    """A TIFF file, or the TIFF part of an EXIF block, from its chain of directories.

    Args:
        directories: IFD0, IFD1, …, each the successor of the one before.
        order: of the bytes.
        chunks_first: write each directory behind its data, as MicaSense cameras and libtiff do.

    Raises:
        InputError: a field's values do not fit its type.
    """
    writer = _Writer(order, chunks_first=chunks_first)
    # The header's pointer to IFD0 sits at byte 4; every directory ends in the pointer to its successor.
    pointer = 4
    for directory in directories:
        start, successor = writer.append(directory)
        writer.patch(pointer, order.pack("I", start))
        pointer = successor
    for position, claimed in writer.claimed_successors:
        writer.patch(position, order.pack("I", claimed))
    return bytes(writer.out)


class _Writer:
    """A growing file; directories are reserved first and filled once their values have a place."""

    def __init__(self, order: ByteOrder, *, chunks_first: bool) -> None:
        self.order = order
        self.chunks_first = chunks_first
        mark = b"II" if order is ByteOrder.LITTLE else b"MM"
        self.out = bytearray(mark + order.pack("HI", 42, 0))
        self.claimed_successors: list[tuple[int, int]] = []
        self._stored: dict[int, int] = {}

    def append(self, ifd: Ifd) -> tuple[int, int]:
        """Write a directory and all it holds: (where it starts, where its successor's pointer is)."""
        if self.chunks_first:
            self._store_chunks(ifd)
        entries = len(ifd.fields) + len(ifd.children) + (2 if ifd.chunks else 0)
        start = self._reserve(2 + 12 * entries + 4)
        rows = [(field.tag, self._row(field)) for field in ifd.fields]
        for tag, child in ifd.children:
            child_start, _ = self.append(child)
            rows.append((tag, self._row(Field(tag=tag, type=FieldType.LONG, values=(child_start,)))))
        if ifd.chunks is not None:
            offsets = self._store_chunks(ifd)
            counts = tuple(len(chunk) for chunk in ifd.chunks.chunks)
            for tag, values in ((ifd.chunks.offsets_tag, offsets), (ifd.chunks.counts_tag, counts)):
                rows.append((tag, self._row(Field(tag=tag, type=FieldType.LONG, values=values))))
        rows.sort(key=lambda row: row[0])
        self.patch(start, self.order.pack("H", entries) + b"".join(row for _, row in rows))
        successor = start + 2 + 12 * entries
        if ifd.successor is not None:
            self.claimed_successors.append((successor, ifd.successor))
        return start, successor

    def patch(self, position: int, data: bytes) -> None:
        self.out[position : position + len(data)] = data

    def _row(self, field: Field) -> bytes:
        count, payload = field.encoded(self.order)
        if field.offset is not None:
            place = self.order.pack("I", field.offset)
        elif len(payload) <= 4:
            place = payload.ljust(4, b"\0")
        else:
            place = self.order.pack("I", self._add(payload))
        claimed = count if field.count is None else field.count
        return self.order.pack("HHI", field.tag, field.type, claimed) + place

    def _store_chunks(self, ifd: Ifd) -> tuple[int, ...]:
        chunks = ifd.chunks.chunks if ifd.chunks else ()
        for chunk in chunks:
            if id(chunk) not in self._stored:
                self._stored[id(chunk)] = self._add(chunk)
        return tuple(self._stored[id(chunk)] for chunk in chunks)

    def _reserve(self, size: int) -> int:
        return self._add(bytes(size))

    def _add(self, data: bytes) -> int:
        # TIFF wants values and directories on even offsets.
        if len(self.out) % 2:
            self.out += b"\0"
        position = len(self.out)
        self.out += data
        return position
