"""Parsing of numbers in files: ASCII digits, finite, without the extra forms that Python's float() accepts."""

from __future__ import annotations

import math

__all__ = ["as_float"]


def as_float(text: str) -> float | None:
    """The number; None for full-width digits, underscores, "nan", "infinity" and any other text."""
    if not text.isascii() or "_" in text:
        return None
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
