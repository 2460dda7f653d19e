"""OpenCV's FileStorage, the container: one tree in three syntaxes, XML, YAML and JSON.

Its YAML is a dialect: up to OpenCV 4 the first line is ``%YAML:1.0``, which YAML parsers reject, and matrices
have the tag ``!!opencv-matrix``. A matrix is a mapping with rows, cols, dt and data in every syntax, and also
in the tree here, so that a file read in one syntax can be written in another. Numbers are plain; text is
quoted if the syntax requires.

Source: OpenCV, ``modules/core/src/persistence_{xml,yml,json}.cpp``.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from html import escape
from typing import TYPE_CHECKING

from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import HEAD_BYTES
from calibrary.parsers.document import Node, accounted, load_json
from calibrary.parsers.xml import parse_xml
from calibrary.records import Json
from calibrary.strictyaml import load_yaml

if TYPE_CHECKING:
    from lxml.etree import _Element

MATRIX = "opencv-matrix"
ND_MATRIX = "opencv-nd-matrix"
"""Type of a one-dimensional vector in OpenCV 5, with ``sizes`` in place of rows and cols."""
YAML_TAGS = tuple(f"tag:yaml.org,2002:{name}" for name in (MATRIX, ND_MATRIX))
MAX_BYTES = 2 * 1024 * 1024
"""Longest file; parsing it takes some seconds, and a calibration with thousands of views is shorter."""

LONGEST_VECTOR = 64
"""Most numbers of a matrix or a lens; longer vectors are ignored."""

ROOTLESS = 'type_id="opencv-matrix"'
"""Mark of an OpenCV file with matrices but without the root element around them."""
IN_QUOTES = str.maketrans({'"': "&quot;", "\n": "&#x0a;", "\t": "&#x09;"})

_ROOT = re.compile(rb"<opencv_storage[\s/>]")
_DECLARATION = re.compile(rb"\A\s*<\?xml[^>]{0,200}\?>")
_DIRECTIVE = re.compile(r"\A%(?=YAML)")
_BLANKS = re.compile(r"^[ \t]++$", re.MULTILINE)
"""Lines of blanks and tabs, which libyaml does not accept as empty."""
_KEY = re.compile(r"[A-Za-z]|[A-Za-z_][\w.-]+", re.ASCII)
# A sequence in XML: words and quoted texts. A quote inside a text cannot be distinguished from one around it.
_XML_ITEM = r'(?:"[^"]*+"|[^\s"]++)'
_XML_ITEMS = re.compile(rf"{_XML_ITEM}(?:\s++{_XML_ITEM})*+")
_WHOLE = re.compile(r"[+-]?\d{1,18}")
_KIND = re.compile(r"\d*[ucwsifdhr]")


@accounted
def load(data: bytes, *, source: str) -> Node:
    """Load the tree of a FileStorage file, or of a plain YAML or JSON mapping.

    Raises:
        ParseError: it is none of the three.
    """
    strict.refuse_longer(data, MAX_BYTES, "an OpenCV file", source=source)
    head = data[:256].lstrip(b"\xef\xbb\xbf\xff\xfe \t\r\n\0")
    if head.startswith(b"<"):
        if not _ROOT.search(data[:HEAD_BYTES]) and ROOTLESS.encode() in data:
            data = b"<opencv_storage>" + _DECLARATION.sub(b"", data) + b"</opencv_storage>"
        root = parse_xml(data, source=source)
        if root.tag != "opencv_storage":
            raise ParseError(
                f"the XML root is {strict.shown(f'<{root.tag}>')}, expected <opencv_storage>", source=source
            )
        tree = Node(_from_xml(root, source), source=source)
    elif head.startswith(b"{"):
        tree = Node(_without_marks(load_json(data, source=source).value), source=source)
    else:
        # The directive becomes a comment, so that line numbers in messages stay correct.
        plain = _BLANKS.sub("", _DIRECTIVE.sub("#", strict.decode(data, source=source)))
        yaml = load_yaml(plain, source=source, ignored_tags=YAML_TAGS)
        tree = Node(yaml, source=source)
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
        if isinstance(node.value, list) and len(node.value) > LONGEST_VECTOR:
            node.fail(f"{len(node.value)} items, expected at most {LONGEST_VECTOR} numbers")
        return tuple(number for item in node.items() for number in _flat(item))
    shape = shape or _shape(node)
    kind = node["dt"].text() if "dt" in node else "d"
    if not _KIND.fullmatch(kind) or kind.lstrip("0123456789") != kind:
        node.fail(f"its elements are {strict.shown(kind)}, expected one number each")
    data = node["data"]
    length = len(data.value) if isinstance(data.value, list) else 1
    if min(shape, default=0) < 0 or length != math.prod(shape):
        node.fail(f"its header says {_times(shape)}, but there are {length} numbers")
    if length > LONGEST_VECTOR:
        node.fail(f"{length} numbers, expected at most {LONGEST_VECTOR}")
    return data.numbers()


def holds(name: str, value: Json) -> bool:
    """Whether all three syntaxes, and OpenCV's parsers of them, accept key and value unchanged."""
    if not _KEY.fullmatch(name) or value is None:
        return False
    if isinstance(value, dict):
        return all(holds(key, item) for key, item in value.items())
    if isinstance(value, list):
        return all(holds(name, item) for item in value)
    return not isinstance(value, str) or value.replace("\n", "").replace("\t", "").isprintable()


def dump(tree: Mapping[str, Json], name: str) -> bytes:
    """Write the tree in the syntax that belongs to the file's suffix, as OpenCV does.

    Raises:
        UnsupportedModelError: the suffix belongs to no syntax.
    """
    suffix = name[name.rfind(".") :].lower() if "." in name else ""
    if suffix not in _WRITERS:
        raise UnsupportedModelError(
            f"the name ends in {strict.shown(suffix)}, which chooses none of OpenCV's syntaxes; "
            f"expected {', '.join(_WRITERS)}",
            source=name,
        )
    return _WRITERS[suffix](tree).encode()


def _is_matrix(value: Json) -> bool:
    return _mark(value) is not None


def _mark(value: Json) -> str | None:
    """The type mark that OpenCV writes with a matrix; None for any other value."""
    if not isinstance(value, dict) or "data" not in value:
        return None
    return MATRIX if {"rows", "cols"} <= value.keys() else ND_MATRIX if "sizes" in value else None


def _shape(node: Node) -> tuple[int, ...]:
    if "sizes" in node:
        return tuple(item.whole() for item in node["sizes"].items())
    return node["rows"].whole(), node["cols"].whole()


def _times(shape: tuple[int, ...]) -> str:
    return "×".join(map(str, shape))


def _without_marks(value: Json) -> Json:
    """The tree from JSON without the type marks in matrices, which are redundant."""
    if isinstance(value, list):
        return [_without_marks(item) for item in value]
    if not isinstance(value, dict):
        return value
    is_matrix = _is_matrix(value)
    return {key: _without_marks(item) for key, item in value.items() if not (is_matrix and key == "type_id")}


def _flat(node: Node) -> tuple[float, ...]:
    return node.numbers() if isinstance(node.value, list) else (node.number(),)


def _from_xml(element: _Element, source: str) -> Json:
    """An element's value: its children, else its numbers, else its text."""
    children = list(element)
    if children and all(child.tag == "_" for child in children):
        return [_from_xml(child, source) for child in children]
    if children:
        table: dict[str, Json] = {}
        for child in children:
            key = str(child.tag)
            if key in table:
                raise ParseError("it is a duplicate key", source=source, place=key)
            table[key] = _from_xml(child, source)
        if _is_matrix(table):
            # In XML a single number, or none, is not a list.
            for key in {"data", "sizes"} & table.keys():
                if not isinstance(table[key], list):
                    table[key] = [] if table[key] == "" else [table[key]]
        return table
    return _from_xml_text((element.text or "").strip())


def _from_xml_text(text: str) -> Json:
    numbers = strict.plain_numbers(text, parts := text.split())
    if numbers:
        pairs = zip(parts, numbers, strict=True)
        values: list[Json] = [int(part) if _WHOLE.fullmatch(part) else value for part, value in pairs]
    elif _XML_ITEMS.fullmatch(text):
        values = [_plain(item) for item in re.findall(_XML_ITEM, text)]
    else:
        return text[1:-1] if len(text) > 1 and text[0] == text[-1] == '"' else text
    return values if len(values) > 1 else values[0]


def _plain(token: str) -> Json:
    """The token as a number if it is one, else as text without quotes."""
    if token.startswith('"'):
        return token[1:-1]
    try:
        value = strict.number(token)
    except ParseError:
        return token
    return int(token) if _WHOLE.fullmatch(token) else value


def _xml(tree: Mapping[str, Json]) -> str:
    body = "\n".join(_xml_element(key, value) for key, value in tree.items())
    return f'<?xml version="1.0"?>\n<opencv_storage>\n{body}\n</opencv_storage>\n'


def _xml_element(key: str, value: Json, *, of_matrix: bool = False) -> str:
    if isinstance(value, dict):
        mark = _mark(value)
        inner = "".join(
            f"\n  {_xml_element(name, item, of_matrix=bool(mark))}" for name, item in value.items()
        )
        return f'<{key} type_id="{mark}">{inner}</{key}>' if mark else f"<{key}>{inner}</{key}>"
    if isinstance(value, list):
        if of_matrix or (len(value) > 1 and all(isinstance(item, int | float) for item in value)):
            return f"<{key}>\n    {' '.join(_token(item) for item in value)}</{key}>"
        return f"<{key}>{''.join(_xml_element('_', item) for item in value)}</{key}>"
    if isinstance(value, str):
        quoted = escape(value, quote=False).translate(IN_QUOTES)
        return f"<{key}>{quoted}</{key}>" if of_matrix else f'<{key}>"{quoted}"</{key}>'
    return f"<{key}>{_token(value)}</{key}>"


def _yaml(tree: Mapping[str, Json]) -> str:
    body = "".join(line for key, value in tree.items() for line in _yaml_lines(key, value, ""))
    return f"%YAML:1.0\n---\n{body}"


def _yaml_lines(key: str, value: Json, indent: str) -> Iterator[str]:
    deeper = indent + "   "
    if isinstance(value, dict):
        mark = _mark(value)
        yield f"{indent}{key}: !!{mark}\n" if mark else f"{indent}{key}:\n"
        for name, item in value.items():
            yield from _yaml_lines(name, item, deeper)
    elif isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        yield f"{indent}{key}:\n"
        for item in value:
            yield f"{deeper}- {_flow(item)}\n"
    else:
        yield f"{indent}{key}: {value if key == 'dt' else _flow(value, deeper)}\n"


def _flow(value: Json, indent: str = "   ") -> str:
    if isinstance(value, list):
        if not value:
            return "[ ]"
        rows = [
            ", ".join(_flow(item) for item in value[start : start + 4]) for start in range(0, len(value), 4)
        ]
        line_break = f",\n{indent}    "
        return f"[ {line_break.join(rows)} ]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{name}: {_flow(item)}" for name, item in value.items()) + " }"
    return _token(value)


def _token(value: Json) -> str:
    """A number with all digits, or text in quotes."""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, int | float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False)


def _json(tree: Mapping[str, Json]) -> str:
    return (
        json.dumps({key: _typed(value) for key, value in tree.items()}, indent=4, ensure_ascii=False) + "\n"
    )


def _typed(value: Json) -> Json:
    """The tree with OpenCV's type mark on every matrix."""
    if isinstance(value, list):
        return [_typed(item) for item in value]
    if not isinstance(value, dict):
        return value
    mark = _mark(value)
    typed: dict[str, Json] = {"type_id": mark} if mark else {}
    return typed | {key: _typed(item) for key, item in value.items()}


_WRITERS: dict[str, Callable[[Mapping[str, Json]], str]] = {
    ".yml": _yaml,
    ".yaml": _yaml,
    ".xml": _xml,
    ".json": _json,
}
SUFFIXES = tuple(_WRITERS)
