"""Text of a format whose files are short, so that a long one is refused before anything is made of it."""

from __future__ import annotations

from calibrary.errors import ParseError
from calibrary.parsers import text as strict

__all__ = ["short_text"]


def short_text(data: bytes, *, source: str, max_bytes: int) -> str:
    """The decoded text.

    Raises:
        ParseError: it is longer than a file of the format can be, or no text.
    """
    if len(data) > max_bytes:
        raise ParseError(
            f"{len(data)} bytes are too many for this format, at most {max_bytes}", source=source
        )
    return strict.decode(data, source=source)
