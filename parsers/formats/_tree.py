"""One tree of names and values for whatever people write by hand.

JSON, YAML, TOML, INI, CSV, XML, sheets of keys and values, printed arrays, terminal output, and the members of npz, npy
and mat files become the same: mappings, lists, numbers and texts. A value keeps its path, by which messages name it
(:class:`~calibrary.parsers.document.Node`). What the names mean is not known here.

Text is read line by line, because no syntax covers it: a key and its value (``fx = 812.5``, ``fx: 812.5``,
``fx,812.5``, ``fx 812.5``), a heading or ``[section]`` above others, rows of numbers below a heading or a key, and
arrays in brackets over several lines, as numpy, MATLAB, Python and OpenCV print them.
"""

from __future__ import annotations

import io
import re
import zipfile
import zlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

from msgspec import Struct

from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import HEAD_BYTES
from calibrary.parsers.document import Node, accounted, load_json
from calibrary.parsers.xml import parse_xml
from calibrary.records import Json
from calibrary.strictyaml import load_yaml

if TYPE_CHECKING:
    from lxml.etree import _Element

MAX_BYTES = 2 * 1024 * 1024
"""Longest text; a calibration with the corners of thousands of views is shorter."""
LONGEST_ROW = 4000
LONGEST_ARRAY = 64
"""Most numbers of a matrix or a lens; longer arrays are of something else."""
MOST_DEEP = 32
ZIP, NPY, MAT = b"PK\x03\x04", b"\x93NUMPY", b"MATLAB 5.0 MAT-file"
MAX_MEMBERS = 1000
LONGEST_MEMBER = LONGEST_ARRAY * 8 + 8192
"""An array and its header."""
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
YAML_TAGS = tuple(
    f"tag:yaml.org,2002:{name}"
    for name in ("opencv-matrix", "opencv-nd-matrix", "python/tuple", "map", "seq")
)
LONGER: Json = {"longer than an array of a camera": True}
"""In place of a member that is not read."""
OBJECTS = "Python objects"
"""Key of a member that is not opened."""
ROOTLESS = 'type_id="opencv-matrix"'
"""Mark of an OpenCV file with matrices but without the root element around them."""

_DECLARATION = re.compile(rb"\A\s*<\?xml[^>]{0,200}\?>")
_DIRECTIVE = re.compile(r"\A%(?=YAML)")
_BLANKS = re.compile(r"^[ \t]++$", re.MULTILINE)
_DOCUMENT = re.compile(r"^---[ \t]*$\n?", re.MULTILINE)
_NO_BLANK = re.compile(r"^([ \t]*[A-Za-z_]\w{0,60}):(?=[\d\[\"+-])", re.MULTILINE)
"""A key with its value right after the colon, which OpenCV reads and YAML does not."""
_YAML_LINE = re.compile(r"^(?:%YAML|---|- |[ \t]*[\"']?[A-Za-z_][\w .\-]{0,80}[\"']?[ \t]*:(?:[ \t]|$))")
# A sequence in OpenCV's XML: words and quoted texts. A quote inside a text cannot be distinguished from one around it.
_ITEM = r'(?:"[^"]*+"|[^\s"]++)'
_ITEMS = re.compile(rf'(?=.*"){_ITEM}(?:\s++{_ITEM})++', re.DOTALL)
_NUMBER = r"[+-]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][+-]?\d++)?+"
_NUMBERS = re.compile(_NUMBER)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")
_WHOLE = re.compile(r"[+-]?\d{1,18}")
_ALL_NUMBERS = re.compile(rf"[\s\[({{|]*+{_NUMBER}(?:[\s,;|\[\](){{}}]+{_NUMBER})*+[\s\])}}|,;]*+")
_SECTION = re.compile(r"\[{1,2}\s*([^\[\]]{0,79}[^\[\]\d\s.,;+-][^\[\]]{0,79}?)\s*\]{1,2}")
_ROW = re.compile(r"[\"']?([^\W\d][^=:\"']{0,119}?)[\"']?\s{0,40}(?::=|=|:(?!//))\s*(.*)")
_COLUMNS = re.compile(
    rf"[\"']?([^\W\d][\w .\-/\[\]()µ]{{0,79}}?)[\"']?(?:\s*[,;\t]\s*|\s+)(?=[\[(\"']|{_NUMBER}(?:\W|[x×]\d|\Z))(.+)"
)
_PAIR = re.compile(r"[A-Za-z]\w{0,40}\s*=\s*(?=[\w.+\-\[({\"'])")
_PAIRED = re.compile(
    r"^[^{\[\"'#\n]{0,99}\b[A-Za-z]\w{0,40}\s?=\s?[^\s,;]{1,40}[\s,;]{1,4}[A-Za-z]\w{0,40}\s?=", re.MULTILINE
)
"""Two keys and values in one line, which YAML takes as text."""
_LABEL = re.compile(r"[A-Za-z][\w ]{0,60}:\s+(?=[A-Za-z]\w*\s*=)")
_TUPLE = re.compile(r"\('(\w+) = ', (\[.*\])\)")
"""How Python 2 prints a name and a list."""
_COMMENT = re.compile(r"(?:#|//|;|%(?!YAML)|<!--)")
_LOGGED = re.compile(
    r"^\[\s*(?:info|warn|warning|debug|error)[^\]]{0,40}\]\s*(?:\[[^\]]{0,60}\]:?\s*)*", re.IGNORECASE
)
"""What logging puts before a line."""
_TRAILING = re.compile(r"\s(?:#|//|%)(?!\d).*")
_COMMENT_BEHIND = re.compile(r"\s(?:#|//|%(?!\d)|;).*")
_OPENS = re.compile(r"(?:[A-Za-z_][\w.]{0,40})?[\[({]")
_TOKEN = re.compile(rf"\"[^\"]*\"|'[^']*'|[\[({{\])}},;:=]|{_NUMBER}(?![\w.])|[^\s\[({{\])}},;:=\"']+")
_NPY_NAME = re.compile(rb"PK[\x03\x01][\x04\x02][\x00-\xff]{24,42}?([A-Za-z][\w.-]{0,60})\.npy")


@accounted
def tree_of(data: bytes, *, source: str) -> Node:
    """The tree of a file, whatever its container.

    Raises:
        ParseError: it is damaged, longer than is read, or no container of names and values.
    """
    if data.startswith(ZIP):
        return Node(arrays(data), source=source)
    if data.startswith(NPY):
        from calibrary.parsers.formats._npy import array  # noqa: PLC0415  loads numpy

        return Node({"K": array(data).tolist()}, source=source)
    strict.refuse_longer(data, MAX_BYTES, "text", source=source)
    text = strict.decode(data, source=source)
    head = text[:256].lstrip()
    if head.startswith("<"):
        return Node(_of_xml(data, source), source=source)
    if head.startswith(("{", "[")) and (tree := _of_json(data, source)) is not None:
        return tree
    return Node(_of_text(text, source), source=source)


def _of_json(data: bytes, source: str) -> Node | None:
    """The tree of JSON; None for brackets of another syntax, such as a printed array."""
    try:
        tree = load_json(data, source=source)
    except ParseError:
        if re.search(rb'"[^"]{1,100}"\s*:', data[:HEAD_BYTES]):
            raise
        return None
    value = _without_marks(tree.value) if b'"type_id"' in data else tree.value
    return Node(value if isinstance(value, dict) else {"": value}, source=source)


def _without_marks(value: Json) -> Json:
    """The tree without OpenCV's type marks in matrices, which are redundant."""
    if isinstance(value, list):
        return [_without_marks(item) for item in value]
    if not isinstance(value, dict):
        return value
    return {
        key: _without_marks(item) for key, item in value.items() if key != "type_id" or "data" not in value
    }


def _of_text(text: str, source: str) -> dict[str, Json]:
    """The tree of YAML, or of lines in no syntax."""
    first = next(
        (line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")), ""
    )
    is_marked = first.startswith(("%YAML", "---")) or "opencv-matrix" in text
    if not is_marked and (not _YAML_LINE.match(first) or _PAIRED.search(text)):
        return _Lines(text, source).tree()
    try:
        value = of_yaml(text, source=source)
    except ParseError as error:
        if is_marked or "!!python" in text:
            raise
        try:
            return _Lines(text, source).tree()
        except ParseError:
            raise error from None
    return value if isinstance(value, dict) else {"": value}


def of_yaml(text: str, *, source: str) -> Json:
    """The value of YAML, of OpenCV's dialect as well; of several documents a mapping, of equal ones the first.

    Raises:
        ParseError: it is not YAML.
    """
    # The directive becomes a comment, so that line numbers in messages stay correct.
    plain = _BLANKS.sub("", _DIRECTIVE.sub("#", text))
    if text.startswith("%YAML:"):
        plain = _NO_BLANK.sub(r"\1: ", plain)
    head, *rest = _DOCUMENT.split(plain)
    if not rest or not any(part.strip() for part in rest):
        return load_yaml(head, source=source, ignored_tags=YAML_TAGS)
    parts = [part for part in (head, *rest) if re.search(r"^[^#\s]", part, re.MULTILINE)]
    if not parts:
        return None
    if len(parts) == 1:
        return load_yaml(
            plain if rest[-1].strip() else plain.rstrip("- \n") + "\n", source=source, ignored_tags=YAML_TAGS
        )
    values = [load_yaml(part, source=source, ignored_tags=YAML_TAGS) for part in parts]
    if all(value == values[0] for value in values):
        return values[0]
    return {f"document {number}": value for number, value in enumerate(values, start=1)}


def _of_xml(data: bytes, source: str) -> dict[str, Json]:
    if b"<opencv_storage" not in data[:HEAD_BYTES] and ROOTLESS.encode() in data:
        data = b"<opencv_storage>" + _DECLARATION.sub(b"", data) + b"</opencv_storage>"
    root = parse_xml(data, source=source)
    value = _of_element(root, source)
    return value if isinstance(value, dict) else {str(root.tag): value}


def _of_element(element: _Element, source: str) -> Json:
    """An element's attributes and children as a mapping; without either its numbers, or its text."""
    children = list(element)
    if children and all(child.tag == "_" for child in children):
        return [_of_element(child, source) for child in children]
    table: dict[str, Json] = {
        _local(key): _scalar(str(text)) for key, text in element.attrib.items() if _local(key) != "type_id"
    }
    repeated: dict[str, list[Json]] = {}
    for child in children:
        key, value = _named(child, source)
        if key in table and element.tag == "opencv_storage":
            raise ParseError("it is a duplicate key", source=source, place=key)
        repeated.setdefault(key, []).append(value)
    for key, values in repeated.items():
        table[key] = values[0] if len(values) == 1 else values
        if element.tag == "opencv_storage" and len(values) > 1:
            raise ParseError("it is a duplicate key", source=source, place=key)
    text = (element.text or "").strip()
    if not table:
        return _scalar(text)
    if text and not children:
        table["value"] = _scalar(text)
    # In XML a single number, or none, is not a list.
    for key in {"data", "sizes"} & table.keys() if {"rows", "cols", "sizes"} & table.keys() else ():
        if not isinstance(table[key], list):
            table[key] = [] if table[key] == "" else [table[key]]
    return table


def _named(element: _Element, source: str) -> tuple[str, Json]:
    """Key and value of a child; ``<param name="fx" value="812.5"/>`` and ``<p name="fx">812.5</p>`` say fx."""
    name, rest = element.attrib.get("name"), set(element.attrib.keys()) - {"name", "value", "type", "unit"}
    if name and not rest and not len(element):
        text = element.attrib.get("value") or (element.text or "")
        return str(name), _scalar(str(text).strip())
    return _local(element.tag), _of_element(element, source)


def _local(name: object) -> str:
    return str(name).rpartition("}")[2]


def _scalar(text: str) -> Json:
    """The numbers of a text, one number, or the text itself, without quotes; quoted words are a list."""
    numbers = strict.plain_numbers(text, parts := text.split())
    if numbers:
        values: list[Json] = [
            int(part) if _WHOLE.fullmatch(part) else value for part, value in zip(parts, numbers, strict=True)
        ]
        return values if len(values) > 1 else values[0]
    if _ITEMS.fullmatch(text):
        return [item.strip('"') for item in re.findall(_ITEM, text)]
    return text[1:-1] if len(text) > 1 and text[0] == text[-1] in "\"'" else text


class _Table(Struct):
    """A heading that is open: how far it and what is below it are indented, and its keys."""

    indent: int
    keys: dict[str, Json]
    below: int | None = None


class _Lines:
    """Lines of text without a syntax of their own."""

    def __init__(self, text: str, source: str) -> None:
        self.source = source
        self.rows = [
            row.expandtabs().rstrip() if "\t" in row[:8] else row.rstrip() for row in text.split("\n")
        ]
        self.at = 0
        self.root: dict[str, Json] = {}
        self.open = [_Table(-1, self.root)]
        self.heading: tuple[str, int] | None = None

    def tree(self) -> dict[str, Json]:
        if (table := self._csv()) is not None:
            return table
        while self.at < len(self.rows):
            row = self.rows[self.at]
            body = _TUPLE.sub(r"\1 = \2", _LOGGED.sub("", row.strip()))
            if not body or _COMMENT.match(body):
                self.at += 1
                continue
            if len(row) > LONGEST_ROW and not _ALL_NUMBERS.fullmatch(row):
                raise self._error(f"{len(row)} characters in a line; at most {LONGEST_ROW} are read")
            self._row(body, len(row) - len(row.lstrip()))
        return self.root

    def _row(self, body: str, indent: int) -> None:
        is_numbers = _ALL_NUMBERS.fullmatch(body) is not None
        if not is_numbers and (found := _SECTION.fullmatch(body)):
            self._section(found[1])
        elif is_numbers or _OPENS.match(body):
            name = self.heading[0] if self.heading else ""
            indent = self.heading[1] if self.heading else indent
            self.heading = None
            self._put(name, self._array(body, is_named=bool(name)), indent)
            return
        elif len(_PAIR.findall(body)) > 1 and _depth(body) == 0:
            self._open_heading()
            table = _literal("{" + _LABEL.sub("", body) + "}")
            for key, value in table.items() if isinstance(table, dict) else ():
                self._put(key, value, indent)
        elif found := _ROW.fullmatch(body) or _COLUMNS.fullmatch(body):
            self._key(found[1].strip(), found[2].strip(), indent)
            return
        else:
            self._open_heading()
            self.heading = (body.rstrip(":").strip(), indent)
        self.at += 1

    def _key(self, key: str, text: str, indent: int) -> None:
        if text[:1] not in "\"'":
            text = (_TRAILING if _OPENS.match(text) else _COMMENT_BEHIND).sub("", f" {text}").strip()
        if not text:
            self._open_heading()
            self.heading = (key, indent)
            self.at += 1
        elif _OPENS.match(text):
            self._open_heading()
            self._put(key, self._array(text), indent)
        else:
            self._open_heading()
            self.at += 1
            value = _plain(text)
            if isinstance(value, list):
                value += self._more_rows()
            self._put(key, value, indent)

    def _more_rows(self) -> list[Json]:
        """Numbers of the lines below a line of numbers."""
        found: list[Json] = []
        while (
            self.at < len(self.rows)
            and self.rows[self.at].strip()
            and _ALL_NUMBERS.fullmatch(self.rows[self.at])
        ):
            found += [float(number) for number in _NUMBERS.findall(self.rows[self.at])]
            self.at += 1
        return found

    def _array(self, first: str, *, is_named: bool = True) -> Json:
        """The array that begins in this line: rows of numbers, or brackets up to the one that closes them."""
        if _ALL_NUMBERS.fullmatch(first) and _depth(first) == 0 and not _OPENS.match(first):
            rows = [[float(number) for number in _NUMBERS.findall(first)]]
            self.at += 1
            while self.at < len(self.rows) and (row := self.rows[self.at].strip()):
                if not _ALL_NUMBERS.fullmatch(row) or _OPENS.match(row):
                    break
                numbers = [float(number) for number in _NUMBERS.findall(row)]
                # Below no name, a row of another length is another array: a baseline below K.
                if not is_named and len(numbers) != len(rows[0]):
                    break
                rows.append(numbers)
                self.at += 1
            return list[Json](rows[0]) if len(rows) == 1 else list[Json](map(list[Json], rows))
        began, parts, depth = self.at, [first], _depth(first)
        self.at += 1
        while depth > 0:
            if self.at == len(self.rows):
                self.at = began
                raise self._error("a bracket is not closed; the text may be cut short")
            parts.append(self.rows[self.at])
            depth += _depth(self.rows[self.at])
            self.at += 1
        return _literal("\n".join(parts))

    def _section(self, name: str) -> None:
        """Open ``[camera.left]``, which ends every other section."""
        self.heading = None
        table = self.root
        for part in name.strip("\"'").split("."):
            inner = table.setdefault(part.strip(" \"'"), {})
            if not isinstance(inner, dict):
                raise self._error("a section has the name of a key")
            table = inner
        self.open = [_Table(-1, self.root), _Table(-1, table)]

    def _open_heading(self) -> None:
        """Open a table for the last heading, since what follows is not its value."""
        if self.heading is None:
            return
        name, indent = self.heading
        self.heading = None
        while len(self.open) > 1 and (self.open[-1].indent >= indent or _ends(self.open[-1], indent)):
            self.open.pop()
        if self.open[-1].indent >= 0 and self.open[-1].below is None:
            self.open[-1].below = indent
        keys: dict[str, Json] = {}
        self._put_in(self.open[-1].keys, name, keys)
        if len(self.open) < MOST_DEEP:
            self.open.append(_Table(indent, keys))

    def _put(self, name: str, value: Json, indent: int) -> None:
        while len(self.open) > 1 and (_ends(self.open[-1], indent) or indent < self.open[-1].indent):
            self.open.pop()
        table = self.open[-1]
        if table.indent >= 0 and table.below is None:
            table.below = indent
        self._put_in(table.keys, name, value)

    def _put_in(self, table: dict[str, Json], name: str, value: Json) -> None:
        """Add a key; an equal repetition is one, headings and arrays without a name may repeat."""
        if name not in table or table[name] == value:
            table[name] = value
            return
        if name and not isinstance(value, dict) and not isinstance(table[name], dict):
            raise self._error("it is a duplicate key with another value", place=name)
        number = 2
        while f"{name} {number}" in table:
            number += 1
        table[f"{name} {number}"] = value

    def _csv(self) -> dict[str, Json] | None:
        """Rows below names of columns; None for other text."""
        rows = [row.strip() for row in self.rows if row.strip() and not row.lstrip().startswith("#")]
        mark = next((mark for mark in ",;\t" if rows and rows[0].count(mark) > 1), None)
        if mark is None or len(rows) < 2 or len({row.count(mark) for row in rows}) > 1:
            return None
        names = [name.strip(" \"'") for name in rows[0].split(mark)]
        if not all(re.match(r"[A-Za-z]", name) for name in names if name) or len(set(names)) < len(names):
            return None
        found: list[Json] = []
        for row in rows[1:]:
            values = [_plain(cell.strip()) for cell in row.split(mark)]
            if sum(_NUMBERS.fullmatch(str(value)) is not None for value in values) * 2 < len(values):
                return None
            found.append(dict(zip(names, values, strict=True)))
        return {"row": found[0] if len(found) == 1 else found}

    def _error(self, message: str, place: str | None = None) -> ParseError:
        return ParseError(message, source=self.source, place=place or f"line {self.at + 1}")


def _ends(table: _Table, indent: int) -> bool:
    """Whether a line so far indented is no longer below a heading."""
    return table.indent >= 0 and table.below is not None and indent < table.below


def _depth(text: str) -> int:
    bare = re.sub(r"\"[^\"]*\"|'[^']*'", "", text)
    return sum(bare.count(mark) for mark in "[({") - sum(bare.count(mark) for mark in "])}")


def _plain(text: str) -> Json:
    """The value of a line: the numbers of a list without brackets, or text, a number as it is spelt."""
    text = text.removesuffix(";").rstrip(",").strip()
    if _DECIMAL_COMMA.fullmatch(text):
        return text
    if _ALL_NUMBERS.fullmatch(text) and len(found := _NUMBERS.findall(text)) > 1:
        return [float(number) for number in found]
    return text[1:-1] if len(text) > 1 and text[0] == text[-1] in "\"'" else text


def _literal(text: str) -> Json:
    """The value of brackets as Python, numpy, MATLAB or C print them; words before a bracket do not matter."""
    return _Literal(_TOKEN.findall(text)).value(0)


class _Literal:
    """The words and marks of a text in brackets."""

    def __init__(self, words: list[str]) -> None:
        self.words = words
        self.at = 0

    def next_is(self, marks: str) -> bool:
        """Whether the next is one of these marks."""
        return self.at < len(self.words) and self.words[self.at] in marks

    def value(self, depth: int) -> Json:
        """The next value."""
        if depth > MOST_DEEP:
            raise ParseError("brackets are nested too deeply")
        while (
            self.at + 1 < len(self.words)
            and self.words[self.at + 1] in "[({"
            and self.words[self.at][0].isalpha()
        ):
            self.at += 1
        word = self.words[self.at] if self.at < len(self.words) else ""
        self.at += 1
        if not word or word not in "[({":
            return _scalar(word)
        items, table = self._inside(depth)
        self.at += 1
        if table and (word == "{" or not items):
            return table
        # A call such as array([[…]], dtype=float64) is its first argument.
        return items[0] if word == "(" and len(items) == 1 and isinstance(items[0], list) else items

    def _inside(self, depth: int) -> tuple[list[Json], dict[str, Json]]:
        """What is in brackets: a list, or rows of it between semicolons; values with names are a mapping."""
        items: list[Json] = []
        rows: list[Json] = []
        table: dict[str, Json] = {}
        while self.at < len(self.words) and not self.next_is("])}"):
            if self.next_is(";"):
                rows.append(items)
                items = []
            if self.next_is(",;"):
                self.at += 1
                continue
            value = self.value(depth + 1)
            if self.next_is(":="):
                self.at += 1
                table[str(value)] = self.value(depth + 1)
            else:
                items.append(value)
        return ([*rows, items] if items else rows) if rows else items, table


def names_of_arrays(data: bytes) -> list[str]:
    """Names of the arrays at both ends of a zip; empty for another file."""
    if not data.startswith(ZIP):
        return []
    return [match.decode() for match in _NPY_NAME.findall(data[:HEAD_BYTES] + data[-HEAD_BYTES:])]


@accounted
def arrays(data: bytes) -> dict[str, Json]:
    """Every short array of numbers in an npz, as lists, by its name; texts beside them.

    Raises:
        ParseError: it is damaged, or has more members than are read.
    """
    if not data.startswith(ZIP):
        raise ParseError("it does not begin as a zip archive")
    members = data.count(b"PK\x01\x02")
    if members > MAX_MEMBERS:
        raise ParseError(f"the archive lists {members} arrays; at most {MAX_MEMBERS} are read")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return dict(_members(archive))
    except ParseError:
        raise
    except (
        zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, OSError, OverflowError, RuntimeError, ValueError
    ) as error:  # fmt: skip
        raise ParseError(f"the zip archive is damaged: {strict.shown(str(error), 80)}") from None


def _members(archive: zipfile.ZipFile) -> Iterator[tuple[str, Json]]:
    seen = set[str]()
    for item in archive.infolist():
        name, dot, suffix = item.filename.rpartition(".")
        if not dot or suffix != "npy":
            continue
        if name in seen:
            raise ParseError("it is a duplicate key", place=strict.shown(name))
        seen.add(name)
        if item.file_size > LONGEST_MEMBER:
            yield name, LONGER
            continue
        if item.flag_bits & 1 or item.compress_type not in METHODS:
            raise ParseError("the array is encrypted, or packed in an unusual way", place=name)
        with archive.open(item) as file:
            value = _of_npy(file.read(LONGEST_MEMBER + 1), name)
        if value is not None:
            yield name, value


def _of_npy(data: bytes, name: str) -> Json:
    """An array as lists or a number; None where it is longer than a camera's or no numbers."""
    from calibrary.parsers.formats import _npy  # noqa: PLC0415  loads numpy

    text = _npy.text(data)
    if text is not None:
        return text
    if _npy.is_of_objects(data):
        return {OBJECTS: name}
    if not _npy.is_numeric(data):
        return None
    array = _npy.array(data, place=name)
    value: Json = array.tolist() if array.size <= LONGEST_ARRAY else None
    return value
