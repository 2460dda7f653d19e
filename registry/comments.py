"""Comments and the order of fields that people put into a file of YAML, kept when the file is written again.

A comment on a line of its own belongs to the field or item of a list that comes next; one at the end of a line, to the
first of that line. If that is gone, it moves to the next one that is left, or to the end: none is dropped. Blank lines
are comments without a text.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Final

from msgspec import Struct

from calibrary.errors import ParseError
from calibrary.records import Json
from calibrary.strictyaml import Place, YamlValue, load_yaml, places_in

_COMMENT: Final = re.compile(r"^[ \t]*$|(?<!\S)#[^\n]*", re.MULTILINE)
_BREAK: Final = re.compile("\r\n?|[\x85\u2028\u2029]")


class _Comment(Struct, frozen=True):
    """A comment.

    Attributes:
        text: with its #; empty for a blank line.
        place: number of the place that it belongs to, in the order of the file.
        is_beside: whether it is at the end of that place's line.
    """

    text: str
    place: int
    is_beside: bool


def in_order_of(document: Mapping[str, Json], former: YamlValue) -> dict[str, Json]:
    """Return a document with its members in the order of another one; new ones follow those that they follow now."""
    if not isinstance(former, dict):
        return dict(document)
    order = [name for name in former if name in document]
    last: str | None = None
    for name in document:
        if name not in former:
            order.insert(order.index(last) + 1 if last is not None else 0, name)
        last = name
    found = {}
    for name in order:
        value = document[name]
        found[name] = in_order_of(value, former.get(name)) if isinstance(value, dict) else value
    return found


def comments_in(data: bytes) -> frozenset[str]:
    """Return the texts of all comments in a file; of one that is not YAML, all that may be one."""
    try:
        _, found = _read(data)
    except (ParseError, UnicodeError):
        lines = (line.partition("#")[2] for line in data.decode("utf-8", "replace").splitlines())
        return frozenset(f"#{text}".rstrip() for text in lines if text)
    return frozenset(one.text for one in found if one.text)


def with_comments(written: bytes, formers: Sequence[bytes], without: Collection[str]) -> bytes:
    """Return a file with the comments of former ones.

    Args:
        written: the file, without comments but those at its beginning.
        formers: files that it takes the place of; a comment of several of them is written once.
        without: texts of comments to leave out.
    """
    said, text = {*without}, written.decode()
    lines = text.split("\n")
    line_of = {place.path: text.count("\n", 0, place.start) for place in places_in(text)}
    above: dict[int, list[str]] = {}
    beside: dict[int, str] = {}
    for number, former in enumerate(formers):
        try:
            places, found = _read(former)
        except (ParseError, UnicodeError):
            continue
        target = _targets(places, line_of, len(lines) - 1)
        for one in found:
            if one.text in said or (number and not one.text):
                continue
            at = target[one.place]
            if one.is_beside and places[one.place].path in line_of and at not in beside:
                beside[at] = one.text
            else:
                above.setdefault(at, []).append(one.text)
        said |= {one.text for one in found if one.text}
    return "\n".join(_joined(lines, above, beside)).encode()


def _targets(places: Sequence[Place], line_of: Mapping[tuple[str | int, ...], int], end: int) -> list[int]:
    """Return the line of each place, or of the next one that is left; the last one is the end of the file."""
    found = [end]
    for place in reversed(places):
        found.append(line_of.get(place.path, found[-1]))
    return found[::-1]


def _joined(
    lines: Sequence[str], above: Mapping[int, Sequence[str]], beside: Mapping[int, str]
) -> Iterator[str]:
    for number, line in enumerate(lines):
        indent = line[: len(line) - len(line.lstrip())]
        yield from (f"{indent}{text}".rstrip() for text in above.get(number, ()))
        yield f"{line}  {beside[number]}" if number in beside else line


def _read(data: bytes) -> tuple[Sequence[Place], list[_Comment]]:
    """Return the places of a file but the document itself, and its comments.

    Raises:
        ParseError: it is not YAML.
    """
    text = _BREAK.sub("\n", data.decode())
    load_yaml(text, source="")
    places = places_in(text)
    masked, starts, found = _masked(text, places), [place.start for place in places], []
    for match in _COMMENT.finditer(masked):
        start = match.start()
        if start == len(masked):
            continue
        line = masked.rfind("\n", 0, start) + 1
        here, following = bisect_left(starts, line), bisect_left(starts, start)
        is_beside = here < following
        # Behind a bracket that ends a list, it is of what the list is of.
        is_own = not masked[line:start].strip()
        place = here if is_beside else following if is_own else following - 1
        found.append(_Comment(match[0].strip(), place, is_beside))
    return places, found


def _masked(text: str, places: Sequence[Place]) -> str:
    """Return a text in which no scalar has a #, a blank or an end of line."""
    parts, at = [], 0
    for start, end in (span for place in places for span in place.texts):
        # A comment may stand in the first line of a block.
        begin = text.index("\n", start) + 1 if text[start : start + 1] in {"|", ">"} else start
        last = begin + len(text[begin:end].rstrip())
        parts += [text[at:begin], "x" * (last - begin)]
        at = last
    return "".join([*parts, text[at:]])
