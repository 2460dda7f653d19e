"""Checks of bounds: those that a record declares, and narrower ones of a particular document.

Reading checks the declared bounds, a constructor does not. A record that could otherwise be constructed but
not read back calls :func:`require_declared` in its ``__post_init__``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, partial
from types import NoneType, UnionType
from typing import Annotated, Any, Final, TypeAlias, Union, get_args, get_origin, get_type_hints

from msgspec import Meta

from calibrary.errors import InputError
from calibrary.records import Record

__all__ = ["Limits", "narrow", "require_declared", "require_within"]

Limits: TypeAlias = Mapping[str, Meta]
"""Bounds by the dotted path of the value; they apply to each member of a list or map."""
Breach: TypeAlias = Callable[[Any], "tuple[object, Meta] | None"]
"""Function that returns the value out of bounds with its bounds, or None if there is no such value."""

KEYWORDS: Final = {
    "gt": "exclusiveMinimum",
    "ge": "minimum",
    "le": "maximum",
    "min_length": "minLength",
    "max_length": "maxLength",
    "pattern": "pattern",
}


def require_declared(record: Record) -> None:
    """Refuse a record with a value out of the bounds declared by its own fields; nested records check their own.

    Raises:
        InputError: the first such value, its field and the expected range.
    """
    for name, breach in _declared(type(record)):
        if (found := breach(getattr(record, name))) is not None:
            raise _out_of_bounds(name, *found)


def require_within(record: Record, limits: Limits) -> None:
    """Refuse a record with a value, at any depth, out of the given bounds.

    Raises:
        InputError: the first such value, its path and the expected range.
    """
    for path, bounds in limits.items():
        value: object = record
        for step in path.split("."):
            value = getattr(value, step, None)
        for one in _members(value):
            if not _holds(one, bounds):
                raise _out_of_bounds(path, one, bounds)


def _out_of_bounds(path: str, value: object, bounds: Meta) -> InputError:
    # jsonschema takes 80 ms to load and is needed only for a wrong value.
    from calibrary.records.complaints import complaints, validator  # noqa: PLC0415  the reason above

    plain: Any = list(value) if isinstance(value, tuple) else value
    said = [text for _, text in complaints(validator(_keywords(bounds)).iter_errors(plain))]
    return InputError(said[0] if said else f"{value}, expected a finite number", place=path)


@cache
def _declared(kind: type[Record]) -> tuple[tuple[str, Breach], ...]:
    """The fields of a record that declare bounds, each with its check."""
    hints = get_type_hints(kind, include_extras=True)
    found = ((name, _breach_of(hints[name])) for name in kind.__struct_fields__)
    return tuple((name, breach) for name, breach in found if breach is not None)


def _breach_of(hint: Any) -> Breach | None:
    """Make the check of a type's bounds; None if the type declares none."""
    # The bounds of the value, then those of its members, then those of theirs.
    levels: list[list[Meta]] = [[]]
    while (origin := get_origin(hint)) is not None:
        parts = get_args(hint)
        if origin is Annotated:
            levels[-1] += [part for part in parts[1:] if isinstance(part, Meta)]
            hint = parts[0]
        elif origin in {Union, UnionType}:
            others = [part for part in parts if part is not NoneType]
            hint = others[0] if len(others) == 1 else None
        elif origin in {tuple, Mapping}:
            levels.append([])
            hint = parts[0] if origin is tuple else parts[1]
        else:
            break
    return partial(_first_breach, levels) if any(levels) else None


def _first_breach(levels: Sequence[Sequence[Meta]], value: object) -> tuple[object, Meta] | None:
    values: Iterable[object] = (value,)
    for at, level in enumerate(levels):
        if at:
            values = [member for one in values if one is not None for member in _members(one)]
        for one in values:
            for bounds in level if one is not None else ():
                if not _holds(one, bounds):
                    return one, bounds
    return None


def narrow(schema: dict[str, Any], defs: Mapping[str, Any], limits: Limits) -> None:
    """Write the bounds into a schema and into ``defs``, the schemas that it refers to."""
    for path, bounds in limits.items():
        at = schema
        for step in path.split("."):
            at = _resolved(at, defs)["properties"][step]
        said = _keywords(bounds)
        if "prefixItems" in at:
            at["prefixItems"] = [item | said for item in at["prefixItems"]]
        elif isinstance(at.get("additionalProperties"), dict):
            at["additionalProperties"] = at["additionalProperties"] | said
        else:
            at.update(said)


def _resolved(schema: dict[str, Any], defs: Mapping[str, Any]) -> dict[str, Any]:
    """The object schema that a reference, or a reference or null, resolves to."""
    reference = next((one["$ref"] for one in [schema, *schema.get("anyOf", [])] if "$ref" in one), None)
    found: dict[str, Any] = defs[reference.rpartition("/")[2]] if reference is not None else schema
    return found


def _keywords(bounds: Meta) -> dict[str, Any]:
    """The bounds as JSON Schema keywords."""
    return {word: value for name, word in KEYWORDS.items() if (value := getattr(bounds, name)) is not None}


def _members(value: object) -> Iterable[object]:
    if isinstance(value, Mapping):
        return value.values()
    return value if isinstance(value, tuple) else (value,)


def _holds(value: object, bounds: Meta) -> bool:
    if isinstance(value, tuple):
        return len(value) >= (bounds.min_length or 0)
    if isinstance(value, str):
        fits = (bounds.min_length or 0) <= len(value) <= (bounds.max_length or len(value))
        return fits and (bounds.pattern is None or re.search(bounds.pattern, value) is not None)
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (
            math.isfinite(value)
            and (bounds.gt is None or value > bounds.gt)
            and (bounds.ge is None or value >= bounds.ge)
            and (bounds.le is None or value <= bounds.le)
        )
    return True
