"""Who took an image: clean names, and serial numbers that never leave as they came."""

from __future__ import annotations

import hashlib

__all__ = ["MAX_TEXT", "SERIAL_HASH_DIGITS", "clean_serial", "clean_text", "hash_serial"]

MAX_TEXT = 200
"""Longer than any make, model or firmware name seen (a Parrot release string has 60 characters)."""

SERIAL_HASH_DIGITS = 16
"""64 bits: two of a million cameras share a hash with a chance of 3e-8."""


def clean_text(raw: str | bytes) -> str | None:
    """A name without padding and without what cannot be printed; None when nothing is left."""
    text = raw if isinstance(raw, str) else _decode(raw)
    words = " ".join(text.partition("\0")[0].split())
    if not words.isprintable():
        words = "".join(filter(str.isprintable, words))
    return words[:MAX_TEXT].strip() or None


def clean_serial(raw: str | bytes | None) -> str | None:
    """A serial number, or None for what cameras write when they have none: "", "0", "000000"."""
    text = clean_text(raw) if raw is not None else None
    if text is None or not any(character.isalnum() and character != "0" for character in text):
        return None
    return text


def hash_serial(make: str | None, serial: str) -> str:
    """What stands for a serial number wherever anything is written down.

    Two makers may number alike, so the maker is part of it. It keeps the number from readers of a registry;
    anyone who can list every serial number of a maker can still find it.
    """
    digest = hashlib.sha256(b"calibrary serial\0" + (make or "").encode() + b"\0" + serial.encode())
    return digest.hexdigest()[:SERIAL_HASH_DIGITS]


def _decode(raw: bytes) -> str:
    raw = raw.partition(b"\0")[0]
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")
