"""MATLAB's binary files of version 5 to 7: reading of small variables as plain values.

No memory is allocated from sizes in headers: every array is as long as its bytes, a compressed variable is
unpacked only up to :data:`LARGEST`, and larger or irrelevant variables are skipped.

Source: The MathWorks, "MAT-File Format" (matfile_format.pdf), 2018.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator

from msgspec import Struct

from calibrary.arrays import np
from calibrary.errors import ParseError
from calibrary.parsers.document import accounted
from calibrary.parsers.formats._mcos import Objects
from calibrary.records import Json

HEADER = b"MATLAB 5.0 MAT-file"
HEADER_BYTES = 128
LARGEST = 4 * 1024 * 1024
"""Most bytes of one variable; a calibration's struct with the corners of a thousand photographs has half of that."""
TOTAL = 64 * 1024 * 1024
"""Most bytes of all compressed variables together; unpacked in a fraction of a second."""
SUBSYSTEM_AT = 116
"""Where the header states the place of the subsystem."""
FIRST = 4096
"""Bytes of a compressed variable that are unpacked to read its length."""
MOST_NUMBERS = 64
MOST_VARIABLES = 10_000
MAX_DEPTH = 12

MATRIX, COMPRESSED = 14, 15
CELL, STRUCT, OBJECT, CHAR, OPAQUE = 1, 2, 3, 4, 17
NUMERIC = range(6, 16)
KINDS = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
}  # fmt: skip
TEXTS = {16: "utf-8", 17: "utf-16", 18: "utf-32"}


class Variables(Struct, frozen=True):
    """Content of a file.

    Attributes:
        values: numbers, rows of numbers, text, and structs as mappings, by name.
        classes: MATLAB classes of variables whose objects could not be read.
    """

    values: dict[str, Json]
    classes: tuple[str, ...]

    @property
    def tree(self) -> dict[str, Json]:
        """The variables, as the account of the file looks through them."""
        return self.values


class _Opaque(Struct, frozen=True):
    """A variable that refers to objects of a MATLAB class.

    Attributes:
        kind: system of classes, such as MCOS.
        name: of the class.
        payload: the matrix of the reference.
    """

    kind: str
    name: str
    payload: bytes


@accounted
def variables(data: bytes, *, source: str) -> Variables:
    """Read the file's variables.

    Raises:
        ParseError: it is not such a file, it has more in it than is looked into, or it is truncated or damaged.
    """
    mark = data[126:128]
    if not data.startswith(HEADER) or mark not in (b"IM", b"MI"):
        raise ParseError("it does not begin as a MATLAB file of version 5 to 7", source=source)
    order = "<" if mark == b"IM" else ">"
    values: dict[str, Json] = {}
    opaque: dict[str, _Opaque] = {}
    try:
        for content in _contents(data, order, source):
            name, value = _matrix(content, order, 0)
            if isinstance(value, _Opaque):
                opaque[name] = value
            elif name and value is not None:
                values[name] = value
        objects = _objects(data, order) if opaque else None
        if objects is not None:
            for name, item in opaque.items():
                value = _plain(item.payload, order)
                values[name] = objects.resolved(value) if item.kind == "MCOS" else None
    except ParseError as error:
        raise ParseError(error.message, source=source, place=error.place) from None
    except (struct.error, zlib.error, ValueError, StopIteration, RuntimeError) as error:
        raise ParseError(f"the MATLAB file is damaged or cut short: {error}", source=source) from None
    left = tuple(item.name for name, item in opaque.items() if values.get(name) is None)
    return Variables({name: value for name, value in values.items() if value is not None}, left)


def _contents(data: bytes, order: str, source: str) -> Iterator[bytes]:
    """The variables, unpacked, without those that are too large.

    Raises:
        ParseError: there are too many, or they are too long together.
    """
    unpacked_bytes = 0
    for count, (kind, payload) in enumerate(_elements(data[HEADER_BYTES:], order)):
        if count == MOST_VARIABLES:
            raise ParseError(f"there are over {MOST_VARIABLES} variables", source=source)
        content = _content(kind, payload, order)
        if content is None:
            continue
        unpacked_bytes += len(content)
        if unpacked_bytes > TOTAL:
            raise ParseError(f"its variables are over {TOTAL} bytes unpacked", source=source)
        yield content


def _content(kind: int, payload: bytes, order: str) -> bytes | None:
    """The content of an element that is a matrix; None for another, or one that is too large."""
    return _unpacked(payload, order) if kind == COMPRESSED else payload if kind == MATRIX else None


def _objects(data: bytes, order: str) -> Objects | None:
    """The objects in the file's subsystem, whose place the header states; None if there is none."""
    [start] = struct.unpack_from(order + "Q", data, SUBSYSTEM_AT)
    if not HEADER_BYTES <= start < len(data):
        return None
    whole = _content(*next(_elements(data[start:], order)), order)
    if whole is None:
        return None
    _, _, _, (_, inner) = _elements(whole, order)
    order = "<" if inner[2:4] == b"IM" else ">"
    content = _content(*next(_elements(inner[8:], order)), order)
    cells = _wrapper(content, order) if content is not None else None
    if not cells:
        return None
    _, _, _, (_, meta) = _elements(cells[0], order)
    return Objects(cells, meta, order, lambda cell: _plain(cell, order))


def _wrapper(payload: bytes, order: str) -> list[bytes] | None:
    """The cells of the struct's field MCOS, a FileWrapper__."""
    _, _, _, (_, longest), (_, names), *fields = _elements(payload, order)
    [length] = struct.unpack_from(order + "i", longest)
    keys = [names[at : at + length].split(b"\0")[0] for at in range(0, len(names), max(1, length))]
    if b"MCOS" not in keys[: len(fields)]:
        return None
    _, _, _, _, (_, cell) = _elements(fields[keys.index(b"MCOS")][1], order)
    _, _, _, *cells = _elements(cell, order)
    return [content for _, content in cells]


def _plain(payload: bytes, order: str) -> Json:
    value = _matrix(payload, order, 0)[1]
    return None if isinstance(value, _Opaque) else value


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Yield type and bytes of each element; up to four bytes may be stored in the tag."""
    at = 0
    while at < len(data):
        kind, length = struct.unpack_from(order + "II", data, at)
        if kind >> 16:
            length, kind = kind >> 16, kind & 0xFFFF
            start, following, most = at + 4, at + 8, 4
        else:
            start, following, most = at + 8, at + 8 + length, len(data)
        if start + length > len(data) or length > most:
            raise ValueError(f"an element of {length} bytes where {len(data) - start} are left")
        yield kind, data[start : start + length]
        # Elements are padded to eight bytes, compressed ones are not.
        at = following if kind == COMPRESSED else -(-following // 8) * 8


def _unpacked(payload: bytes, order: str) -> bytes | None:
    """The matrix in a compressed element; None if it is too large or not a matrix."""
    unpacker = zlib.decompressobj()
    content = unpacker.decompress(payload, FIRST)
    kind, length = struct.unpack_from(order + "II", content)
    if kind != MATRIX or length > LARGEST:
        return None
    content += unpacker.decompress(unpacker.unconsumed_tail, length + 8)
    if len(content) < length + 8:
        raise ValueError("a compressed variable does not end")
    return content[8 : 8 + length]


def _matrix(payload: bytes, order: str, depth: int) -> tuple[str, Json | _Opaque]:
    """Name and value of a variable; the value is None if it is irrelevant for a camera."""
    if not payload:
        return "", None
    if depth > MAX_DEPTH:
        raise ValueError("structs are nested too deeply")
    parts = _elements(payload, order)
    [flags] = struct.unpack_from(order + "I", next(parts)[1])
    kind = flags & 0xFF
    if kind == OPAQUE:
        name, system, of_class = (
            text.decode("latin-1") for _, text in (next(parts), next(parts), next(parts))
        )
        return name, _Opaque(system, of_class, next(parts)[1])
    sides = next(parts)[1]
    shape = struct.unpack(f"{order}{len(sides) // 4}i", sides)
    name = next(parts)[1].decode("latin-1")
    count = math.prod(shape) if min(shape, default=-1) >= 0 else -1
    if count < 0:
        raise ValueError(f"an array of shape {shape}")
    if kind in NUMERIC:
        return name, _numbers(next(parts, (9, b"")), shape, count, order)
    if kind == CHAR:
        return name, _text(next(parts, (16, b"")), order)
    if kind in (STRUCT, OBJECT) and count == 1:
        return name, _struct(parts, order, depth, is_object=kind == OBJECT)
    if kind == CELL and count <= MOST_NUMBERS:
        return name, [_nested(inner, order, depth + 1) for _, inner in parts]
    return name, None


def _nested(payload: bytes, order: str, depth: int) -> Json:
    """A value in a struct or a cell; a reference to objects is its numbers."""
    value = _matrix(payload, order, depth)[1]
    return _nested(value.payload, order, depth + 1) if isinstance(value, _Opaque) else value


def _numbers(part: tuple[int, bytes], shape: tuple[int, ...], count: int, order: str) -> Json:
    """A number, a list for a row or column, or a list of rows; the file is in column-major order. NaN becomes None."""
    kind, data = part
    if count > MOST_NUMBERS or kind not in KINDS:
        return None
    flat = np.frombuffer(data, dtype=order + KINDS[kind]).astype(np.float64)
    if flat.size != count:
        raise ValueError(f"{flat.size} numbers where the shape is {shape}")
    if not np.isfinite(flat).all():
        return None
    if count == 1:
        return float(flat[0])
    values: Json = (flat if len(shape) != 2 or min(shape) < 2 else flat.reshape(shape, order="F")).tolist()
    return values


def _text(part: tuple[int, bytes], order: str) -> str:
    kind, data = part
    if kind in TEXTS:
        suffix = "" if kind == 16 else "-le" if order == "<" else "-be"
        return data.decode(TEXTS[kind] + suffix, "replace")
    return data.decode("utf-16" + ("-le" if order == "<" else "-be") if kind == 4 else "latin-1", "replace")


def _struct(parts: Iterator[tuple[int, bytes]], order: str, depth: int, *, is_object: bool) -> Json:
    """Read one struct; in an object the class name precedes the fields."""
    if is_object:
        next(parts)
    [longest] = struct.unpack_from(order + "i", next(parts)[1])
    names = next(parts)[1]
    if not 0 < longest <= len(names) + 1:
        return {}
    keys = [
        names[at : at + longest].split(b"\0")[0].decode("latin-1") for at in range(0, len(names), longest)
    ]
    table: dict[str, Json] = {}
    for key in keys:
        value = _nested(next(parts)[1], order, depth + 1)
        if value is not None:
            table[key] = value
    return table
