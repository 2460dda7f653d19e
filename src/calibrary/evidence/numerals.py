"""Numbers as files write them: ASCII digits, a point, an exponent, and nothing that only Python takes for one."""

from __future__ import annotations

import re

__all__ = ["as_float"]

NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


def as_float(text: str) -> float | None:
    """The number, None for full-width digits, underscores, "nan", "infinity" and every other word."""
    return float(text) if NUMBER.fullmatch(text) else None
