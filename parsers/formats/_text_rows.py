"""Reading of short text files: as a whole, as lines, or as keys and values."""

from __future__ import annotations

import re

from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.document import Node
from calibrary.records import Json

MAX_BYTES = 1024 * 1024
"""Longest file; a thousand times the length of one camera."""

_SECTION = re.compile(r"\[\s*([^\[\]]*?)\s*\]")


def text_of(data: bytes, *, source: str | None = None, most: int = MAX_BYTES) -> str:
    """Decode the file as text.

    Raises:
        ParseError: it is not text, or longer than ``most`` bytes.
    """
    strict.refuse_longer(data, most, "such a file", source=source)
    return strict.decode(data, source=source)


def rows_of(data: bytes, *, source: str | None = None, most: int = MAX_BYTES) -> tuple[str, ...]:
    """The file's lines.

    Raises:
        ParseError: it is not text, or too long.
    """
    return strict.lines(text_of(data, source=source, most=most))


def keyed(data: bytes, source: str, *, sign: str = "=", comments: str = "", most: int = MAX_BYTES) -> Node:
    """The keys and values of lines, as text; those below a ``[section]`` are a table of that name.

    Args:
        data: the file.
        source: its name.
        sign: between key and value.
        comments: characters with which a comment begins.
        most: bytes that are read.

    Raises:
        ParseError: a line is neither, or a key or a section occurs twice.
    """
    tables: dict[str, Json] = {}
    table, place = tables, ""
    for number, raw in enumerate(rows_of(data, source=source, most=most), start=1):
        line = (re.split(f"[{comments}]", raw, maxsplit=1)[0] if comments else raw).strip()
        section = _SECTION.fullmatch(line)
        key, mark, value = (line, "", "") if section else line.partition(sign)
        if line and not section and not (mark and key.strip()):
            message = f"{strict.shown(line)}, expected a key, {sign!r} and a value"
            raise ParseError(message, source=source, place=f"line {number}")
        key = section[1] if section else key.strip()
        if line and key in (tables if section else table):
            raise ParseError("it is a duplicate key", source=source, place=key if section else place + key)
        if section:
            table, place = {}, f"{key}."
            tables[key] = table
        elif line:
            table[key] = value.strip()
    return Node(tables, source=source)
