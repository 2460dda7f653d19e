"""Records: one declaration defines the JSON form, the JSON Schema, the flat fields and the reading.

How to declare a record::

    class Flight(Record):
        # The docstring describes each field under "Attributes:", as in "day: of the flight; None when unknown".
        camera: CameraKey
        images: Annotated[int, Meta(ge=0)]
        day: date | None = None

* :func:`to_json` writes every field under its name, or under another set by ``msgspec.field(name="from")``, and
  :func:`from_json` reads it. Enums are written as their value, dates as ISO 8601, tuples as lists.
* The schema describes a field by its line under ``Attributes:``; bounds and patterns are part of its annotation
  (``msgspec.Meta``). Reading checks them, a constructor does not: a record that could otherwise be constructed but not
  read back calls :func:`require_declared` in its ``__post_init__``. Other conditions that must always hold are checked
  there too; it raises :class:`~calibrary.errors.InputError` and sets fields with ``force_setattr``.
* A versioned document is declared as ``class Plan(Record, tag_field="schema", tag="calibrary/plan-1")``. A family of
  records declares ``tag_field`` once, in the base class; each member has its tag as a class variable of that name.
* A field that only this process needs, such as what a page is drawn from, has a default and stands in ``_unwritten``;
  it is in neither the document nor the schema.
* A record that is written in another form overrides ``_wire``, ``_unwire`` and ``_wire_schema``. When ``_wire`` is
  called, nested records are already in their written form; when ``_unwire`` is called, they are not yet read.
* A document with its own schema file gets a line in ``docs/make_schemas.py``; ``make schemas`` writes the file, and a
  test fails while the file is out of date.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import date
from enum import Enum
from functools import cache, partial
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Final,
    TypeAlias,
    TypeVar,
    Union,
    cast,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

import msgspec
from msgspec import Meta
from msgspec.structs import force_setattr

from calibrary.errors import InputError, ParseError

if TYPE_CHECKING:
    from jsonschema.protocols import Validator

__all__ = [
    "Json",
    "Limits",
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
    "narrow",
    "replace",
    "require_declared",
    "require_within",
    "to_json",
]

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"
"""A JSON document or a part of one."""
Scalar: TypeAlias = "bool | int | float | str"
Locate: TypeAlias = Callable[[Sequence[str | int]], "int | None"]
"""Function that returns the line number of a value, given its path in the document."""

LONGEST_LIST_SHOWN = 9
"""Most numbers shown in a flat field; a longer list is shown as its length and a digest."""

T = TypeVar("T")
R = TypeVar("R", bound="Record")


class _RecordType(msgspec.StructMeta):
    """Metaclass that makes all fields keyword-only and takes the tag of a family member from its class variable."""

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
    """Base class of immutable values that are written or read; constructed with keywords."""

    def to_dict(self) -> dict[str, Json]:
        """Return the record as plain data for JSON, as its schema says."""
        return to_json(self)

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        """Convert the document of the fields to its written form."""
        return document

    @classmethod
    def _unwire(cls, document: dict[str, Json]) -> dict[str, Json]:
        """Convert a written document to that of the fields, unwritten ones too; may change it and raise InputError."""
        return document

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], _defs: dict[str, Any]) -> dict[str, Any]:
        """Convert the schema of the fields to that of the written form; ``_defs`` are the schemas it refers to."""
        return schema

    _lifted: ClassVar[str | None] = None
    """Name of a field with members that are written at the level of the record itself; error paths omit this name."""

    _unwritten: ClassVar[frozenset[str]] = frozenset()
    """Names of fields that are neither written nor read."""

    def __init_subclass__(cls, **how: Any) -> None:
        super().__init_subclass__(**how)
        # Their types may be those that only a type checker knows, which msgspec would look up to read a document.
        cls.__annotations__.update(dict.fromkeys(cls._unwritten & cls.__annotations__.keys(), Any))


def replace(record: T, /, **changes: Any) -> T:
    """Copy a record with some fields changed.

    Raises:
        TypeError: the record has no such field.
    """
    if isinstance(record, msgspec.Struct):
        return msgspec.structs.replace(record, **changes)
    copied: T = dataclasses.replace(record, **changes)  # type: ignore[type-var]
    return copied


def to_json(record: Record) -> dict[str, Json]:
    """Convert a record to a JSON object: all fields in declared order, null for None."""
    return record._wire(fields_json(record))


def encoded(document: Mapping[str, object] | Record, *, indent: int = 2) -> bytes:
    """Encode a record or a JSON document as UTF-8, without a line feed at its end.

    Surrogates, which represent bytes of a file name that is not UTF-8, are written as JSON escapes. So the
    document is valid, and ``os.fsencode`` of the name read back gives the original bytes.

    Args:
        document: a record, or plain values with finite numbers.
        indent: columns per level; 0 for a single line.
    """
    try:
        compact = msgspec.json.encode(
            document._wire(fields_json(document, _in_parts)) if isinstance(document, Record) else document
        )
    except UnicodeEncodeError:
        # msgspec cannot encode a surrogate, nor indent a document that contains its escape.
        plain = to_json(document) if isinstance(document, Record) else document
        text = json.dumps(plain, indent=indent or None, ensure_ascii=False, allow_nan=False)
        return text.encode(errors="backslashreplace")
    return msgspec.json.format(compact, indent=indent)


def _in_parts(value: object) -> Any:
    """As :func:`_plain`, with the records of a list encoded, so that their plain values exist one at a time."""
    if isinstance(value, tuple) and value and isinstance(value[0], Record):
        return [msgspec.Raw(msgspec.json.encode(_plain(one))) for one in value]
    return _plain(value)


def fields_json(record: Record, plain: Callable[[object], Json] | None = None) -> dict[str, Json]:
    """The fields of a record as JSON, without its own ``_wire``; nested records are in their written form.

    Args:
        record: the record.
        plain: converts a value, a nested record too; by default to plain values throughout.
    """
    plain = plain or _plain
    config = record.__struct_config__
    document: dict[str, Json] = {} if config.tag_field is None else {config.tag_field: config.tag}
    for name, written in _written(type(record)):
        value = getattr(record, name)
        document[written] = value if type(value) in AS_THEY_ARE else plain(value)
    return document


@cache
def _written(kind: type[Record]) -> tuple[tuple[str, str], ...]:
    """Names of the fields that are written, and those that they are written under."""
    names = zip(kind.__struct_fields__, kind.__struct_encode_fields__, strict=True)
    return tuple((name, written) for name, written in names if name not in kind._unwritten)


AS_THEY_ARE: Final = frozenset({str, int, bool, type(None)})
"""Types of most values; written without a call for each."""


NUMBERS: Final = frozenset({int, float})


def _plain(value: object) -> Json:
    if isinstance(value, Record):
        return value._wire(fields_json(value))
    if isinstance(value, Enum):
        return cast("str", value.value)
    if isinstance(value, float) and not math.isfinite(value):
        # The encoder would write NaN as null.
        raise ValueError(f"a record contains {value}, which has no JSON form")
    if value is None or isinstance(value, int | float | str):
        return value
    if isinstance(value, tuple | list | frozenset):
        # A long list of numbers, as of corners, takes a fifth of the time by its types alone.
        if set(map(type, value)) <= NUMBERS and all(map(math.isfinite, value)):
            return list(value)
        return [item if type(item) in AS_THEY_ARE else _plain(item) for item in value]
    if isinstance(value, Mapping):
        return {
            str(name): member if type(member) in AS_THEY_ARE else _plain(member)
            for name, member in value.items()
        }
    if isinstance(value, date):
        return value.isoformat()
    raise TypeError(f"a record contains {type(value).__name__}, which has no JSON form")


def from_json(
    kind: type[R], document: object, *, source: str | None = None, locate: Locate | None = None
) -> R:
    """Read a record from a document.

    Args:
        kind: class of the record.
        document: dicts, lists and scalars, as read from JSON or YAML.
        source: name of the document in errors, usually the file name.
        locate: returns the line of a value from its path, such as ``partial(strictyaml.line_of, data)``.

    Raises:
        ParseError: the first error, its place in the document, and the number of further errors.
    """
    try:
        if not _is_finite(document):
            raise msgspec.ValidationError("a number is not finite")
        return msgspec.convert(_prepared({None: kind}, document), kind)
    except (msgspec.ValidationError, InputError) as error:
        # Needed only for a document with errors.
        from calibrary.records.complaints import check, place_of  # noqa: PLC0415  the reason above

        check(document, checker(kind), source=source, locate=locate)
        path, message = _own_words(kind, error)
        raise ParseError(message, source=source, place=place_of(path, locate)) from None


@cache
def checker(kind: type[Record]) -> Validator:
    """Validator that finds all errors in a record's document by its schema."""
    # jsonschema takes 80 ms to load.
    from calibrary.records.complaints import validator  # noqa: PLC0415  the reason above
    from calibrary.records.schema import schema  # noqa: PLC0415  the reason above

    return validator(schema(kind))


def _own_words(kind: type[Record], error: Exception) -> tuple[list[str | int], str]:
    """Path and message of an error raised by reading."""
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


def _is_finite(document: object) -> bool:
    values = [document]
    while values:
        value = values.pop()
        if isinstance(value, float):
            if not math.isfinite(value):
                return False
        elif isinstance(value, dict):
            values += value.values()
        elif isinstance(value, list):
            values += value
    return True


def _prepared(kinds: Mapping[str | None, type[Record]], value: object) -> object:
    """Convert written documents to those of the fields; values of a wrong type are left for msgspec to refuse.

    Args:
        kinds: classes that the record may have, by tag.
        value: a record's document, or a list of such documents.
    """
    if isinstance(value, list):
        return [_prepared(kinds, item) for item in value]
    if not isinstance(value, dict):
        return value
    kind = next(iter(kinds.values()))
    tag_field = kind.__struct_config__.tag_field
    if len(kinds) > 1:
        named = kinds.get(value.get(tag_field or ""))
        if named is None:
            return value
        kind = named
    special = _special(kind)
    if special is None:
        return value
    if tag_field is not None and tag_field not in value:
        raise InputError(f"lacks {tag_field}")
    if unknown := kind._unwritten & value.keys():
        raise InputError(f"Object contains unknown field {min(unknown)}")
    document = kind._unwire(dict(value))
    for name, inner in special:
        if name in document:
            document[name] = cast("Json", _prepared(inner, document[name]))
    return document


@cache
def _special(kind: type[Record]) -> tuple[tuple[str, Mapping[str | None, type[Record]]], ...] | None:
    """The fields that contain special records: written name, and record classes by tag; None for a plain record.

    A record is special if reading needs more than msgspec: it, or one nested in it, has an ``_unwire``, a tag or
    an unwritten field.
    """
    from msgspec import inspect  # noqa: PLC0415  reading alone needs it

    found = []
    for field in cast("inspect.StructType", inspect.type_info(kind)).fields:
        if field.name in kind._unwritten:
            continue
        inner: dict[str | None, type[Record]] = {}
        types: list[Any] = [field.type]
        while types:
            type_ = types.pop(0)
            if isinstance(type_, inspect.StructType):
                inner[cast("str | None", type_.cls.__struct_config__.tag)] = cast("type[Record]", type_.cls)
            # The inner types of a union; those of a list, a map's values or an annotation.
            types += getattr(type_, "types", ())
            named = [getattr(type_, name, None) for name in ("item_type", "value_type", "type")]
            types += [part for part in named if part is not None]
        for one in inner.values():
            if one is not kind and _special(one) is not None:
                found.append((field.encode_name, inner))
                break
    hooked = kind._unwire.__func__ is not Record._unwire.__func__  # type: ignore[attr-defined]
    tagged = kind.__struct_config__.tag_field is not None
    return tuple(found) if hooked or kind._unwritten or tagged or found else None


def flat(record: Record | Mapping[str, Json]) -> dict[str, Scalar]:
    """Flatten a record to scalars by dotted name, such as ``intrinsics.fx``, in written order.

    None and empty values are omitted. A list becomes one text; a long list of numbers becomes its length and a
    digest, which changes if a number does.
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
        import hashlib  # noqa: PLC0415  it loads OpenSSL, for what few tables need

        return f"{len(values)} numbers ({hashlib.sha256(json.dumps(values).encode()).hexdigest()[:12]})"
    return "; ".join(map(_worded, values))


def _worded(value: Json) -> str:
    if isinstance(value, dict):
        return " ".join(map(str, flat(value).values()))
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


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
        # Most fields of most records are empty.
        for one in _members(value) if value is not None else ():
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
    if isinstance(value, tuple):
        return value
    # A mapping is asked for last, because what is none of its kinds is compared with all of them.
    return (
        value.values()
        if not isinstance(value, str | int | float) and isinstance(value, Mapping)
        else (value,)
    )


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
