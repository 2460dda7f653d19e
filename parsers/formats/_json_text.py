"""JSON in and out, for formats that keep a reconstruction's cameras in it: bounded, and extras as JSON text."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TypeAlias

from calibrary.errors import ParseError
from calibrary.parsers.content import MAX_JSON_BYTES
from calibrary.parsers.document import Node, load_json
from calibrary.parsers.format import ReadContext
from calibrary.records import Json

__all__ = ["Writable", "dumped", "extra", "loaded", "restored"]

Writable: TypeAlias = "bool | int | float | str | Sequence[Writable] | Mapping[str, Writable] | None"

LONGEST_EXTRA = 4096
"""In characters; a longer value is a reconstruction's and not a camera's."""


def loaded(data: bytes, context: ReadContext) -> Node:
    """A document that is read in two seconds, or one as long as the caller allows.

    Raises:
        ParseError: it is longer, or no JSON.
    """
    most = context.at_most(MAX_JSON_BYTES)
    if len(data) > most:
        raise ParseError(
            f"{len(data)} bytes of JSON; at most {most} are read: raise --max-size, or save its cameras to a file "
            "of their own",
            source=context.name,
        )
    if context.json is not None:
        return Node(context.json, source=context.name)
    return load_json(data, source=context.name)


def dumped(document: Writable) -> bytes:
    """A document for people to read, its numbers to the last bit."""
    return (json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def extra(value: Json) -> str | None:
    """What is not understood here, as JSON text that goes back as it came; None when it is too long."""
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= LONGEST_EXTRA else None


def restored(text: str) -> Json:
    """An extra's value; text that is not JSON (it comes from elsewhere) stands for itself."""
    try:
        value: Json = json.loads(text)
    except ValueError:
        return text
    return value
