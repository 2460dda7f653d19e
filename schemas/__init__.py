"""JSON Schemas of every document calibrary reads or prints, and the checking of values against them.

A schema is a file ``<name>.schema.json`` of this package, JSON Schema 2020-12, whose ``$id`` is its name after
``SCHEMA_BASE`` of :mod:`calibrary.records.schema`. Schemas refer to one another by that id; nothing is ever fetched.
Those of records are written by ``make schemas``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, TypeAlias

from calibrary.records import Locate

if TYPE_CHECKING:
    from jsonschema.protocols import Validator

__all__ = ["load", "names", "require", "served", "text", "validator"]

Json: TypeAlias = "str | int | float | bool | Mapping[str, Json] | Sequence[Json] | None"
Schema: TypeAlias = Mapping[str, Json]

SUFFIX = ".schema.json"


def names() -> tuple[str, ...]:
    """The names of all schemas, sorted."""
    found = (item.name for item in files(__package__).iterdir())
    return tuple(sorted(name.removesuffix(SUFFIX) for name in found if name.endswith(SUFFIX)))


def text(name: str) -> bytes:
    """The file of one schema.

    Args:
        name: such as "catalogue-1".
    """
    return (files(__package__) / f"{name}{SUFFIX}").read_bytes()


@cache
def load(name: str) -> Schema:
    """One schema as its file says it."""
    schema: Schema = json.loads(text(name))
    return schema


def served(base: str, wanted: Sequence[str]) -> dict[str, bytes]:
    """Schemas as a web server gives them out, by their file names: their ids, and what refers to them, are URLs there.

    Args:
        base: the URL of their folder, with the slash at its end.
        wanted: the names of those that are needed; what they refer to comes along.
    """
    from calibrary.records.schema import SCHEMA_BASE  # noqa: PLC0415

    reference = re.compile(rf'"{re.escape(SCHEMA_BASE)}([a-z0-9-]+)'.encode())
    found: dict[str, bytes] = {}
    due = [*wanted]
    while due:
        name = due.pop()
        data = text(name)
        found[name + SUFFIX] = reference.sub(f'"{base}'.encode() + rb"\1" + SUFFIX.encode(), data)
        due += {one.decode() for one in reference.findall(data)} - {key.removesuffix(SUFFIX) for key in found}
    return found


@cache
def validator(name: str) -> Validator:
    """One schema made ready, with all others to refer to."""
    from calibrary.records import complaints  # noqa: PLC0415  jsonschema, which few need
    from calibrary.records.schema import SCHEMA_BASE  # noqa: PLC0415

    return complaints.validator(load(name), {SCHEMA_BASE + n: load(n) for n in names()})


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
    from calibrary.records import complaints  # noqa: PLC0415  jsonschema, which few need

    complaints.check(value, validator(name), source=source, locate=locate)
