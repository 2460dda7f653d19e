"""Reading and writing of JSON for formats of reconstructions, with limited size, and extras as JSON text."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TypeAlias

from calibrary.errors import InputError, ParseError
from calibrary.parsers.content import MAX_JSON_BYTES
from calibrary.parsers.document import Node, accounted, load_json
from calibrary.parsers.format import ReadContext
from calibrary.records import Json

Writable: TypeAlias = "bool | int | float | str | Sequence[Writable] | Mapping[str, Writable] | None"

LONGEST_EXTRA = 4096
"""Most characters of an extra; a longer value belongs to the reconstruction, not to a camera."""


@accounted
def loaded(data: bytes, context: ReadContext) -> Node:
    """Load a document that is short enough to be read in two seconds, or within the caller's raised limit.

    Raises:
        ParseError: it is longer, or not JSON.
    """
    most = context.at_most(MAX_JSON_BYTES)
    if len(data) > most:
        raise ParseError(
            f"{len(data)} bytes of JSON; at most {most} are read: raise --max-size-mib, or save its cameras to a file "
            "of their own",
            source=context.name,
        )
    if context.json is not None:
        return Node(context.json, source=context.name)
    return load_json(data, source=context.name)


def dumped(document: Writable) -> bytes:
    """Encode a document with indentation and all digits of its numbers.

    Raises:
        InputError: a number became infinite by the format's units.
    """
    try:
        return (json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()
    except ValueError:
        raise InputError("a number of this camera exceeds what the format's units can state") from None


def extra(value: Json) -> str | None:
    """An unknown value as JSON text, so that it can be written back unchanged; None if it is too long."""
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= LONGEST_EXTRA else None


def restored(text: str) -> Json:
    """The value of an extra; text that is not JSON (from elsewhere) is returned unchanged."""
    try:
        value: Json = json.loads(text)
    except ValueError:
        return text
    return value
