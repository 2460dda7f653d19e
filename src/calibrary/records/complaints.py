"""Schema violations of a document, as messages for its author.

Two types are stricter than in the standard: a *number* is finite (NaN would pass every bound, because all
comparisons with it are false), and an *integer* has no decimal point (the standard accepts ``5472.0``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from calibrary.errors import ParseError
from calibrary.records import Locate

if TYPE_CHECKING:
    from jsonschema import TypeChecker
    from jsonschema.exceptions import ValidationError
    from jsonschema.protocols import Validator

Path: TypeAlias = tuple[str | int, ...]
Complaint: TypeAlias = tuple[Path, str]

KINDS: Final = {
    "string": "text",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "array": "a list",
    "object": "a map",
    "null": "null",
}
LONGEST_SHOWN: Final = 60


def validator(
    schema: Mapping[str, Any],
    resources: Mapping[str, Mapping[str, Any]] | None = None,
) -> Validator:
    """Prepare a schema for repeated checks; preparing takes thirty times as long as checking one document.

    Args:
        schema: JSON Schema 2020-12.
        resources: other schemas that it refers to, by ``$id``; nothing is loaded from the network.
    """
    # Loading takes 80 ms, so it is done only to check a document.
    from jsonschema import Draft202012Validator, validators  # noqa: PLC0415  the reason above
    from referencing import Registry, Resource  # noqa: PLC0415  the reason above

    def is_number(_: TypeChecker, value: object) -> bool:
        return type(value) is int or (type(value) is float and math.isfinite(value))

    def is_integer(_: TypeChecker, value: object) -> bool:
        return type(value) is int

    types = Draft202012Validator.TYPE_CHECKER.redefine_many({"number": is_number, "integer": is_integer})
    # The stubs leave the arguments of extend untyped.
    strict = validators.extend(Draft202012Validator, type_checker=types)  # type: ignore[no-untyped-call]
    ours = Registry().with_resources(
        (name, Resource.from_contents(known)) for name, known in (resources or {}).items()
    )
    prepared: Validator = strict(schema, registry=ours)
    return prepared


def check(value: Any, prepared: Validator, *, source: str | None, locate: Locate | None = None) -> None:
    """Refuse a value that violates a schema.

    Raises:
        ParseError: the first violation, its place in the document, and the number of further violations.
    """
    said = complaints(prepared.iter_errors(value))
    if not said:
        return
    path, message = said[0]
    if len(said) > 1:
        message += f" (and {len(said) - 1} more to put right)"
    raise ParseError(message, source=source, place=place_of(path, locate))


def place_of(path: Sequence[str | int], locate: Locate | None = None) -> str | None:
    """A path as text, after its line number if known: ``line 7, cameras[3].pitch_um``."""
    line = locate(path) if locate is not None else None
    dotted = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path).removeprefix(".")
    return ", ".join([*([f"line {line}"] if line is not None else []), *([dotted] if dotted else [])]) or None


def complaints(errors: Iterable[ValidationError]) -> list[Complaint]:
    """(path, message) of every violation, in the order of the paths, without duplicates."""
    said = dict.fromkeys(_complaint(error) for one in errors for error in _best_alternative(one))
    return sorted(said, key=lambda complaint: [str(step).rjust(12) for step in complaint[0]])


def _best_alternative(error: ValidationError) -> Iterator[ValidationError]:
    """The errors of the alternative (anyOf, oneOf) that the value matches best; otherwise the error itself."""
    if error.validator not in {"anyOf", "oneOf"} or not error.context:
        yield error
        return
    closest = max(error.context, key=_depth).relative_schema_path[0]
    for inner in error.context:
        if inner.relative_schema_path[0] == closest:
            yield from _best_alternative(inner)


def _complaint(error: ValidationError) -> Complaint:
    say = _SAYINGS.get(str(error.validator))
    message = say(error.instance, error.validator_value, error.schema) if say else _shorten(error.message)
    return tuple(error.absolute_path), message


def _depth(error: ValidationError) -> int:
    """Depth at which a value violates an alternative; the alternative violated deepest matches best."""
    return len(error.absolute_path)


def _type(found: object, wanted: object, _: object) -> str:
    kinds = [wanted] if isinstance(wanted, str) else _list(wanted)
    text = f"{_value_text(found)}, expected {_either(KINDS.get(str(kind), str(kind)) for kind in kinds)}"
    if kinds[0] == "string" and not isinstance(found, dict | list):
        text += ": quote it"
    return text


def _required(found: object, wanted: object, _: object) -> str:
    missing = [name for name in _list(wanted) if name not in _mapping(found)]
    return f"lacks {', '.join(map(str, missing))}"


def _additional(found: object, _: object, schema: object) -> str:
    known = list(_mapping(_mapping(schema).get("properties", {})))
    others = _mapping(_mapping(schema).get("patternProperties", {}))
    extra = [
        name
        for name in _mapping(found)
        if name not in known and not any(re.search(pattern, name) for pattern in others)
    ]
    name = extra[0] if extra else "?"
    close = get_close_matches(name, known, n=1)
    wanted = f"did you mean {close[0]}?" if close else f"expected {_either(known)}"
    return f"{_value_text(name)} is not a valid key, {wanted}"


def _enum(found: object, wanted: object, _: object) -> str:
    return f"{_value_text(found)}, expected {_either(map(_value_text, _list(wanted)))}"


def _const(found: object, wanted: object, _: object) -> str:
    return f"{_value_text(found)}, expected {_value_text(wanted)}"


def _pattern(found: object, wanted: object, _: object) -> str:
    return f"{_value_text(found)}, expected text that matches {wanted}"


def _unique(found: object, *_: object) -> str:
    return f"{_value_text(found)}, expected no two items alike"


def _bound(words: str) -> Callable[[object, object, object], str]:
    return lambda found, wanted, _: f"{_value_text(found)}, expected {words.format(wanted)}"


_SAYINGS: Final[Mapping[str, Callable[[Any, Any, Any], str]]] = {
    "type": _type,
    "required": _required,
    "additionalProperties": _additional,
    "unevaluatedProperties": _additional,
    "enum": _enum,
    "const": _const,
    "pattern": _pattern,
    "uniqueItems": _unique,
    "minimum": _bound("at least {}"),
    "maximum": _bound("at most {}"),
    "exclusiveMinimum": _bound("more than {}"),
    "exclusiveMaximum": _bound("less than {}"),
    "minLength": _bound("at least {} characters"),
    "maxLength": _bound("at most {} characters"),
    "minItems": _bound("at least {} items"),
    "maxItems": _bound("at most {} items"),
    "minProperties": _bound("at least {} keys"),
}


def _list(value: object) -> Sequence[object]:
    return value if isinstance(value, list) else []


def _mapping(value: object) -> Mapping[str, object]:
    return value if isinstance(value, dict) else {}


def _either(choices: Iterable[str]) -> str:
    *first, last = list(choices) or ["nothing"]
    return f"{', '.join(first)} or {last}" if first else last


def _value_text(value: object) -> str:
    if isinstance(value, dict):
        return "a map"
    if isinstance(value, list) and len(value) > 4:
        return f"a list of {len(value)}"
    spelled = {None: "null", True: "true", False: "false"}
    if value is None or isinstance(value, bool):
        return spelled[value]
    return _shorten(ascii(value) if isinstance(value, str) and not value.isprintable() else repr(value))


def _shorten(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 1] + "…"
