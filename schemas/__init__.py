"""JSON Schemas of every document calibrary reads or prints, and the checking of values against them.

A schema is a file ``<name>.schema.json`` of this package, JSON Schema 2020-12, whose ``$id`` is
``urn:calibrary:schema:<name>``. Schemas may refer to one another by that id; nothing is ever fetched.

Two words are read more strictly here than the standard asks: a *number* is finite (NaN passes every bound,
for all comparisons with it are false), and an *integer* is written as one (the standard takes ``5472.0``).
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, TypeAlias

from calibrary.errors import ParseError
from calibrary.schemas.complaints import complaints

if TYPE_CHECKING:
    from jsonschema.protocols import Validator

__all__ = ["load", "names", "require", "validator"]

Json: TypeAlias = "str | int | float | bool | Mapping[str, Json] | Sequence[Json] | None"
Schema: TypeAlias = Mapping[str, Json]
Locate: TypeAlias = Callable[[Sequence[str | int]], int | None]

SUFFIX = ".schema.json"


def names() -> tuple[str, ...]:
    """The names of all schemas, sorted."""
    found = (item.name for item in files(__package__).iterdir())
    return tuple(sorted(name.removesuffix(SUFFIX) for name in found if name.endswith(SUFFIX)))


@cache
def load(name: str) -> Schema:
    """One schema as its file says it.

    Args:
        name: such as "catalogue-1".
    """
    schema: Schema = json.loads((files(__package__) / f"{name}{SUFFIX}").read_text(encoding="utf-8"))
    return schema


@cache
def validator(name: str) -> Validator:
    """A schema made ready once: preparing costs thirty times what checking one document does."""
    # 80 ms that only a document to be checked is worth.
    from jsonschema import Draft202012Validator, TypeChecker, validators  # noqa: PLC0415  the reason above
    from referencing import Registry, Resource  # noqa: PLC0415  the reason above

    from calibrary.schemas.quick import QuickKeywords  # noqa: PLC0415  the reason above

    def is_number(_: TypeChecker, value: object) -> bool:
        return type(value) is int or (type(value) is float and math.isfinite(value))

    def is_integer(_: TypeChecker, value: object) -> bool:
        return type(value) is int

    types = Draft202012Validator.TYPE_CHECKER.redefine_many({"number": is_number, "integer": is_integer})
    # The stubs leave the arguments of extend untyped.
    quick = QuickKeywords(Draft202012Validator.VALIDATORS)
    strict = validators.extend(Draft202012Validator, quick.by_name, type_checker=types)  # type: ignore[no-untyped-call]
    ours = Registry().with_resources(
        (f"urn:calibrary:schema:{n}", Resource.from_contents(load(n))) for n in names()
    )
    prepared: Validator = strict(load(name), registry=ours)
    return prepared


def require(value: Json, name: str, *, source: str | None = None, locate: Locate | None = None) -> None:
    """Refuse a value that breaks a schema, with everything that is wrong with it.

    Args:
        value: what was read: dicts, lists and scalars.
        name: of the schema.
        source: what the error calls the document, usually the file's name.
        locate: from the path of a value to its line, such as ``partial(strictyaml.line_of, data)``.

    Raises:
        ParseError: the first breach, its place in the document, and how many more there are.
    """
    prepared = validator(name)
    if prepared.is_valid(value):
        return
    said = complaints(prepared.iter_errors(value))
    path, message = said[0]
    if len(said) > 1:
        message += f" (and {len(said) - 1} more to put right)"
    line = locate(path) if locate is not None else None
    places = (f"line {line}" if line is not None else None, _dotted(path))
    raise ParseError(message, source=source, place=", ".join(place for place in places if place) or None)


def _dotted(path: Sequence[str | int]) -> str:
    """A path as people write it: ``cameras[3].pitch_um``."""
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return text.removeprefix(".")
