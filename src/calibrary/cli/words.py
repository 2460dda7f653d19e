"""What is printed: text as it is, or with a style."""

from __future__ import annotations

from typing import TypeAlias

Words: TypeAlias = str | tuple[str, str]
"""Text, or text and its style: no part of it is markup, and control characters are spelt out."""


def printable(text: str) -> str:
    """Text from a file or tag without control characters, which a terminal would interpret."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)
