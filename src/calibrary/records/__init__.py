"""Records: declared once, from which follow their JSON form, JSON Schema, flat fields and reading.

How to declare one::

    class Flight(Record):
        # The docstring describes each field under "Attributes:", as in "day: of the flight; None when unknown".
        camera: CameraKey
        images: Annotated[int, Meta(ge=0)]
        day: date | None = None

* Every field is written by :func:`to_json` under its name, ``msgspec.field(name="from")`` says another, and
  :func:`from_json` reads it. Enums are written as their value, dates as ISO 8601, tuples as lists.
* Its description in the schema is its line under ``Attributes:``; bounds and patterns stand in its annotation
  (``msgspec.Meta``). A constructor does not check them, reading does. What always has to hold is checked by
  ``__post_init__``, which raises :class:`~calibrary.errors.InputError` and sets fields with ``force_setattr``.
* A document with a version says ``class Plan(Record, tag_field="schema", tag="calibrary/plan-1")``. The members of a
  family say ``tag_field`` once, in their base class, and the tag as a class variable of that name.
* A record that is written in another shape overrides ``_wire``, ``_unwire`` and ``_wire_schema``; nested records are
  already written when ``_wire`` sees the document, and not yet read when ``_unwire`` does.
* A document with a schema file of its own gets a line in ``docs/make_schemas.py``; ``make schemas`` writes the file,
  and a test fails while it is not fresh.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import date
from enum import Enum
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias, TypeVar, cast, dataclass_transform

import msgspec
from msgspec import Meta
from msgspec.structs import force_setattr

from calibrary.errors import InputError, ParseError

if TYPE_CHECKING:
    from jsonschema.protocols import Validator

__all__ = [
    "Json",
    "Locate",
    "Meta",
    "Record",
    "Scalar",
    "checker",
    "encoded",
    "fields_json",
    "flat",
    "force_setattr",
    "from_json",
    "replace",
    "to_json",
]

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"
"""A JSON document or a part of one."""
Scalar: TypeAlias = "bool | int | float | str"
Locate: TypeAlias = Callable[[Sequence[str | int]], "int | None"]
"""From the path of a value to its line in the document's file."""

LONGEST_LIST_SHOWN = 9
"""Numbers that a flat field shows; a longer list is shown by its length and a digest."""

T = TypeVar("T")
R = TypeVar("R", bound="Record")


class _RecordType(msgspec.StructMeta):
    """Makes every record's fields keyword-only, and takes a family member's tag from its class variable."""

    def __new__(
        cls, name: str, bases: tuple[type, ...], namespace: dict[str, Any], **options: Any
    ) -> _RecordType:
        options.setdefault("kw_only", True)
        family = next((base for base in bases if isinstance(base, _RecordType)), None)
        if family is not None and "tag" not in options:
            field = family.__struct_config__.tag_field
            if field is not None and field in namespace:
                options["tag"] = namespace[field]
        return super().__new__(cls, name, bases, namespace, **options)


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(msgspec.field,))
class Record(msgspec.Struct, metaclass=_RecordType, frozen=True, forbid_unknown_fields=True):
    """A value that is written or read, immutable, made with keywords."""

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        """The document that is written, from the one that the fields give."""
        return document

    @classmethod
    def _unwire(cls, document: dict[str, Json]) -> dict[str, Json]:
        """The document as the fields have it, from a written one; may raise InputError. It may be changed."""
        return document

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], _defs: dict[str, Any]) -> dict[str, Any]:
        """The schema of what is written, from the one that the fields give and those it refers to."""
        return schema

    _lifted: ClassVar[str | None] = None
    """A field whose members are written beside it, in one map with the other fields: errors leave it out."""


def replace(record: T, /, **changes: Any) -> T:
    """A copy of a record with some fields changed.

    Raises:
        TypeError: it has no such field.
    """
    if isinstance(record, msgspec.Struct):
        return msgspec.structs.replace(record, **changes)
    copied: T = dataclasses.replace(record, **changes)  # type: ignore[type-var]
    return copied


def to_json(record: Record) -> dict[str, Json]:
    """The JSON object of a record: every field in its declared order, null where it is None."""
    return record._wire(fields_json(record))


def encoded(document: Mapping[str, object] | Record, *, indent: int = 2) -> bytes:
    """The UTF-8 text of a record or a JSON document, without a line feed at its end.

    What Python makes of a file name that is not UTF-8 is written as the JSON escape of the same character, so the
    document is valid and ``os.fsencode`` of the name it gives back is the file's.

    Args:
        document: a record, or plain values whose numbers are finite.
        indent: columns for each level; 0 puts all on one line.
    """
    plain = to_json(document) if isinstance(document, Record) else document
    try:
        compact = msgspec.json.encode(plain)
    except UnicodeEncodeError:
        # msgspec takes no such character, and as an escape does not indent it either.
        text = json.dumps(plain, indent=indent or None, ensure_ascii=False, allow_nan=False)
        return text.encode(errors="backslashreplace")
    # The plain values of a long report take more than its text, and are gone before it is indented.
    del plain
    return msgspec.json.format(compact, indent=indent)


def fields_json(record: Record) -> dict[str, Json]:
    """The fields of a record as JSON, before it brings them into a shape of its own; inner records are in theirs."""
    config = record.__struct_config__
    document: dict[str, Json] = {}
    if config.tag_field is not None:
        document[config.tag_field] = config.tag
    for name, written in zip(record.__struct_fields__, record.__struct_encode_fields__, strict=True):
        document[written] = _plain(getattr(record, name))
    return document


def _plain(value: object) -> Json:
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, Enum):
        return cast("str", value.value)
    if isinstance(value, float) and not math.isfinite(value):
        # The encoder would write null.
        raise ValueError(f"a record contains {value}, which has no JSON form")
    if isinstance(value, int | float | str):
        return value
    if isinstance(value, Record):
        return to_json(value)
    if isinstance(value, Mapping):
        return {str(name): _plain(member) for name, member in value.items()}
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, tuple | list | frozenset):
        return [_plain(item) for item in value]
    raise TypeError(f"a record contains {type(value).__name__}, which has no JSON form")


def from_json(
    kind: type[R], document: object, *, source: str | None = None, locate: Locate | None = None
) -> R:
    """The record that a document states.

    Args:
        kind: its class.
        document: dicts, lists and scalars, as JSON or YAML are read.
        source: what errors call the document, usually the file's name.
        locate: from the path of a value to its line, such as ``partial(strictyaml.line_of, data)``.

    Raises:
        ParseError: the first thing that is wrong, its place in the document, and how many more there are.
    """
    try:
        if not _is_finite(document):
            raise msgspec.ValidationError("a number is not finite")
        return msgspec.convert(_prepared(kind, document), kind)
    except (msgspec.ValidationError, InputError) as error:
        # Only a document that is wrong needs it.
        from calibrary.records.complaints import check, place_of  # noqa: PLC0415  the reason above

        check(document, checker(kind), source=source, locate=locate)
        path, message = _own_words(kind, error)
        raise ParseError(message, source=source, place=place_of(path, locate)) from None


@cache
def checker(kind: type[Record]) -> Validator:
    """What finds everything that is wrong with a document of a record, by its schema."""
    # jsonschema takes 80 ms to load.
    from calibrary.records.complaints import validator  # noqa: PLC0415  the reason above
    from calibrary.records.schema import schema  # noqa: PLC0415  the reason above

    return validator(schema(kind))


def _own_words(kind: type[Record], error: Exception) -> tuple[list[str | int], str]:
    """The path and the message of what reading raised."""
    cause = error.__cause__ if isinstance(error, msgspec.ValidationError) else error
    text, _, steps = str(error).partition(" - at `$")
    path: list[str | int] = [
        int(index) if index else name for name, index in re.findall(r"\.([^.\[`]+)|\[(\d+)\]", steps)
    ]
    if path and path[0] == kind._lifted:
        del path[0]
    if not isinstance(cause, InputError):
        return path, text.replace("`", "").replace(
            "Invalid RFC3339 encoded date", "is not a day of the calendar"
        )
    return [*path, *(cause.place.split(".") if cause.place else [])], cause.message


def _is_finite(value: object) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, dict):
        return all(map(_is_finite, value.values()))
    return all(map(_is_finite, value)) if isinstance(value, list) else True


def _prepared(kind: type[Record], document: object) -> object:
    """The document as the fields of a record have it; what has the wrong type is left for msgspec to refuse."""
    if not isinstance(document, dict) or not _is_special(kind):
        return document
    config = kind.__struct_config__
    if config.tag_field is not None and config.tag_field not in document:
        raise InputError(f"lacks {config.tag_field}")
    document = kind._unwire(dict(document))
    for name, inner in _records_of(kind):
        if name in document:
            document[name] = _prepared_within(inner, document[name])
    return document


def _prepared_within(inner: Mapping[str | None, type[Record]], value: Json) -> Any:
    """A field's value with the records in it prepared: one, or a list or a map of them."""
    if isinstance(value, list):
        return [_prepared_within(inner, item) for item in value]
    if not isinstance(value, dict):
        return value
    (field,) = {kind.__struct_config__.tag_field for kind in inner.values()}
    kind = next(iter(inner.values())) if len(inner) == 1 else inner.get(cast("str", value.get(field or "")))
    return _prepared(kind, value) if kind is not None else value


@cache
def _is_special(kind: type[Record]) -> bool:
    """Whether reading it needs more than msgspec does: a hook or a tag, its own or of a record inside."""
    hooked = kind._unwire.__func__ is not Record._unwire.__func__  # type: ignore[attr-defined]
    return hooked or kind.__struct_config__.tag_field is not None or bool(_records_of(kind))


@cache
def _records_of(kind: type[Record]) -> tuple[tuple[str, Mapping[str | None, type[Record]]], ...]:
    """The fields that hold special records: the name written, and the kinds by their tags."""
    from msgspec import inspect  # noqa: PLC0415  reading alone needs it

    def kinds(type_: inspect.Type) -> Iterator[type[Record]]:
        if isinstance(type_, inspect.StructType):
            yield cast("type[Record]", type_.cls)
        for part in _parts(type_):
            yield from kinds(part)

    info = inspect.type_info(kind)
    found = (
        (field.encode_name, tuple(kinds(field.type))) for field in cast("inspect.StructType", info).fields
    )
    return tuple(
        (name, {cast("str | None", k.__struct_config__.tag): k for k in inner})
        for name, inner in found
        if any(k is not kind and _is_special(k) for k in inner)
    )


def _parts(type_: Any) -> tuple[Any, ...]:
    """The types that a union, a list, a map's values or an annotation is made of."""
    if (parts := getattr(type_, "types", None)) is not None:
        return tuple(parts)
    named = (getattr(type_, name, None) for name in ("item_type", "value_type", "type"))
    return tuple(part for part in named if part is not None)


def flat(record: Record | Mapping[str, Json]) -> dict[str, Scalar]:
    """What a record says as scalars by dotted names, ``intrinsics.fx``, in its written order.

    What is None or empty is left out. A list is one text; a long list of numbers is its length and a digest, which
    changes when one of them does.
    """
    document = to_json(record) if isinstance(record, Record) else record
    return dict(_flat("", document))


def _flat(prefix: str, document: Mapping[str, Json]) -> Iterator[tuple[str, Scalar]]:
    for name, value in document.items():
        if isinstance(value, dict):
            yield from _flat(f"{prefix}{name}.", value)
        elif isinstance(value, list):
            if value:
                yield f"{prefix}{name}", _joined(value)
        elif value is not None:
            yield f"{prefix}{name}", value


def _joined(values: Sequence[Json]) -> str:
    if all(isinstance(value, int) for value in values):
        return "×".join(map(str, values))
    if len(values) > LONGEST_LIST_SHOWN and all(isinstance(value, float) for value in values):
        return f"{len(values)} numbers ({hashlib.sha256(json.dumps(values).encode()).hexdigest()[:12]})"
    return "; ".join(map(_worded, values))


def _worded(value: Json) -> str:
    if isinstance(value, dict):
        return " ".join(map(str, flat(value).values()))
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
