"""Reading of an array from a ``.npy`` file without numpy's loader: no pickle, no allocation from sizes in the header.

Source: NEP 1, "A simple file format for NumPy arrays" (numpy.lib.format).
"""

from __future__ import annotations

import math
import re
import struct

from calibrary.arrays import NDArray, np
from calibrary.errors import ParseError

MAGIC = b"\x93NUMPY"
LONGEST_HEADER = 4096
# The header is a Python literal; a pattern reads the three entries that every writer makes, without evaluation.
_HEADER = re.compile(
    r"\{\s*(?=[^}]*'descr':\s*'(?P<kind>[<>|]?(?:f[248]|[iu][1248]))')"
    r"(?=[^}]*'fortran_order':\s*(?P<fortran>True|False))"
    r"(?=[^}]*'shape':\s*\((?P<shape>[\d, ]*)\))[^{}]*\}\s*"
)


def array(data: bytes, *, place: str | None = None) -> NDArray[np.float64]:
    """Read the array; the header is checked before anything is allocated.

    Raises:
        ParseError: it is not an array of plain numbers, or the file is truncated.
    """
    if not data.startswith(MAGIC):
        raise ParseError("it does not begin as a numpy file", place=place)
    header, body = _parts(data, place)
    found = _HEADER.fullmatch(header.decode("latin-1"))
    if found is None:
        raise ParseError("the array's elements are not plain numbers, expected floats", place=place)
    sides = found["shape"].replace(",", " ").split()
    if len(sides) > 8 or any(len(side) > 12 for side in sides):
        raise ParseError("the shape in its header is not an array's", place=place)
    shape = tuple(int(side) for side in sides)
    kind = np.dtype(found["kind"])
    if len(body) != math.prod(shape) * kind.itemsize:
        raise ParseError(
            f"{len(body)} bytes of numbers, expected {math.prod(shape) * kind.itemsize} for the shape {shape}",
            place=place,
        )
    flat = np.frombuffer(body, dtype=kind).astype(np.float64)
    return flat.reshape(shape, order="F" if found["fortran"] == "True" else "C")


def is_of_objects(data: bytes) -> bool:
    """Whether the header states an array of pickled Python objects."""
    return data.startswith(MAGIC) and b"'descr': '|O'" in data[:LONGEST_HEADER]


def is_numeric(data: bytes) -> bool:
    """Whether the header states an array of plain numbers, which :func:`array` then checks."""
    return (
        data.startswith(MAGIC)
        and re.search(rb"'descr': '[<>|]?[fiu][1248]'", data[:LONGEST_HEADER]) is not None
    )


def text(data: bytes) -> str | None:
    """The text of an array of one string; None for any other array."""
    found = re.match(rb"\x93NUMPY[\x00-\xff]{4}\{'descr': '<U\d{1,4}'[^{}]*'shape': \(\), \} *\n", data)
    return None if found is None else data[found.end() :].decode("utf-32-le", "replace").rstrip("\0")


def _parts(data: bytes, place: str | None) -> tuple[bytes, bytes]:
    """Split a file into its header and its numbers."""
    version, rest = data[6:8], data[8:]
    width = {b"\1\0": 2, b"\2\0": 4, b"\3\0": 4}.get(version)
    if width is None or len(rest) < width:
        raise ParseError(
            f"numpy file version {version.hex()} is not known, or the file is cut short",
            place=place,
        )
    [length] = struct.unpack("<H" if width == 2 else "<I", rest[:width])
    header = rest[width : width + length]
    if length > LONGEST_HEADER or len(header) < length:
        raise ParseError(
            f"the numpy header of {length} bytes is too long, or the file is cut short",
            place=place,
        )
    return header, rest[width + length :]
