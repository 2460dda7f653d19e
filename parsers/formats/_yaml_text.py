"""YAML written so that every reader takes the same numbers out of it.

YAML 1.1, which PyYAML and with it most Python programs follow, takes ``1e-05`` for text: a number needs its
point and its exponent's sign.
"""

from __future__ import annotations

import json
from collections.abc import Iterable

from calibrary.records import Json

__all__ = ["decimal", "flow", "scalar"]


def decimal(value: float) -> str:
    """A number that reads back the same, as YAML 1.1 and 1.2 both write it."""
    digits, mark, exponent = repr(value).partition("e")
    return digits + ("" if "." in digits or not mark else ".0") + mark + exponent


def flow(values: Iterable[float]) -> str:
    """A list of numbers in brackets, so that a file cut short inside it is not YAML."""
    return "[" + ", ".join(decimal(value) for value in values) + "]"


def scalar(value: Json) -> str:
    """Any value on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{scalar(key)}: {scalar(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(scalar(item) for item in value) + "]"
    if isinstance(value, float):
        return decimal(value)
    # YAML takes no character that does not print, and takes JSON's pairs of \u for two characters.
    text = json.dumps(value, ensure_ascii=False)
    return "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in text)
