"""Parsing of text and numbers in files; anything that is not clearly a number is an error."""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Sequence

from calibrary.arrays import FloatArray, np
from calibrary.calibration import ImageSize
from calibrary.errors import ParseError

LONGEST_SIDE_PX = 1_000_000
FINITE = "expected a number; a calibration that did not converge writes this: calibrate again"
LONGEST_NUMBER = 1000
"""Most characters of a number; the longest exact decimal of a double has 767 digits."""

_DECIMAL = r"[+-]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][+-]?\d++)?+"
_NUMBER = re.compile(_DECIMAL, re.ASCII)
_NUMBERS = re.compile(rf"\s*+(?:{_DECIMAL}(?:\s++|\Z))*+", re.ASCII)
_NOT_FINITE = re.compile(r"[+-]?\.?(?:nan|inf|infinity|1\.#\w+)(?:\(\w*\))?", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?", re.ASCII)
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


def decode(data: bytes, *, source: str | None = None, errors: str = "strict") -> str:
    """Decode the text of a file with undeclared encoding: UTF-16 with a byte order mark, UTF-8, else Latin-1.

    Numbers and keys are ASCII in every format, so only labels can be decoded wrongly; Latin-1 preserves all
    their bytes. Line ends are converted to LF.

    Raises:
        ParseError: the bytes are not text.
    """
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            try:
                text = data[len(mark) :].decode(encoding, errors)
            except UnicodeDecodeError as error:
                raise ParseError(
                    f"this is not {encoding.upper()} text: {error.reason}", source=source
                ) from None
            break
    else:
        try:
            text = data.decode("utf-8", errors)
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    if "\0" in text:
        raise ParseError("the file is binary, expected text", source=source)
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def refuse_longer(data: bytes, most: int, what: str, *, source: str | None = None) -> None:
    """Refuse a file that is longer than its kind is read; nothing is wrong with it.

    Args:
        data: the file.
        most: bytes.
        what: its kind, in words.
        source: file name, for messages.

    Raises:
        ParseError: it is longer.
    """
    if len(data) > most:
        size = f"{most // 2**20} MiB" if most >= 2**20 else f"{most // 2**10} KiB"
        raise ParseError(
            f"it is over {size}, the most that is read of {what}; copy what is of the camera to a file of its own",
            source=source,
        )


def lines(text: str) -> tuple[str, ...]:
    """The lines of a line-based format, without line ends."""
    return tuple(text.removesuffix("\n").split("\n"))


def number(text: str, *, source: str | None = None, place: str | None = None) -> float:
    """Parse one finite number.

    ``float`` alone would accept "1_000", "infinity" and "nan".

    Raises:
        ParseError: it is not a finite number; the message points out a decimal comma.
    """
    stripped = text.strip()
    if len(stripped) > LONGEST_NUMBER:
        raise ParseError(f"{shown(stripped)} is too long for a number", source=source, place=place)
    if _NUMBER.fullmatch(stripped):
        value = float(stripped)
        if math.isfinite(value):
            return value
    if _NOT_FINITE.fullmatch(stripped) or _NUMBER.fullmatch(stripped):
        raise ParseError(f"{shown(stripped)} is not finite, {FINITE}", source=source, place=place)
    hint = "; write a decimal point" if _DECIMAL_COMMA.fullmatch(stripped) else ""
    raise ParseError(f"{shown(stripped)} is not a number{hint}", source=source, place=place)


def numbers(
    text: str,
    *,
    count: int | Sequence[int] | None = None,
    source: str | None = None,
    place: str | None = None,
) -> tuple[float, ...]:
    """Parse numbers separated by white space, of the given count (or one of the given counts).

    Raises:
        ParseError: a word is not a number, or there are too many or too few.
    """
    parts = text.split()
    check_count(len(parts), count, source=source, place=place)
    values = plain_numbers(text, parts)
    if values is None:
        return tuple(number(part, source=source, place=place) for part in parts)
    return tuple(values)


def table(rows: Sequence[str], columns: int, *, first_line: int, source: str | None = None) -> FloatArray:
    """Parse lines with equal numbers of columns to (N, columns); as :func:`numbers` of each line, but faster.

    Args:
        rows: the lines.
        columns: count of numbers per line.
        first_line: line number of the first row in the file, from 1, for messages.
        source: file name, for messages.

    Raises:
        ParseError: a word is not a finite number, or a line has too many or too few.
    """
    text = "\n".join(rows)
    parts = text.split()
    values = plain_numbers(text, parts) if all(len(row.split()) == columns for row in rows) else None
    if values is None:
        values = [
            value
            for index, row in enumerate(rows, start=first_line)
            for value in numbers(row, count=columns, source=source, place=f"line {index}")
        ]
    return np.array(values).reshape(len(rows), columns)


def plain_numbers(text: str, parts: list[str]) -> list[float] | None:
    """All words of a text as numbers; None if one is not a number."""
    if not _NUMBERS.fullmatch(text) or max(map(len, parts), default=0) > LONGEST_NUMBER:
        return None
    values = list(map(float, parts))
    return values if all(map(math.isfinite, values)) else None


def check_count(
    found: int, wanted: int | Sequence[int] | None, *, source: str | None = None, place: str | None = None
) -> None:
    """Refuse a wrong count of numbers before they are parsed.

    Raises:
        ParseError: the count is not one of those wanted.
    """
    accepted = (wanted,) if isinstance(wanted, int) else wanted
    if accepted is not None and found not in accepted:
        sentence = " or ".join(str(item) for item in accepted)
        raise ParseError(f"{found} numbers, expected {sentence}", source=source, place=place)


def whole(text: str, *, source: str | None = None, place: str | None = None) -> int:
    """Parse an integer; also accepts "5472.0".

    Raises:
        ParseError: it has a fraction, or is not a number.
    """
    value = number(text, source=source, place=place)
    if value != int(value):
        raise ParseError(f"{shown(text)} has a fraction, expected a whole number", source=source, place=place)
    return int(value)


def image_size(
    width: float, height: float, *, source: str | None = None, place: str | None = None
) -> ImageSize:
    """(width, height) in px, after checking that both are integers, positive and not larger than an image can be.

    Raises:
        ParseError: they are not.
    """
    sides = (width, height)
    if not all(math.isfinite(side) and side == int(side) and 1 <= side <= LONGEST_SIDE_PX for side in sides):
        raise ParseError(
            f"the image size is {width:g}×{height:g}, expected whole pixels from 1 to {LONGEST_SIDE_PX}",
            source=source,
            place=place,
        )
    return int(width), int(height)


def shown(text: str, limit: int = 40) -> str:
    """Text from a file for a message: shortened, quoted, control characters escaped."""
    short = text if len(text) <= limit else text[:limit] + "…"
    return ascii(short) if not short.isprintable() else f"'{short}'"
