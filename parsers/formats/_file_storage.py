"""OpenCV's matrices in documents of any program: a mapping with rows, cols, dt and data, rows, or a flat list."""

from __future__ import annotations

import math
import re

from calibrary.parsers import text as strict
from calibrary.parsers.document import Node, accounted
from calibrary.parsers.formats._tree import LONGEST_ARRAY, MAX_BYTES, of_yaml, tree_of
from calibrary.records import Json

_KIND = re.compile(r"\d*[ucwsifdhr]")


@accounted
def load(data: bytes, *, source: str) -> Node:
    """Load the tree of a FileStorage file, or of a plain YAML or JSON mapping.

    Raises:
        ParseError: it is none of the three.
    """
    strict.refuse_longer(data, MAX_BYTES, "an OpenCV file", source=source)
    head = data[:256].lstrip(b"\xef\xbb\xbf\xff\xfe \t\r\n\0")
    if head.startswith((b"<", b"{")):
        return tree_of(data, source=source)
    tree = Node(of_yaml(strict.decode(data, source=source), source=source), source=source)
    if not isinstance(tree.value, dict):
        tree.fail("this is not a mapping, as an OpenCV file is")
    return tree


def matrix(node: Node, rows: int, columns: int) -> tuple[tuple[float, ...], ...]:
    """Read a matrix of a given shape: OpenCV's own, a list of rows, or a flat list.

    Raises:
        ParseError: it is not such a matrix, or its header contradicts its data.
    """
    if not _is_matrix(node.value):
        return node.matrix(rows, columns)
    shape = _shape(node)
    values = numbers(node, shape)
    if shape != (rows, columns):
        node.fail(f"the matrix is {_times(shape)}, expected {rows}×{columns}")
    return tuple(values[start : start + columns] for start in range(0, len(values), columns))


def numbers(node: Node, shape: tuple[int, ...] | None = None) -> tuple[float, ...]:
    """Read all numbers of a short vector of any shape: 1×N, N×1, a list, a list of lists.

    Args:
        node: the vector.
        shape: of a matrix with a header, if it is known.

    Raises:
        ParseError: it is not such a vector, or its header contradicts its data.
    """
    if not _is_matrix(node.value):
        if isinstance(node.value, list) and len(node.value) > LONGEST_ARRAY:
            node.fail(f"{len(node.value)} items, expected at most {LONGEST_ARRAY} numbers")
        return tuple(number for item in node.items() for number in _flat(item))
    shape = shape or _shape(node)
    kind = node["dt"].text() if "dt" in node else "d"
    if not _KIND.fullmatch(kind) or kind.lstrip("0123456789") != kind:
        node.fail(f"its elements are {strict.shown(kind)}, expected one number each")
    data = node["data"]
    length = len(data.value) if isinstance(data.value, list) else 1
    if min(shape, default=0) < 0 or length != math.prod(shape):
        node.fail(f"its header says {_times(shape)}, but there are {length} numbers")
    if length > LONGEST_ARRAY:
        node.fail(f"{length} numbers, expected at most {LONGEST_ARRAY}")
    return data.numbers()


def _is_matrix(value: Json) -> bool:
    return (
        isinstance(value, dict) and "data" in value and ({"rows", "cols"} <= value.keys() or "sizes" in value)
    )


def _shape(node: Node) -> tuple[int, ...]:
    if "sizes" in node:
        return tuple(item.whole() for item in node["sizes"].items())
    return node["rows"].whole(), node["cols"].whole()


def _times(shape: tuple[int, ...]) -> str:
    return "×".join(map(str, shape))


def _flat(node: Node) -> tuple[float, ...]:
    return node.numbers() if isinstance(node.value, list) else (node.number(),)
