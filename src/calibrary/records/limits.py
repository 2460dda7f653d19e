"""Bounds that a document asks of values inside it, beyond what the records it is made of ask everywhere."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, Final, TypeAlias

from msgspec import Meta

from calibrary.records import Json

__all__ = ["Limits", "first_breach", "narrow"]

Limits: TypeAlias = Mapping[str, Meta]
"""Bounds by the dotted path of the value; they hold for each member of a list or a map."""

KEYWORDS: Final = {
    "gt": "exclusiveMinimum",
    "ge": "minimum",
    "le": "maximum",
    "min_length": "minLength",
    "max_length": "maxLength",
    "pattern": "pattern",
}


def first_breach(document: Mapping[str, Json], limits: Limits) -> str | None:
    """The path of a value that is out of its bounds; None where all keep to them, or have another type."""
    for path, bounds in limits.items():
        value: Json = dict(document)
        for step in path.split("."):
            value = value.get(step) if isinstance(value, dict) else None
        if not all(_holds(one, bounds) for one in _members(value)):
            return path
    return None


def narrow(schema: dict[str, Any], defs: Mapping[str, Any], limits: Limits) -> None:
    """Write the bounds into a schema; ``defs`` are what it refers to, and are changed with it."""
    for path, bounds in limits.items():
        at = schema
        for step in path.split("."):
            at = _resolved(at, defs)["properties"][step]
        said = {
            word: value for name, word in KEYWORDS.items() if (value := getattr(bounds, name)) is not None
        }
        if "prefixItems" in at:
            at["prefixItems"] = [item | said for item in at["prefixItems"]]
        elif isinstance(at.get("additionalProperties"), dict):
            at["additionalProperties"] = at["additionalProperties"] | said
        else:
            at.update(said)


def _resolved(schema: dict[str, Any], defs: Mapping[str, Any]) -> dict[str, Any]:
    """The object schema behind a reference, or behind one that may be null."""
    reference = next((one["$ref"] for one in [schema, *schema.get("anyOf", [])] if "$ref" in one), None)
    found: dict[str, Any] = defs[reference.rpartition("/")[2]] if reference is not None else schema
    return found


def _members(value: Json) -> Iterator[Json]:
    if isinstance(value, dict):
        yield from value.values()
    elif isinstance(value, list):
        yield from value
    else:
        yield value


def _holds(value: Json, bounds: Meta) -> bool:
    if isinstance(value, str):
        fits = (bounds.min_length or 0) <= len(value) <= (bounds.max_length or len(value))
        return fits and (bounds.pattern is None or re.search(bounds.pattern, value) is not None)
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (
            (bounds.gt is None or value > bounds.gt)
            and (bounds.ge is None or value >= bounds.ge)
            and (bounds.le is None or value <= bounds.le)
        )
    return True
