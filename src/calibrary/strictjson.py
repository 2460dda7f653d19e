"""Strict reading of JSON: rejects everything that two readers could understand differently."""

from __future__ import annotations

import json
from typing import NoReturn

from calibrary.errors import ParseError
from calibrary.records import Json


def parse_json(data: bytes, *, source: str) -> Json:
    """Parse a JSON document into plain values.

    Raises:
        ParseError: the bytes are not JSON, an object has a duplicate key, a number is not finite, or the nesting is
            too deep.
    """
    try:
        text = data.decode(json.detect_encoding(data))
        document: Json = json.loads(text, object_pairs_hook=_unique_keys, parse_constant=_not_finite)
    except json.JSONDecodeError as error:
        raise ParseError(
            f"this is not JSON: {error.msg}", source=source, place=f"line {error.lineno}"
        ) from None
    except RecursionError:
        raise ParseError("the JSON is nested too deeply", source=source) from None
    except UnicodeDecodeError as error:
        raise ParseError(
            f"this is not {error.encoding.upper()} text: {error.reason}", source=source
        ) from None
    except ValueError as error:
        raise ParseError(f"this JSON cannot be read: {error}", source=source) from None
    return document


def _unique_keys(pairs: list[tuple[str, Json]]) -> dict[str, Json]:
    table = dict(pairs)
    if len(table) != len(pairs):
        seen: set[str] = set()
        for key, _ in pairs:
            if key in seen:
                raise ValueError(f"{key!a:.40} is a duplicate key in one object")
            seen.add(key)
    return table


def _not_finite(name: str) -> NoReturn:
    raise ValueError(f"{name} is not finite, expected a number")
