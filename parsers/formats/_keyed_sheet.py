"""A keyed calibration sheet taken apart: lines, sections, and which of them make one camera."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.formats._keyed_terms import Value, term, value
from calibrary.parsers.formats._short_text import short_text

__all__ = ["Line", "Sheet", "as_line", "is_apart", "matched", "sheets"]

MAX_BYTES = 256 * 1024
"""A sheet is a page; this is a hundred."""
LONGEST_ROW = 2000
MOST_SHARED = 100_000
"""Cameras times lines they share, every one of which is looked at for every camera."""
FOCAL = frozenset({"f", "fx", "fy"})

_SECTION = re.compile(r"\[\s*([^\[\]]{1,80}?)\s*\]")
_KEY_VALUE = re.compile(r"([^\W\d][^=:]{0,119}?)\s*[=:]\s*(\S.*)")
_COMMENT = re.compile(r"\s(?:#|;|//|%).*")
_COMMENTS = ("#", ";", "//", "%")
_SAFE = re.compile(r"[^\W\d][\w .\-]{0,118}")


@dataclass(frozen=True, slots=True)
class Line:
    """One key and its value, the section it stands in ("" before the first), and its number."""

    section: str
    key: str
    text: str
    number: int


@dataclass(slots=True)
class Sheet:
    """What is said of one camera.

    Attributes:
        section: the camera's own section, None where the file is about one camera.
        values: by the term's name.
        rest: unknown keys and their values, in order.
    """

    section: str | None
    values: dict[str, Value] = field(default_factory=dict)
    rest: list[tuple[str, str]] = field(default_factory=list)


def matched(row: str) -> re.Match[str] | None:
    """The key and the value of a row, None for one that is something else."""
    return _KEY_VALUE.fullmatch(row) if len(row) <= LONGEST_ROW else None


def is_apart(row: str) -> bool:
    """Whether a row, stripped, is empty, a comment or a section."""
    return not row or row.startswith(_COMMENTS) or _SECTION.fullmatch(row) is not None


def sheets(data: bytes, *, source: str) -> list[Sheet]:
    """One for every section that has a focal length of its own, or one for the whole file.

    Raises:
        ParseError: a line is something else, a key stands twice, or cameras are missing.
    """
    lines = list(_lines(short_text(data, source=source, max_bytes=MAX_BYTES), source))
    focal = (line.section for line in lines if (known := term(line.key)) and known[0] in FOCAL)
    sections = list(dict.fromkeys(focal))
    if len(sections) > 1 and "" in sections:
        raise ParseError(
            f"a focal length stands before the first section and another in [{sections[1]}]; wanted one for "
            "the whole file, or one in each camera's section",
            source=source,
        )
    if len(sections) < 2:
        found = [_sheet(None, lines, source)]
    else:
        found = [_sheet(name, own, source) for name, own in _shares(lines, sections, source)]
    for sheet in found:
        promised = sheet.values.get("cameras")
        if promised is not None and promised.numbers != (len(found),):
            raise ParseError(
                f"it says {promised.text} cameras and holds {len(found)}; it may be cut short",
                source=source,
                place=promised.key,
            )
    return found


def as_line(key: str, text: str) -> str | None:
    """A line that reads back the same, None where there is no such line."""
    if not _SAFE.fullmatch(key) or key != key.strip():
        return None
    plain = text and text == text.strip() and text.isprintable() and not text.startswith('"')
    if not plain or _COMMENT.search(f" {text}"):
        text = json.dumps(text)
    return f"{key} = {text}"


def _lines(text: str, source: str) -> Iterator[Line]:
    section = ""
    for number, raw in enumerate(strict.lines(text, source=source), start=1):
        row = raw.strip()
        name = _SECTION.fullmatch(row)
        if name is not None:
            section = name[1]
        if is_apart(row):
            continue
        found = matched(row)
        if found is None:
            raise ParseError(
                f"{strict.shown(row)} is neither key = value nor key: value",
                source=source,
                place=f"line {number}",
            )
        yield Line(section, found[1], _unquoted(found[2], source, f"line {number}"), number)


def _shares(lines: Iterable[Line], sections: Iterable[str], source: str) -> Iterator[tuple[str, list[Line]]]:
    """Each camera's section with its own lines and those that stand in no camera's, in the file's order."""
    own: dict[str, list[Line]] = {name: [] for name in sections}
    shared: list[Line] = []
    for line in lines:
        own.get(line.section, shared).append(line)
    if len(own) * len(shared) > MOST_SHARED:
        raise ParseError(
            f"{len(own)} cameras share {len(shared)} lines, more than are read; take out what is not about cameras",
            source=source,
        )
    for name, mine in own.items():
        yield name, sorted([*shared, *mine], key=lambda line: line.number)


def _unquoted(text: str, source: str, place: str) -> str:
    """A value without its comment; one in quotes keeps whatever stands between them."""
    if not text.startswith('"'):
        return _COMMENT.sub("", text, count=1).strip()
    try:
        found, end = json.JSONDecoder().raw_decode(text)
    except (ValueError, RecursionError):
        raise ParseError(f"{strict.shown(text)} has no closing quote", source=source, place=place) from None
    rest = text[end:].strip()
    if rest and not rest.startswith(_COMMENTS):
        raise ParseError(f"{strict.shown(rest)} stands after the quotes", source=source, place=place)
    return str(found)


def _sheet(section: str | None, lines: Iterable[Line], source: str) -> Sheet:
    sheet = Sheet(section)
    for line in lines:
        known = term(line.key)
        if known is None:
            own = line.section in {"", section}
            sheet.rest.append((line.key if own else f"{line.section}.{line.key}", line.text))
            continue
        name = known[0]
        if name in sheet.values:
            raise ParseError(
                f"{strict.shown(line.key)} means the same as {strict.shown(sheet.values[name].key)}, "
                "which stands there too",
                source=source,
                place=f"line {line.number}",
            )
        sheet.values[name] = value(line.key, line.text, source=source)
    return sheet
