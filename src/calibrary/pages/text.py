"""Text from files and tags, made safe to display: invisible characters are spelt out and the length is limited."""

from __future__ import annotations

import unicodedata

__all__ = ["LONGEST", "visible"]

LONGEST = 4_000
"""Most characters of one piece of text on a page."""

MOST_MARKS = 4
"""Most combining accents on one letter; more would cover adjacent lines."""


def visible(text: str, most: int = LONGEST) -> str:
    """The text with control, direction and other unprintable characters spelt out, cut to ``most`` characters.

    The template escapes HTML. Direction overrides would show a name backwards, and a lone surrogate (a byte of a file
    name that is not UTF-8) cannot be encoded at all.
    """
    if len(text) <= most and text.isascii() and text.isprintable():
        # Fast path: nearly all of the thousand texts of a page are plain.
        return text
    cut = len(text) > most
    shown: list[str] = []
    marks = 0
    for c in text[:most]:
        marks = marks + 1 if unicodedata.combining(c) else 0
        if marks > MOST_MARKS:
            continue
        if c.isprintable():
            shown.append(c)
        elif c.isspace():
            shown.append(" ")
        else:
            shown.append(f"\\x{ord(c):02x}" if ord(c) < 0x100 else f"\\u{ord(c):04x}")
    return "".join(shown) + (f"… ({len(text)} characters)" if cut else "")
