"""Cleaning of camera names and serial numbers."""

from __future__ import annotations

__all__ = ["MAX_TEXT", "clean_serial", "clean_text"]

MAX_TEXT = 200
"""Most characters of a name; longer than any known make, model or firmware name (a Parrot release has 60)."""


def clean_text(raw: str | bytes) -> str | None:
    """A name without padding and unprintable characters; None if nothing is left."""
    text = raw if isinstance(raw, str) else _decode(raw)
    words = " ".join(text.partition("\0")[0].split())
    if not words.isprintable():
        words = "".join(filter(str.isprintable, words))
    return words[:MAX_TEXT].strip() or None


def clean_serial(raw: str | bytes | None) -> str | None:
    """A serial number; None for values that mean none: "", "0", "000000"."""
    text = clean_text(raw) if raw is not None else None
    if text is None or not any(character.isalnum() and character != "0" for character in text):
        return None
    return text


def _decode(raw: bytes) -> str:
    raw = raw.partition(b"\0")[0]
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")
