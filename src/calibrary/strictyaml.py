"""Strict reading of YAML as plain data: maps, lists and scalars, each with one meaning only.

Built on the event stream of PyYAML's parser (libyaml if PyYAML was built with it), which is iterative and safe.
PyYAML's loaders are neither: they recurse (50 kB of brackets end the interpreter), accept duplicate keys (the last one
wins), build cycles from aliases and read scalars by YAML 1.1, where ``1e-05`` is text, ``NO`` is false and
``12:30:45`` is 45045.

Scalars follow the core schema of YAML 1.2.2 (§10.3.2):

===========================================  =====================================================
``null``, ``~``, nothing                     None
``true``, ``False``, …                       bool
``12``, ``+5``, ``0o17``, ``0x1F``           int, within 64 bits
``1.10``, ``1e-05``, ``-.5``, ``5.``         float
``NO``, ``yes``, ``on``, ``12:30:45``,       text
``1_000``, ``2024-05-17``, anything quoted
===========================================  =====================================================

Rejected, with the line: duplicate keys, anchors and aliases, merge keys, tags, directives other than ``%YAML 1.2``,
more or fewer than one document, keys that are not scalars; and plain scalars that are not a finite number, or not the
same number to every reader: ``.nan``, ``inf``, ``1e400``, ``017`` (15 in YAML 1.1, 17 in 1.2, or a serial number).
Quoting makes any of these scalars text.

A key is always text: ``1:`` is the key "1". A value does not keep its spelling: an unquoted firmware ``1.10`` becomes
the number 1.1, and a schema that expects text rejects it with "quote it".
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Final, TypeAlias

import yaml
from msgspec import Struct
from yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    CollectionStartEvent,
    DocumentStartEvent,
    Event,
    MappingStartEvent,
    ScalarEvent,
)

from calibrary.errors import ParseError

YamlScalar: TypeAlias = str | int | float | bool | None
YamlValue: TypeAlias = "YamlScalar | list[YamlValue] | dict[str, YamlValue]"

MAX_BYTES: Final = 64 * 1024 * 1024
MAX_DEPTH: Final = 64
MAX_NUMBER_CHARACTERS: Final = 1000
"""The longest double needs 767 digits; the conversion time of longer ones grows with the square of the length."""

_LOADER: Final[type[yaml.SafeLoader]] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_RESERVED: Final[dict[str, bool | None]] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_STARTS_OF_MORE_THAN_TEXT: Final = frozenset({"", *"0123456789+-.nNiItTfF~"})
_INTEGER = re.compile(r"[-+]?[0-9]+")
_OTHER_BASE = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_QUOTE = "quote it if it is text, calibrate again if it is a result"
_NOT_FINITE = re.compile(r"[-+]?\.?(?:nan|inf|infinity)", re.IGNORECASE)
_LEADING_ZERO = re.compile(r"[-+]?0[0-9]+")


def load_yaml(
    data: bytes | str,
    *,
    source: str,
    max_bytes: int = MAX_BYTES,
    max_depth: int = MAX_DEPTH,
    ignored_tags: Collection[str] = (),
) -> YamlValue:
    """Parse one document into dicts with text keys, lists and scalars.

    Args:
        data: UTF-8, or UTF-16 with a byte order mark.
        source: name of the document in errors, usually the file name.
        max_bytes: largest accepted input.
        max_depth: deepest accepted nesting of maps and lists.
        ignored_tags: full tags of maps and lists to ignore, such as ``tag:yaml.org,2002:opencv-matrix``; every other
            tag is rejected.

    Raises:
        ParseError: the input is not YAML, is not plain data, or is ambiguous between readers; ``place`` is the line.
    """
    octets = _encoded(data, source) if isinstance(data, str) else data
    if len(octets) > max_bytes:
        raise ParseError(f"is {len(octets)} bytes of YAML, expected at most {max_bytes}", source=source)
    try:
        return _Reader(source, max_depth, frozenset(ignored_tags)).read(_LOADER(octets).get_event)
    except yaml.YAMLError as error:
        raise _syntax_error(error, octets, source) from None


def line_of(data: bytes | str, path: Sequence[str | int]) -> int | None:
    """Return the line (from 1) where the value at ``path`` starts, or that of its nearest existing ancestor.

    Used for messages. Values carry no line numbers, which keeps reading fast; the line of a wrong value is found by
    parsing again. None when ``data`` cannot be read.
    """
    try:
        load_yaml(data, source="")  # yaml.compose recurses without a limit; this checks the depth first.
    except ParseError:
        return None
    node = yaml.compose(data, Loader=_LOADER)
    for step in path:
        child: yaml.Node | None = None
        if isinstance(node, yaml.MappingNode):
            child = next((value for key, value in node.value if key.value == step), None)
        elif isinstance(node, yaml.SequenceNode) and isinstance(step, int) and 0 <= step < len(node.value):
            child = node.value[step]
        if child is None:
            break
        node = child
    return _line(node)


class Place(Struct, frozen=True):
    """Where a value of a document stands.

    Attributes:
        path: keys and positions that lead to it.
        start: offset of its key, or of the item of a list.
        texts: beginning and end of its key's and its own text, if it is a scalar.
    """

    path: tuple[str | int, ...]
    start: int
    texts: tuple[tuple[int, int], ...]


def places_in(text: str) -> list[Place]:
    """Return the places of all members and items of a document that :func:`load_yaml` accepts, in their order."""
    return [*_places(yaml.compose(text, Loader=_LOADER), ())]


def _places(node: yaml.Node | None, path: tuple[str | int, ...]) -> Iterator[Place]:
    members: list[tuple[yaml.Node | None, str | int, yaml.Node]] = []
    if isinstance(node, yaml.MappingNode):
        members = [(key, key.value, value) for key, value in node.value]
    elif isinstance(node, yaml.SequenceNode):
        members = [(None, at, value) for at, value in enumerate(node.value)]
    for key, step, value in members:
        scalars = [one for one in (key, value) if isinstance(one, yaml.ScalarNode)]
        texts = tuple((one.start_mark.index, one.end_mark.index) for one in scalars)
        yield Place((*path, step), (key or value).start_mark.index, texts)
        yield from _places(value, (*path, step))


class _Reader:
    """Builds one document from its events with an explicit stack, so that depth needs no recursion."""

    def __init__(self, source: str, max_depth: int, ignored_tags: frozenset[str]) -> None:
        self.source = source
        self.max_depth = max_depth
        self.ignored_tags = ignored_tags
        self.has_document = False

    def read(self, next_event: Callable[[], Event | None]) -> YamlValue:
        """Return the document's value. This is the hot loop."""
        root: list[YamlValue] = []
        container: list[YamlValue] | dict[str, YamlValue] = root
        outer: list[list[YamlValue] | dict[str, YamlValue]] = []
        key: str | None = None
        while (event := next_event()) is not None:
            value: YamlValue
            if isinstance(event, ScalarEvent):
                if key is None and isinstance(container, dict):
                    key = self.key(event, container)
                    continue
                value = self.scalar(event)
            elif isinstance(event, CollectionEndEvent):
                container = outer.pop()
                continue
            elif isinstance(event, CollectionStartEvent):
                self.check_start(
                    event, depth=len(outer) + 1, is_key=key is None and isinstance(container, dict)
                )
                value = {} if isinstance(event, MappingStartEvent) else []
            else:
                self.check_frame(event)
                continue
            if isinstance(container, list):
                container.append(value)
            elif key is not None:
                container[key] = value
                key = None
            if isinstance(value, (dict, list)):
                outer.append(container)
                container = value
        if root in ([], [None]):
            raise ParseError("contains no YAML value, expected a document", source=self.source)
        return root[0]

    def key(self, event: ScalarEvent, container: dict[str, YamlValue]) -> str:
        """Return the text of a key; keys are always text."""
        self.check_undecorated(event)
        text = self.text(event)
        if text in container:
            raise self.error(f"duplicate key {_excerpt(text)}", event)
        if not event.style and text in {"", "<<"}:
            what = "an empty key" if not text else "a merge key <<"
            raise self.error(f"{what}, expected a key of text: quote it, or write the merged keys out", event)
        return text

    def scalar(self, event: ScalarEvent) -> YamlScalar:
        """Return a scalar's value: text if quoted, otherwise by the core schema."""
        if event.anchor is not None or event.tag is not None:
            self.check_undecorated(event)
        text = self.text(event)
        if event.style or text[:1] not in _STARTS_OF_MORE_THAN_TEXT:
            return text
        if text in _RESERVED:
            return _RESERVED[text]
        if _FLOAT.fullmatch(text):
            return self.number(text, event)
        if _OTHER_BASE.fullmatch(text):
            return self.integer(int(text, 0), event)
        if _NOT_FINITE.fullmatch(text):
            raise self.error(f"{text} is not a finite number; {_QUOTE}", event)
        return text

    def text(self, event: ScalarEvent) -> str:
        """Return the text of a scalar; reject a lone surrogate, which PyYAML accepts without libyaml."""
        text: str = event.value
        if event.style == '"' and not text.isascii():
            try:
                text.encode()
            except UnicodeEncodeError as error:
                raise self.error(f"the lone surrogate {text[error.start]!a}, expected text", event) from None
        return text

    def number(self, text: str, event: ScalarEvent) -> int | float:
        """Return a decimal number; reject it unless it is finite and the same to every reader."""
        if len(text) > MAX_NUMBER_CHARACTERS:
            raise self.error(f"a number of {len(text)} characters; quote it if it is text", event)
        if not _INTEGER.fullmatch(text):
            value = float(text)
            if not math.isfinite(value):
                raise self.error(f"{_excerpt(text)} is not a finite number; {_QUOTE}", event)
            return value
        if _LEADING_ZERO.fullmatch(text):
            raise self.error(
                f"{_excerpt(text)} starts with 0, which some readers take for octal; quote it, or drop the 0",
                event,
            )
        return self.integer(int(text), event)

    def integer(self, value: int, event: ScalarEvent) -> int:
        """Return an integer; reject more than 64 bits, which other programs cannot hold."""
        if not -(2**63) <= value < 2**64:
            raise self.error(f"{_excerpt(event.value)} has more than 64 bits; quote it if it is text", event)
        return value

    def check_start(self, event: CollectionStartEvent, *, depth: int, is_key: bool) -> None:
        """Reject a map or list that has an anchor or tag, is a key, or is nested too deeply."""
        if event.anchor is not None or event.tag is not None:
            self.check_undecorated(event)
        if is_key:
            raise self.error("a key is a map or list, expected text", event)
        if depth > self.max_depth:
            raise self.error(f"nested more than {self.max_depth} deep", event)

    def check_undecorated(self, event: ScalarEvent | CollectionStartEvent) -> None:
        """Reject anchors and tags."""
        if event.anchor is not None:
            raise self.error(
                f"an anchor &{_excerpt(event.anchor)}, expected plain data: write the value out", event
            )
        ignored = isinstance(event, CollectionStartEvent) and event.tag in self.ignored_tags
        if event.tag is not None and "python/" in event.tag and not ignored:
            raise self.error(
                "a Python object, which no file may build: write its numbers, such as K.tolist()", event
            )
        if event.tag is not None and not ignored:
            raise self.error(f"a tag {_excerpt(event.tag)}, expected plain data: remove it", event)

    def check_frame(self, event: Event) -> None:
        """Reject aliases, directives that change the meaning, and a second document."""
        if isinstance(event, AliasEvent):
            raise self.error(
                f"an alias *{_excerpt(event.anchor or '')}, expected plain data: write the value out", event
            )
        if not isinstance(event, DocumentStartEvent):
            return
        if self.has_document:
            raise self.error("a second document starts, expected one", event)
        self.has_document = True
        if event.tags or event.version not in {None, (1, 2)}:
            raise self.error("a directive, expected none or %YAML 1.2: remove it", event)

    def error(self, message: str, event: Event) -> ParseError:
        """Return the error for the item that starts at ``event``."""
        return ParseError(message, source=self.source, place=f"line {_line(event)}")


def _encoded(text: str, source: str) -> bytes:
    try:
        return text.encode()
    except UnicodeEncodeError as error:
        line = text.count("\n", 0, error.start) + 1
        found = f"the lone surrogate {text[error.start]!a}"
        raise ParseError(f"{found}, expected text", source=source, place=f"line {line}") from None


def _syntax_error(error: yaml.YAMLError, octets: bytes, source: str) -> ParseError:
    """Convert the parser's error to a one-line ParseError."""
    if isinstance(error, yaml.MarkedYAMLError):
        mark = error.problem_mark or error.context_mark
        place = f"line {mark.line + 1}" if mark is not None else None
        began = (
            f"{error.context} from line {error.context_mark.line + 1} on"
            if error.context_mark
            else error.context
        )
        said = ", ".join(part for part in (began, error.problem) if part)
        return ParseError(f"not YAML: {said}", source=source, place=place)
    if isinstance(error, yaml.reader.ReaderError):
        line = octets.count(b"\n", 0, error.position) + 1
        return ParseError(f"not YAML text: {error.reason}", source=source, place=f"line {line}")
    return ParseError(f"not YAML: {error}", source=source)


def _line(item: Event | yaml.Node | None) -> int | None:
    mark = item.start_mark if item is not None else None
    return mark.line + 1 if mark is not None else None


def _excerpt(text: str, limit: int = 40) -> str:
    """Shorten a file's text and escape unprintable characters, for a message."""
    short = text if len(text) <= limit else text[: limit - 1] + "…"
    return short if short.isprintable() else ascii(short)
