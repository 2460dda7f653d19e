"""Reading of short text files, as a whole or as lines."""

from __future__ import annotations

from calibrary.parsers import text as strict

MAX_BYTES = 1024 * 1024
"""Longest file; a thousand times the length of one camera."""


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
