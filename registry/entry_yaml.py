"""Writing and strict reading of an entry's file; the digest is checked.

YAML 1.1, YAML 1.2 and calibrary's own reader understand the text as the same data. Strings are always in double
quotes, so that none is read as a number, a date or a boolean. Floats are the shortest text of the same double, with a
decimal point and a sign in the exponent, without which ``1e-05`` is a string in YAML 1.1.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final, TypeAlias, cast

from msgspec import Struct

from calibrary.errors import InputError, ParseError, RegistryError
from calibrary.records import Json, from_json, to_json
from calibrary.registry.entry import Entry, digest, migrated
from calibrary.strictjson import parse_json
from calibrary.strictyaml import Place, YamlScalar, YamlValue, line_of, load_yaml, places_in

LARGEST_ENTRY: Final = 256 << 10
"""Bytes; an entry has about 2000."""
ENTRY_MARK: Final = re.compile(rb"^schema:[ ]*\"?calibrary/entry-\d", re.MULTILINE)
FORMER_STATUS: Final = re.compile(rb"^(?:status|reason):[^\n]*\n", re.MULTILINE)
DEEPEST: Final = 16
_ESCAPES = {"\\": "\\\\", '"': '\\"', "\n": "\\n", "\r": "\\r", "\t": "\\t", "\0": "\\0"}
_PLAIN_KEY = re.compile(r"x-[A-Za-z0-9_.-]*[A-Za-z0-9_]")
MAX_DEPTH = 12
UTF_16: Final = (BOM_UTF16_LE, BOM_UTF16_BE)

LEGEND: Final = """\
# One camera of a fleet registry, written by calibrary; schema: entry-1.
# K is fx fy cx cy skew in pixels of an image of image_size (width, height), x to the right, y down. The origin is the
# outer corner of the top-left pixel, so the middle is (width/2, height/2); for OpenCV take 0.5 off cx and cy.
# The distortion is no part of K; its model maps ideal to observed x/z, y/z. null: unknown; "none": known to be none.
# The digest seals the numbers. To change one, take the digest line out and run: calibrary registry add FILE
"""


class Layout(Struct, frozen=True, kw_only=True):
    """Exceptions to the rule of one value per line and no line for missing values.

    Attributes:
        nulls: dotted paths that are written even if null or empty.
        rows: lists of strings that are written on one line, like lists of numbers.
        triangles: lists of numbers that are the upper triangle of a matrix, written one row per line.
        quoted_keys: maps with keys that are always quoted.
    """

    nulls: frozenset[str] = frozenset()
    rows: frozenset[str] = frozenset()
    triangles: frozenset[str] = frozenset()
    quoted_keys: frozenset[str] = frozenset()


LAYOUT: Final = Layout(
    nulls=frozenset(
        {"distortion", "camera.firmware.min", "camera.firmware.max", "validity.from", "validity.until"}
    ),
    rows=frozenset({"quality.covariance.names", "tags"}),
    triangles=frozenset({"quality.covariance.upper"}),
    quoted_keys=frozenset({"extras"}),
)


def entry_yaml(entry: Entry, formers: Sequence[bytes] = ()) -> bytes:
    """Return the file of an entry; the bytes are deterministic and restore the entry exactly.

    Args:
        entry: the entry.
        formers: files that it takes the place of: comments of all of them and the order of the first one stay.

    Raises:
        InputError: a text contains a lone surrogate, a number is not finite, or an extension is nested too deeply.
    """
    found = _with_formers(entry, formers)
    return found if found is not None else _file(to_json(entry))


def _with_formers(entry: Entry, formers: Sequence[bytes]) -> bytes | None:
    """Return the file of an entry as :func:`entry_yaml` does; None if comments make it too large to be one."""
    document = to_json(entry)
    plain = _file(document)
    formers = [one for one in formers if one != plain]
    if not formers:
        return plain
    try:
        ordered = in_order_of(document, load_yaml(formers[0], source="", max_depth=DEEPEST))
    except InputError:
        ordered = document
    data = with_comments(_file(ordered), formers, LEGEND.splitlines())
    try:
        return data if parse_entry(data, "") == entry.as_draft else None
    except InputError:
        return None


def lost_comments(data: bytes, entry: Entry, formers: Sequence[bytes]) -> str | None:
    """Return a sentence about comments of former files that the file of an entry does not have; None if it has all."""
    lost = sorted(frozenset().union(*map(comments_in, formers)) - comments_in(data))
    if not lost:
        return None
    are = (
        f"{len(lost)} comments, of which the first is {lost[0]:.60}"
        if len(lost) > 1
        else f"the comment {lost[0]:.60}"
    )
    if _with_formers(entry, formers) is None:
        return f"its file cannot keep {are}: with them it would be larger than {LARGEST_ENTRY >> 10} KiB"
    return f"what is taken out of its file takes {are} with it"


def _file(document: Mapping[str, Json]) -> bytes:
    return (LEGEND + "\n".join(document_lines(document, LAYOUT)) + "\n").encode()


def entry_file(path: Path) -> bytes | None:
    """Return the content of a file if it is an entry, else None."""
    if path.stat().st_size > LARGEST_ENTRY:
        return None
    data = path.read_bytes()
    return data if ENTRY_MARK.search(data) else None


def parse_entry(data: bytes, name: str, *, require_digest: bool = True) -> Entry:
    """Read an entry; older schema versions are migrated.

    Args:
        data: content of the file; a published entry is the same document as JSON.
        name: name of the file in errors.
        require_digest: reject a file without a digest. An existing digest must match the numbers in any case.

    Raises:
        ParseError: the content is not unambiguous YAML, does not match schemas/entry-1.schema.json, has a newer schema
            version, or its numbers do not match the digest.
        InputError: its numbers are not those of a camera.
    """
    if data.startswith(UTF_16):
        raise ParseError("is UTF-16 text, which git treats as binary; expected UTF-8", source=name)
    if is_json := data.startswith(b"{"):
        if len(data) > LARGEST_ENTRY:
            raise ParseError(f"is {len(data)} bytes of JSON, expected at most {LARGEST_ENTRY}", source=name)
        value = parse_json(data, source=name)
    else:
        value = load_yaml(data, source=name, max_bytes=LARGEST_ENTRY, max_depth=DEEPEST)
    document = migrated(value, source=name)
    entry = from_json(Entry, document, source=name, locate=None if is_json else partial(line_of, data))
    stated = document.get("digest")
    if stated is None:
        if require_digest:
            raise ParseError(
                "has no digest over its numbers; 'calibrary registry add FILE' checks it and writes it with one",
                source=name,
                place="digest",
            )
        return entry
    found = digest(entry.calibration, entry.sensor, entry.rig)
    if stated != found:
        raise ParseError(
            f"the digest is {_short(str(stated))} and the numbers give {_short(found)}: K, distortion, sensor or "
            "uncertainty were changed by hand, or a merge put two calibrations together; take a version that is "
            "whole (git checkout REV -- FILE), or, if these numbers are meant, take the digest line out and run "
            "'calibrary registry add FILE'",
            source=name,
            place="digest",
        )
    return entry


def _short(text: str) -> str:
    return f"{text.removeprefix('sha256:')[:12]}…"


def quoted(text: str) -> str:
    """Return a string in double quotes, with unprintable characters escaped, so that they are visible in a diff.

    Raises:
        InputError: the string contains a lone surrogate, which is not a character.
    """
    if text.isascii() and text.isprintable() and '"' not in text and "\\" not in text:
        return f'"{text}"'
    return f'"{"".join(map(_escaped, text))}"'


def number(value: float) -> str:
    """Return a float as text that every reader converts to the same double.

    Raises:
        InputError: the value is NaN or infinite.
    """
    value = float(value)
    if not math.isfinite(value):
        raise InputError(f"{value} cannot be written, expected a finite number")
    text = repr(value)
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}.0e{exponent}" if e and "." not in mantissa else text


def scalar(value: YamlScalar) -> str:
    """Return a scalar of any kind as text."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return quoted(value)
    return str(value) if isinstance(value, int) else number(value)


def document_lines(
    document: Mapping[str, Json], layout: Layout, prefix: str = "", indent: str = ""
) -> Iterator[str]:
    """Yield the lines of a record's document in order; ``x-`` members are written unchanged.

    Raises:
        InputError: a text contains a lone surrogate, a number is not finite, or an ``x-`` member is nested too deeply.
    """
    for key, value in document.items():
        path = f"{prefix}{key}"
        if key.startswith("x-"):
            yield from block(key, value, indent)
            continue
        if value in (None, [], {}) and path not in layout.nulls:
            continue
        is_plain = key.isidentifier() and key.isascii() and prefix.removesuffix(".") not in layout.quoted_keys
        name = f"{indent}{key if is_plain else quoted(key)}"
        if isinstance(value, dict):
            inside = [*document_lines(value, layout, f"{path}.", f"{indent}  ")]
            yield from (f"{name}:", *inside) if inside else (f"{name}: {{}}",)
        elif not isinstance(value, list) or not value:
            yield f"{name}: {_small(value)}"
        elif path in layout.triangles:
            yield from (f"{name}: [", *_triangle(cast("list[float]", value), f"{indent}  "), f"{indent}]")
        elif path in layout.rows or not any(isinstance(item, str | dict) for item in value):
            yield f"{name}: [{', '.join(scalar(cast('YamlScalar', item)) for item in value)}]"
        else:
            yield f"{name}:"
            for item in value:
                lines = [*document_lines(item, layout, f"{path}.")] if isinstance(item, dict) else []
                first, *more = lines or [scalar(cast("YamlScalar", item))]
                yield f"{indent}  - {first}"
                yield from (f"{indent}    {line}" for line in more)


def _triangle(values: Sequence[float], indent: str) -> Iterator[str]:
    size, start = (math.isqrt(8 * len(values) + 1) - 1) // 2, 0
    for length in range(size, 0, -1):
        yield f"{indent}{', '.join(map(number, values[start : start + length]))},"
        start += length


def block(key: str, value: YamlValue, indent: str = "") -> list[str]:
    """Return the lines of ``key: value`` for any plain data.

    Raises:
        InputError: the data is nested too deeply, or contains a number that is not finite.
    """
    if len(indent) > 2 * MAX_DEPTH:
        raise InputError(f"{key!r:.60} is nested more than {MAX_DEPTH} deep")
    name = key if _PLAIN_KEY.fullmatch(key) else quoted(key)
    if isinstance(value, Mapping) and value:
        return [f"{indent}{name}:", *_members(value, f"{indent}  ")]
    if isinstance(value, list) and value:
        return [f"{indent}{name}:", *_items(value, f"{indent}  ")]
    return [f"{indent}{name}: {_small(value)}"]


def _members(value: Mapping[str, YamlValue], indent: str) -> Iterator[str]:
    for key, member in value.items():
        yield from block(key, member, indent)


def _items(value: Sequence[YamlValue], indent: str) -> Iterator[str]:
    for item in value:
        if isinstance(item, (dict, list)) and item:
            if len(indent) > 2 * MAX_DEPTH:
                raise InputError(f"a list is nested more than {MAX_DEPTH} deep")
            yield f"{indent}-"
            yield from (
                _members(item, f"{indent}  ") if isinstance(item, dict) else _items(item, f"{indent}  ")
            )
        else:
            yield f"{indent}- {_small(item)}"


def _small(value: YamlValue) -> str:
    """Return a scalar or an empty collection as text."""
    if isinstance(value, dict):
        return "{}"
    return "[]" if isinstance(value, list) else scalar(value)


def _escaped(character: str) -> str:
    if (escape := _ESCAPES.get(character)) is not None:
        return escape
    if character.isprintable():
        return character
    code = ord(character)
    if 0xD800 <= code < 0xE000:
        raise InputError(f"found the lone surrogate {character!a}, expected text")
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def without_status(data: bytes) -> bytes:
    """Return an entry's file of the former layout as it is in this one."""
    return FORMER_STATUS.sub(b"", data)


def parsed(data: bytes, path: str, *, require_digest: bool = True) -> Entry:
    """Return the entry in a registry's file.

    Raises:
        RegistryError: the file cannot be read; the message states where and why.
    """
    try:
        return parse_entry(data, path, require_digest=require_digest)
    except InputError as error:
        raise RegistryError(str(error)) from None


# Comments and the order of fields that people put into a file. A comment on a line of its own belongs to the field or
# item of a list that comes next; one at the end of a line, to the first of that line. If that field is gone, it moves
# to the next one that is left, or to the end; with an item of a list that is taken out, it goes. Blank lines are
# comments without a text. What turns the direction of a line is written escaped.

_COMMENT: Final = re.compile(r"^[ \t]*$|(?<!\S)#[^\n]*", re.MULTILINE)
Steps: TypeAlias = tuple[str | int, ...]
"""Keys and positions that lead to a value."""
TURNS: Final = re.compile("[\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")
"""Characters that turn the direction of a line, and are seen by nobody: Unicode's Bidi_Control."""
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
        _, _, found = _read(data)
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
    lines, document = text.split("\n"), load_yaml(text, source="", max_depth=DEEPEST)
    line_of = {place.path: text.count("\n", 0, place.start) for place in places_in(text)}
    above: dict[int, list[str]] = {}
    beside: dict[int, str] = {}
    for number, former in enumerate(formers):
        try:
            before, places, found = _read(former)
        except (ParseError, UnicodeError):
            continue
        moved = dict(_moved(before, document))
        target = _targets([moved.get(place.path, place.path) for place in places], line_of, len(lines) - 1)
        for one in found:
            at = target[one.place]
            if one.text in said or (number and not one.text) or at is None:
                continue
            if one.is_beside and moved.get(places[one.place].path) in line_of and at not in beside:
                beside[at] = one.text
            else:
                above.setdefault(at, []).append(one.text)
        said |= {one.text for one in found if one.text}
    return "\n".join(_joined(lines, above, beside)).encode()


def _moved(
    former: YamlValue, now: YamlValue, path: Steps = (), at: Steps | None = ()
) -> Iterator[tuple[Steps, Steps | None]]:
    """Yield the path of every value of a document with its path in another one; None for an item that is taken out."""
    yield path, at
    if isinstance(former, dict):
        for name, value in former.items():
            if at is None or (isinstance(now, dict) and name in now):
                inner = now[name] if isinstance(now, dict) and name in now else None
                yield from _moved(value, inner, (*path, name), (*at, name) if at is not None else None)
    elif isinstance(former, list):
        others = now if isinstance(now, list) else []
        for number, value in enumerate(former):
            place = _item(value, number, former, others) if at is not None else None
            inner = others[place] if place is not None else None
            yield from _moved(
                value, inner, (*path, number), (*(at or ()), place) if place is not None else None
            )


def _item(value: YamlValue, number: int, former: Sequence[YamlValue], now: Sequence[YamlValue]) -> int | None:
    """Return where an item of a list is now; where nothing is taken out, what differs has changed at its place."""
    if number < len(now) and (now[number] == value or (value not in now and len(now) >= len(former))):
        return number
    return now.index(value) if value in now else None


def _targets(paths: Sequence[Steps | None], line_of: Mapping[Steps, int], end: int) -> list[int | None]:
    """Return the line of each place, or of the next one that is left; None for one that is taken out with its comments.

    The last one is the end of the file.
    """
    found, following = list[int | None]([end]), end
    for path in reversed(paths):
        following = line_of.get(path, following) if path is not None else following
        found.append(following if path is not None else None)
    return found[::-1]


def _joined(
    lines: Sequence[str], above: Mapping[int, Sequence[str]], beside: Mapping[int, str]
) -> Iterator[str]:
    for number, line in enumerate(lines):
        indent = line[: len(line) - len(line.lstrip())]
        yield from (f"{indent}{text}".rstrip() for text in above.get(number, ()))
        yield f"{line}  {beside[number]}" if number in beside else line


def _read(data: bytes) -> tuple[YamlValue, Sequence[Place], list[_Comment]]:
    """Return the document of a file, the places in it, and its comments.

    Raises:
        ParseError: it is not YAML.
    """
    text = _BREAK.sub("\n", data.decode())
    document, places = load_yaml(text, source=""), places_in(text)
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
        seen = TURNS.sub(lambda turn: _escaped(turn[0]), match[0].strip())
        found.append(_Comment(seen, place, is_beside))
    return document, places, found


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
