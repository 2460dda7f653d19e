"""Entries as flat fields, and differences between two entries field by field, for reviewers.

``git diff`` shows an entry in the same form: one field per line, all digits, and the uncertainty next to its value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, Final, TypeAlias

from msgspec import field

from calibrary.distortion import MODELS
from calibrary.records import Record, flat, to_json
from calibrary.records.schema import schema
from calibrary.registry.entry import PARAMETERS, Entry

Field: TypeAlias = str | int | float | bool | None
Value: TypeAlias = bool | int | float | str | tuple[str, ...]
Row: TypeAlias = Mapping[str, Value]
"""Fields of an entry; missing values are omitted."""

NOT_SHOWN: Final = frozenset({"schema", "digest", "intrinsics.pixel_origin"})
"""Fields of the file that no view shows: equal in every entry, or a checksum of what is shown."""


WIDTH: Final = 24
"""Equal in all files; otherwise a longer name would change every line of a diff."""


class FieldChange(Record):
    """A field in which two entries differ.

    Attributes:
        name: dotted name, as nested in the file: "intrinsics.fx".
        before, after: values; None if an entry does not state the field.
        delta: after minus before, for numbers with the same meaning in both.
        z: delta divided by the standard deviation of the difference, if both entries state theirs.
    """

    name: str = field(name="field")
    before: Field
    after: Field
    delta: float | None = None
    z: float | None = None


def entry_fields(entry: Entry) -> dict[str, Field]:
    """Return all fields of an entry, its status first, in the order of its file; missing values are omitted."""
    document = {"status": entry.status.value, "reason": entry.reason, **to_json(entry)}
    if document["distortion"] is None:
        document["distortion"] = "unknown"
    return {name: value for name, value in flat(document).items() if name not in NOT_SHOWN}


def entry_row(entry: Entry) -> dict[str, Value]:
    """Return all fields for selection and sorting: those of the file, and the unit and firmware."""
    row: dict[str, Value] = {name: value for name, value in entry_fields(entry).items() if value is not None}
    row |= {name: value for name, value in (("tags", entry.tags), ("notes", entry.notes)) if value}
    firmware = entry.calibration.provenance.firmware or (str(entry.firmware) if entry.firmware else None)
    stated = {"firmware": firmware, "unit": entry.calibration.camera.serial}
    return row | {name: value for name, value in stated.items() if value is not None}


@cache
def known_fields() -> frozenset[str]:
    """Return the names of all possible fields of an entry, for any lens, except those in maps and ``x-`` fields."""
    document = schema(Entry)

    def names(part: Mapping[str, Any], prefix: str) -> Iterator[str]:
        for one in (part, *part.get("anyOf", ()), *part.get("oneOf", ())):
            if "$ref" in one:
                yield from names(document["$defs"][one["$ref"].rpartition("/")[2]], prefix)
            for name, inner in one.get("properties", {}).items():
                below = [*names(inner, f"{prefix}{name}.")]
                yield from below or [f"{prefix}{name}"]

    std = {f"quality.std.{name}" for name in PARAMETERS}
    lenses = {f"distortion.{name}" for model in MODELS.values() for name in model.names()}
    return frozenset({"status", "reason", *names(document, ""), *std, *lenses} - NOT_SHOWN)


def differences(before: Entry | None, after: Entry) -> tuple[FieldChange, ...]:
    """Return the fields in which two entries differ, in the order of the file; all fields if ``before`` is None."""
    old, new = entry_fields(before) if before is not None else {}, entry_fields(after)
    return tuple(
        _change(name, old.get(name), new.get(name), before, after)
        for name in _in_order([*old], [*new])
        if not _same(old.get(name), new.get(name))
    )


def _in_order(old: Sequence[str], new: Sequence[str]) -> list[str]:
    """Return all names in the new order; a removed one follows the name that it followed before."""
    names = [*new]
    for at, name in enumerate(old):
        if name not in names:
            names.insert(names.index(old[at - 1]) + 1 if at else 0, name)
    return names


def _same(one: Field, other: Field) -> bool:
    return type(one) is type(other) and one == other


def _change(name: str, old: Field, new: Field, before: Entry | None, after: Entry) -> FieldChange:
    delta = z = None
    if before is not None and _are_numbers(old, new) and _mean_the_same(name, before, after):
        delta = float(new) - float(old)  # type: ignore[arg-type]  # numbers, as just asked
        stds = [std_of(entry, name.rpartition(".")[2]) for entry in (before, after)]
        block = name.partition(".")[0]
        if block in {"intrinsics", "distortion"} and stds[0] is not None and stds[1] is not None:
            spread = math.hypot(stds[0], stds[1])
            z = delta / spread if spread > 0 else None
    return FieldChange(name=name, before=old, after=new, delta=delta, z=z)


def _are_numbers(*values: Field) -> bool:
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def _mean_the_same(name: str, before: Entry, after: Entry) -> bool:
    one, other = before.calibration, after.calibration
    if name.startswith("distortion."):
        return type(one.distortion) is type(other.distortion)
    return not name.startswith("intrinsics.") or one.intrinsics.image_size == other.intrinsics.image_size


def std_of(entry: Entry, name: str) -> float | None:
    """Return the standard deviation of a parameter, from the covariance or as stated separately."""
    quality = entry.calibration.quality
    if quality is None:
        return None
    spread = quality.covariance.std if quality.covariance is not None else {}
    return spread.get(name, quality.std.get(name))


def entry_rows(entry: Entry, digits: Callable[[float], str] = repr) -> list[tuple[str, str]]:
    """Return every field of an entry as (name, value with uncertainty), without control characters."""
    return [
        (
            name,
            (digits(value) if isinstance(value, float) else _clean(str(value)))
            + _spread(entry, name, digits),
        )
        for name, value in entry_fields(entry).items()
    ]


def _spread(entry: Entry, name: str, digits: Callable[[float], str]) -> str:
    """Return the uncertainty of a parameter of K or the distortion, and its unit."""
    block, _, parameter = name.partition(".")
    std = std_of(entry, parameter) if block in {"intrinsics", "distortion"} else None
    return (f" ± {digits(std)}" if std is not None else "") + (" px" if block == "intrinsics" else "")


def _clean(text: str) -> str:
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)
