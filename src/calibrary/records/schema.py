"""JSON Schema (2020-12) from the declaration of a record.

msgspec's own generator uses neither the docstrings nor the written form of a record, and its schema of a
family of records does not lead to a useful message for a wrong document. This module therefore walks the
types that ``msgspec.inspect`` reports.
"""

from __future__ import annotations

import inspect as python
import re
from collections.abc import Mapping
from enum import Enum
from functools import cache
from typing import Any, Final, cast

from msgspec import NODEFAULT, inspect

from calibrary.records import Record

DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"
SCHEMA_BASE: Final = "urn:calibrary:schema:"
"""Prefix of the ``$id`` of every schema: a URN, because the project has no website. To use a URL, change it here and
run ``make schemas``."""
BOUNDS: Final = {
    "gt": "exclusiveMinimum",
    "ge": "minimum",
    "lt": "exclusiveMaximum",
    "le": "maximum",
    "multiple_of": "multipleOf",
}
DAY: Final = "^[0-9]{4}-[0-9]{2}-[0-9]{2}$"
SCALARS: Final[Mapping[type[inspect.Type], str]] = {
    inspect.StrType: "string",
    inspect.IntType: "integer",
    inspect.FloatType: "number",
    inspect.BoolType: "boolean",
    inspect.NoneType: "null",
}

Schema = dict[str, Any]


def schema(
    kind: type[Record],
    name: str | None = None,
    *,
    printed: bool = False,
    own_shape: bool = True,
    homes: Mapping[type, str] | None = None,
) -> Schema:
    """Make the schema of a record's documents.

    Args:
        kind: class of the record.
        name: name of the schema file, for its ``$id``.
        printed: whether calibrary writes the documents, so that every field is present. In documents written by
            people, fields with a default may be absent.
        own_shape: whether the document is in the written form of the record, or as from ``fields_json``.
        homes: references to classes that other schema files define.
    """
    builder = _Builder(printed=printed, homes=homes or {})
    body = builder.body(kind, own_shape=own_shape)
    head: Schema = {"$schema": DIALECT} | ({"$id": SCHEMA_BASE + name} if name is not None else {})
    defs = {key: builder.defs[key] for key in sorted(builder.defs)}
    return head | body | ({"$defs": defs} if defs else {})


def parts(kind: type[Record]) -> dict[str, type]:
    """The classes that a record's schema defines, by name under ``$defs``."""
    builder = _Builder(printed=True, homes={})
    builder.body(kind)
    return builder.kinds


@cache
def descriptions(kind: type[Record]) -> Mapping[str, str]:
    """Descriptions by field, from ``Attributes:`` in the docstrings of a record and its bases."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        text = python.cleandoc(base.__doc__ or "")
        section = re.search(r"^Attributes:\n(.*?)(?=^\S|\Z)", text, re.MULTILINE | re.DOTALL)
        if section is None:
            continue
        for names, said in re.findall(
            r"^    ([a-z_][\w, ]*): (.*?)(?=^    \S|\Z)", section[1], re.MULTILINE | re.DOTALL | re.IGNORECASE
        ):
            for field in names.split(","):
                found[field.strip()] = _prose(said)
    return found


def _title(kind: type) -> str:
    return _prose(python.cleandoc(kind.__doc__ or kind.__name__).split("\n\n")[0])


def _prose(text: str) -> str:
    """A docstring's text without its markup, for readers of JSON."""
    text = re.sub(r":\w+:`~?(?:[\w.]*\.)?(\w+)`", r"\1", " ".join(text.split()))
    return re.sub(r"\bNone\b", "null", text).replace("``", "").removesuffix(".")


class _Builder:
    def __init__(self, *, printed: bool, homes: Mapping[type, str]) -> None:
        self.printed = printed
        self.homes = homes
        self.defs: dict[str, Schema] = {}
        self.kinds: dict[str, type] = {}

    def body(self, kind: type[Record], *, own_shape: bool = True) -> Schema:
        """A record's own schema; the schemas of nested records are added to ``defs``."""
        info = cast("inspect.StructType", inspect.type_info(kind))
        said = descriptions(kind)
        members: Schema = {}
        required: list[str] = []
        if info.tag_field is not None:
            members[info.tag_field] = {"const": info.tag}
            required.append(info.tag_field)
        for field in info.fields:
            if field.name in kind._unwritten:
                continue
            members[field.encode_name] = self.of(field.type)
            if field.name in said:
                members[field.encode_name]["description"] = said[field.name]
            if self.printed or (field.default is NODEFAULT and field.default_factory is NODEFAULT):
                required.append(field.encode_name)
        made: Schema = {"title": _title(kind), "type": "object"}
        if required:
            made["required"] = required
        made |= {"additionalProperties": False, "properties": members}
        return kind._wire_schema(made, self.defs) if own_shape else made

    def of(self, type_: inspect.Type) -> Schema:
        """The schema of a field's type."""
        match type_:
            case inspect.Metadata():
                made = self.of(type_.type) | (type_.extra_json_schema or {})
            case inspect.UnionType():
                made = self.union(type_.types)
            case inspect.StructType():
                made = self.reference(cast("type[Record]", type_.cls))
            case inspect.EnumType():
                made = self.enum(type_.cls)
            case inspect.TupleType() | inspect.VarTupleType() | inspect.ListType() | inspect.DictType():
                made = self.collection(type_)
            case _:
                made = self.scalar(type_)
        return made

    def collection(
        self, type_: inspect.TupleType | inspect.VarTupleType | inspect.ListType | inspect.DictType
    ) -> Schema:
        """Schema of a list of fixed length, a list of any length, or a map."""
        if isinstance(type_, inspect.DictType):
            return {"type": "object", "additionalProperties": self.of(type_.value_type)}
        if isinstance(type_, inspect.TupleType):
            sides = [self.of(item) for item in type_.item_types]
            return {"type": "array", "prefixItems": sides, "minItems": len(sides), "maxItems": len(sides)}
        sizes = {"minItems": type_.min_length, "maxItems": type_.max_length}
        return {"type": "array", "items": self.of(type_.item_type)} | _present(sizes)

    def scalar(self, type_: inspect.Type) -> Schema:
        """Schema of a string, number, boolean, null, date, enumeration, or any value."""
        if isinstance(type_, inspect.LiteralType):
            return {"enum": list(type_.values)}
        if isinstance(type_, inspect.AnyType | inspect.RawType):
            return {}
        if isinstance(type_, inspect.DateTimeType):
            return {"type": "string", "format": "date-time"}
        if isinstance(type_, inspect.DateType):
            return {"type": "string", "pattern": DAY}
        bounds = {said: getattr(type_, bound, None) for bound, said in BOUNDS.items()}
        text = {
            "pattern": getattr(type_, "pattern", None),
            "minLength": getattr(type_, "min_length", None),
            "maxLength": getattr(type_, "max_length", None),
        }
        return {"type": SCALARS[type(type_)]} | _present(bounds) | _present(text)

    def union(self, types: tuple[inspect.Type, ...]) -> Schema:
        """Schema of a value or null, one of several scalars, or a family of tagged records."""
        nullable = any(isinstance(one, inspect.NoneType) for one in types)
        others = [one for one in types if not isinstance(one, inspect.NoneType)]
        if len(others) > 1 and all(isinstance(one, inspect.StructType) for one in others):
            made = self.family([cast("type[Record]", one.cls) for one in others])  # type: ignore[attr-defined]
        elif len(others) > 1:
            parts = [self.of(one) for one in others]
            plain = all(part.keys() == {"type"} for part in parts)
            made = {"type": [part["type"] for part in parts]} if plain else {"anyOf": parts}
        else:
            made = self.of(others[0])
        if not nullable:
            return made
        if "enum" in made:
            made = made | {"enum": [*made["enum"], None]}
            if "type" not in made:
                return made
        if "type" in made:
            kinds = made["type"] if isinstance(made["type"], list) else [made["type"]]
            return made | {"type": [*kinds, "null"]}
        return {"anyOf": [made, {"type": "null"}]}

    def family(self, kinds: list[type[Record]]) -> Schema:
        """Schema of a family of tagged records: the tag selects which record's schema applies."""
        field = cast("str", kinds[0].__struct_config__.tag_field)
        base = next(one for one in reversed(kinds[0].__mro__) if _tag_field(one) == field)
        if base in self.homes:
            return {"$ref": self.homes[base]}
        if self.is_new(base):
            self.defs[base.__name__] = {
                "type": "object",
                "required": [field],
                "properties": {field: {"enum": [kind.__struct_config__.tag for kind in kinds]}},
                "allOf": [
                    {
                        "if": {
                            "required": [field],
                            "properties": {field: {"const": kind.__struct_config__.tag}},
                        },
                        "then": self.reference(kind),
                    }
                    for kind in kinds
                ],
            }
        return {"$ref": f"#/$defs/{base.__name__}"}

    def is_new(self, kind: type) -> bool:
        """Whether ``defs`` does not yet define a class.

        Raises:
            TypeError: another class with this name is defined.
        """
        known = self.kinds.setdefault(kind.__name__, kind)
        if known is not kind:
            raise TypeError(f"{known} and {kind} would share one place in a schema, rename one")
        return kind.__name__ not in self.defs

    def enum(self, kind: type[Enum]) -> Schema:
        """Reference to an enum's schema."""
        if kind in self.homes:
            return {"$ref": self.homes[kind]}
        self.is_new(kind)
        self.defs[kind.__name__] = {"title": _title(kind), "enum": [member.value for member in kind]}
        return {"$ref": f"#/$defs/{kind.__name__}"}

    def reference(self, kind: type[Record]) -> Schema:
        """Reference to a record's schema, in this file or in the one that defines it."""
        name = kind.__name__
        if kind in self.homes:
            return {"$ref": self.homes[kind]}
        if self.is_new(kind):
            self.defs[name] = {}  # A record may contain records of its own class.
            self.defs[name] = self.body(kind)
        return {"$ref": f"#/$defs/{name}"}


def _tag_field(kind: type) -> str | None:
    return kind.__struct_config__.tag_field if issubclass(kind, Record) else None


def _present(values: Mapping[str, Any]) -> Schema:
    return {name: value for name, value in values.items() if value is not None}
