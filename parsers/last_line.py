"""Text files without a newline at the end: check whether a number that is used may be truncated.

Some editors and programs omit the last newline, and an incomplete copy lacks it too. To distinguish them, the
last number is extended: if another ending (3650.1 → 3650.11, 3650.1e1) does not change the result, the number
is not used and the file is accepted; if it does, the number may lack digits and the file is refused.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator, Sequence

from calibrary.calibration import Calibration
from calibrary.errors import InputError, MissingTagError, ParseError
from calibrary.parsers.format import Read, ReadContext
from calibrary.parsers.text import shown
from calibrary.records import replace

__all__ = ["read_to_the_end"]

NOT_ENDED = "the last line is not ended, so the file may be cut short; complete it, or end it with a newline"

_CLOSED = tuple("]})>\"';")
"""Characters after which no number can continue."""
_LAST_WORD = re.compile(r"[^\s,;:=]*\s*\Z")
_DIGIT = re.compile(r"\d")
_ZERO = re.compile(r"[+-]?0")
_WHOLE = re.compile(r"\d[eE][+-]0\d\Z")
"""An exponent padded to two digits, which has no third digit if it begins with 0."""
_ANOTHER = " 1"
_EXPONENT = re.compile(r"[\d.][eE][+-]?\d*\Z")
_TAIL_BYTES = 2000
_UTF_16 = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}


def read_to_the_end(read: Read, data: bytes, context: ReadContext) -> Sequence[Calibration]:
    """Run a reader on a text, which is passed with a newline at its end.

    Extras that may be truncated are omitted, with a note.

    Args:
        read: the reader.
        data: content of a text file.
        context: of the file.

    Raises:
        ParseError: the last line has no newline, and its last word is used.
        InputError: raised by the reader.
    """
    encoding = _UTF_16.get(data[:2], "utf-8")
    tail = data[-_TAIL_BYTES:].decode(encoding, "replace")
    if tail.endswith(("\n", "\r")):
        return read(data, context)
    newline = "\n".encode(encoding)
    if tail.rstrip().endswith(_CLOSED):
        return read(data + newline, context)
    try:
        found = read(data + newline, context)
    except MissingTagError:
        raise
    except InputError as error:
        if _fails_without_its_last_line(read, data, context, newline, error):
            raise
        raise ParseError(f"{error.message}; {NOT_ENDED}", source=error.source, place=error.place) from None
    match = _LAST_WORD.search(tail)
    word = match[0].strip() if match else ""
    if word and not _DIGIT.search(word):
        return found
    for ending in _endings(word):
        try:
            other = read(data + ending.encode(encoding) + newline, context)
        except InputError:
            # No further number can follow a complete one.
            other = found if ending == _ANOTHER else []
        if [_camera(item) for item in other] != [_camera(item) for item in found]:
            raise ParseError(f"{NOT_ENDED}: what it ends in, {shown(word)}, is used")
        found = [_common(item, changed) for item, changed in zip(found, other, strict=True)]
    return found


def _fails_without_its_last_line(
    read: Read, data: bytes, context: ReadContext, newline: bytes, error: InputError
) -> bool:
    """Whether the file without its last line has the same error, so that truncation is not the cause."""
    kept, found, _ = data.rpartition(newline)
    try:
        read(kept + newline if found else b"", context)
    except InputError as other:
        return (type(other), other.message, other.place) == (type(error), error.message, error.place)
    return False


def _endings(word: str) -> Iterator[str]:
    """Yield possible continuations: more digits, or an exponent if there is none; after an integer another number."""
    if _WHOLE.search(word):
        yield _ANOTHER
        return
    yield ".5" if _ZERO.fullmatch(word) else "1"
    if not _EXPONENT.search(word):
        yield "e1"


def _camera(item: Calibration) -> Calibration:
    return replace(item, notes=(), extras=())


def _common(item: Calibration, changed: Calibration) -> Calibration:
    """The calibration without the extras and notes that depend on the last word."""
    extras = tuple(pair for pair in item.extras if pair in changed.extras)
    notes = tuple(note for note in item.notes if note in changed.notes)
    lost = [name for name, _ in item.extras if name not in dict(extras)]
    if lost:
        notes += (f"{', '.join(lost)} is left out: the last line is not ended, so it may be cut short",)
    return replace(item, extras=extras, notes=notes)
