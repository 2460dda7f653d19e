"""A JSON or YAML document with access by path, so that every error names the key.

>>> camera = load_json(b'{"cam0": {"intrinsics": [1, 2]}}', source="chain.json")["cam0"]
>>> camera["intrinsics"].numbers(4)
Traceback (most recent call last):
calibrary.errors.ParseError: chain.json: cam0.intrinsics: 2 numbers, expected 4
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any, Concatenate, NoReturn, ParamSpec, TypeVar

from msgspec import Struct, field

from calibrary.calibration import ImageSize
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.records import Json
from calibrary.strictjson import parse_json

P = ParamSpec("P")
T = TypeVar("T")


class Documents(Struct):
    """What a reading loads.

    Attributes:
        loaded: documents by the name of the loader and the bytes; what each is, its loader knows.
        aside: tables, lists and elements of them that the reader set aside.
        found: a document, and what the sniffer found in it.
    """

    loaded: dict[tuple[str, bytes], Any] = field(default_factory=dict)
    aside: list[object] = field(default_factory=list)
    found: tuple[object, Any] = (None, None)


_KEPT: ContextVar[Documents | None] = ContextVar("_KEPT", default=None)


@contextmanager
def keeping(documents: Documents) -> Iterator[None]:
    """Keep what is loaded; what is kept is returned instead of loaded again, and so read changed if it was changed."""
    token = _KEPT.set(documents)
    try:
        yield
    finally:
        _KEPT.reset(token)


def set_aside(*containers: object) -> None:
    """Say of tables, lists or elements of a document that nothing in them is of the cameras that are read.

    A reader says so of what another statement supersedes, and of other sensors; the account passes over them.
    """
    documents = _KEPT.get()
    if documents is not None:
        documents.aside += containers


def hand_on(tree: Node, found: object) -> None:
    """Keep what a sniffer found in a document for the reader, who else looks for it again."""
    documents = _KEPT.get()
    if documents is not None:
        documents.found = (tree.value, found)


def handed_on(tree: Node) -> Any:
    """What the sniffer found, once, for a later reading may be of a changed document; None if there is nothing."""
    documents = _KEPT.get()
    if documents is None:
        return None
    (document, found), documents.found = documents.found, (None, None)
    return found if document is tree.value else None


def accounted(load: Callable[Concatenate[bytes, P], T]) -> Callable[Concatenate[bytes, P], T]:
    """Decorate a loader. One that calls another stands for both."""

    @wraps(load)
    def loaded(data: bytes, /, *args: P.args, **kwargs: P.kwargs) -> T:
        documents = _KEPT.get()
        if documents is None:
            return load(data, *args, **kwargs)
        key = (load.__name__, data)
        found: T
        if key in documents.loaded:
            found = documents.loaded[key]
            return found
        before = len(documents.loaded)
        found = load(data, *args, **kwargs)
        for inner in list(documents.loaded)[before:]:
            del documents.loaded[inner]
        documents.loaded[key] = found
        return found

    return loaded


class Node(Struct, frozen=True, eq=False):
    """One value of a document, with its place.

    Attributes:
        value: as loaded.
        source: file name, for messages.
        place: path of the value, such as ``cam0.intrinsics[2]``; None for the document itself.
    """

    value: Json
    source: str
    place: str | None = None

    def fail(self, message: str) -> NoReturn:
        """Refuse the value.

        Raises:
            ParseError: always, at this place.
        """
        raise ParseError(message, source=self.source, place=self.place)

    def __contains__(self, key: str) -> bool:
        return isinstance(self.value, dict) and key in self.value

    def __getitem__(self, key: str) -> Node:
        """The value of a key of a mapping.

        Raises:
            ParseError: this is not a mapping, or it has no such key.
        """
        table = self.value if isinstance(self.value, dict) else self._table()
        if key not in table:
            self.fail(f"there is no {strict.shown(key)}; there are {_key_list(table)}")
        return Node(table[key], source=self.source, place=f"{self.place}.{key}" if self.place else key)

    def get(self, key: str) -> Node | None:
        """The value of a key of a mapping; None if there is no such key or its value is null."""
        return None if self._table().get(key) is None else self[key]

    def keys(self) -> tuple[str, ...]:
        """The keys of a mapping, in the document's order."""
        return tuple(self._table())

    def entries(self) -> Iterator[tuple[str, Node]]:
        """The keys of a mapping with their values, in the document's order."""
        for key in self._table():
            yield key, self[key]

    def items(self) -> tuple[Node, ...]:
        """The items of a list.

        Raises:
            ParseError: this is not a list.
        """
        if not isinstance(self.value, list):
            self.fail(f"this is {_kind(self.value)}, expected a list")
        here = self.place or ""
        return tuple(
            Node(item, source=self.source, place=f"{here}[{index}]") for index, item in enumerate(self.value)
        )

    def text(self) -> str:
        """The value as a string.

        Raises:
            ParseError: it is not a string.
        """
        if not isinstance(self.value, str):
            self.fail(f"this is {_kind(self.value)}, expected text")
        return self.value

    def number(self) -> float:
        """The value as a finite number; also accepts a number in quotes, which some programs write.

        Raises:
            ParseError: it is not a finite number.
        """
        value = self.value
        if isinstance(value, str):
            return strict.number(value, source=self.source, place=self.place)
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fail(f"this is {_kind(value)}, expected a number")
        try:
            converted = float(value)
        except OverflowError:
            converted = math.inf
        if not math.isfinite(converted):
            self.fail(f"this is not finite, {strict.FINITE}")
        return converted

    def whole(self) -> int:
        """The value as an integer; also accepts 5472.0.

        Raises:
            ParseError: it is not an integer.
        """
        value = self.number()
        if value != int(value):
            self.fail(f"{value:g} has a fraction, expected a whole number")
        return int(value)

    def numbers(self, count: int | Sequence[int] | None = None) -> tuple[float, ...]:
        """The value as a list of finite numbers of the given length (or one of the given lengths).

        Raises:
            ParseError: it is not such a list.
        """
        if isinstance(self.value, list):
            strict.check_count(len(self.value), count, source=self.source, place=self.place)
            # The same as below, without a Node for each.
            plain = [
                float(one)
                for one in self.value
                if isinstance(one, int | float) and not isinstance(one, bool) and -1e300 < one < 1e300
            ]
            if len(plain) == len(self.value):
                return tuple(plain)
        return tuple(item.number() for item in self.items())

    def matrix(self, rows: int, columns: int) -> tuple[tuple[float, ...], ...]:
        """The value as a matrix, from a list of rows or from one list in row-major order.

        Raises:
            ParseError: it is not a matrix of that shape.
        """
        if isinstance(self.value, list) and self.value and isinstance(self.value[0], list):
            if len(self.value) != rows:
                self.fail(f"{len(self.value)} rows, expected {rows}")
            return tuple(item.numbers(columns) for item in self.items())
        flat = self.numbers(rows * columns)
        return tuple(flat[start : start + columns] for start in range(0, len(flat), columns))

    def image_size(self, width: str, height: str) -> ImageSize:
        """(width, height) in px from two keys of a mapping.

        Raises:
            ParseError: one is missing or not a positive integer.
        """
        return strict.image_size(
            self[width].number(), self[height].number(), source=self.source, place=self.place
        )

    def _table(self) -> dict[str, Json]:
        if not isinstance(self.value, dict):
            self.fail(f"this is {_kind(self.value)}, expected a mapping")
        return self.value


@accounted
def load_json(data: bytes, *, source: str) -> Node:
    """Load a JSON document.

    Raises:
        ParseError: the bytes are not JSON, an object has a duplicate key, or the nesting is too deep.
    """
    return Node(parse_json(data, source=source), source=source)


def _key_list(table: dict[str, Json], most: int = 12) -> str:
    names = ", ".join(strict.shown(key) for key in list(table)[:most])
    return (names or "no keys") + (", …" if len(table) > most else "")


def _kind(value: Json) -> str:
    if value is None:
        return "empty"
    if isinstance(value, bool):
        return "a yes or no"
    if isinstance(value, str):
        return f"text ({strict.shown(value)})"
    if isinstance(value, list):
        return "a list"
    return "a mapping" if isinstance(value, dict) else "a number"
