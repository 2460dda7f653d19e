"""Writing of YAML that all readers interpret equally.

YAML 1.1, which PyYAML and most Python programs use, takes ``1e-05`` as text: a number needs a decimal point
and a sign of the exponent.
"""

from __future__ import annotations

import json
from collections.abc import Iterable

from calibrary.records import Json


def decimal(value: float) -> str:
    """A number with all digits, valid in YAML 1.1 and 1.2."""
    digits, mark, exponent = repr(value).partition("e")
    return digits + ("" if "." in digits or not mark else ".0") + mark + exponent


def flow(values: Iterable[float]) -> str:
    """A list of numbers in brackets, so that a file truncated inside it is not valid YAML."""
    return "[" + ", ".join(decimal(value) for value in values) + "]"


def scalar(value: Json) -> str:
    """Any value on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{scalar(key)}: {scalar(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(scalar(item) for item in value) + "]"
    if isinstance(value, float):
        return decimal(value)
    # YAML accepts no unprintable characters, and reads JSON's \u pairs as two characters.
    text = json.dumps(value, ensure_ascii=False)
    return "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in text)
