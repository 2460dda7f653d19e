"""An entry as flat fields, and two entries field by field: what a person reviews, line by line.

``git diff`` shows an entry's file the same way: one field a line, every digit, and the uncertainty beside its number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeAlias

from msgspec import field

from calibrary.distortion import MODELS
from calibrary.errors import InputError
from calibrary.records import Record, flat, to_json
from calibrary.records.schema import schema
from calibrary.registry.entry import Entry
from calibrary.registry.entry_form import PARAMETERS
from calibrary.registry.entry_yaml import LARGEST_ENTRY, parse_entry

__all__ = [
    "NOT_SHOWN",
    "Field",
    "FieldChange",
    "Row",
    "Value",
    "differences",
    "entry_fields",
    "entry_row",
    "entry_rows",
    "entry_text",
    "known_fields",
    "std_of",
]

Field: TypeAlias = str | int | float | bool | None
Value: TypeAlias = bool | int | float | str | tuple[str, ...]
Row: TypeAlias = Mapping[str, Value]
"""What is known of an entry, by field; what it does not state is not in it."""

NOT_SHOWN: Final = frozenset({"schema", "digest", "intrinsics.pixel_origin"})
"""The fields of an entry's file that no view shows: the same in every entry, or a seal over what is shown."""


WIDTH: Final = 24
"""The same in every file, or a longer name would make a difference of every line."""


class FieldChange(Record):
    """One field in which two entries differ.

    Attributes:
        name: dotted, as the file nests it: "intrinsics.fx".
        before, after: None where an entry does not state it.
        delta: after less before, of numbers that mean the same in both.
        z: delta in standard deviations of the difference, where both entries state theirs.
    """

    name: str = field(name="field")
    before: Field
    after: Field
    delta: float | None = None
    z: float | None = None


def entry_fields(entry: Entry) -> dict[str, Field]:
    """Everything that an entry says, in the order of its file; what it does not say is left out."""
    document = to_json(entry)
    if document["distortion"] is None:
        document["distortion"] = "unknown"
    return {name: value for name, value in flat(document).items() if name not in NOT_SHOWN}


def entry_row(entry: Entry) -> dict[str, Value]:
    """All fields of an entry that it may be chosen and sorted by: those of its file, and its unit and firmware."""
    row: dict[str, Value] = {name: value for name, value in entry_fields(entry).items() if value is not None}
    row |= {name: value for name, value in (("tags", entry.tags), ("notes", entry.notes)) if value}
    firmware = entry.calibration.provenance.firmware or (str(entry.firmware) if entry.firmware else None)
    stated = {"firmware": firmware, "unit": entry.calibration.camera.serial}
    return row | {name: value for name, value in stated.items() if value is not None}


@cache
def known_fields() -> frozenset[str]:
    """Every field that an entry may have, whatever its lens; not what its maps and ``x-`` fields are called."""
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
    return frozenset({*names(document, ""), *std, *lenses} - NOT_SHOWN)


def differences(before: Entry | None, after: Entry) -> tuple[FieldChange, ...]:
    """The fields in which one entry differs from another, in the file's order; all where there is no other."""
    old, new = entry_fields(before) if before is not None else {}, entry_fields(after)
    return tuple(
        _change(name, old.get(name), new.get(name), before, after)
        for name in _in_order([*old], [*new])
        if not _same(old.get(name), new.get(name))
    )


def _in_order(old: Sequence[str], new: Sequence[str]) -> list[str]:
    """All names in the order of the new ones, each that is gone behind the one it stood behind."""
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
    """The standard deviation of a parameter: the covariance's, else the one that is stated by itself."""
    quality = entry.calibration.quality
    if quality is None:
        return None
    spread = quality.covariance.std if quality.covariance is not None else {}
    return spread.get(name, quality.std.get(name))


def entry_text(path: Path) -> str:
    """The lines; for a file that is not an entry its own text, below the error. It never fails."""
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_ENTRY + 1)
    except OSError as error:
        return f"cannot be read: {error.strerror}\n"
    try:
        entry = parse_entry(data, "this file", require_digest=False)
    except InputError as error:
        return f"{error}\n{_printable(data)}"
    warning = "" if b"\ndigest:" in data else "no digest: changed by hand\n"
    return warning + "".join(f"{line}\n" for line in _lines(entry))


def entry_rows(entry: Entry, digits: Callable[[float], str] = repr) -> list[tuple[str, str]]:
    """Every field of an entry by its name, its uncertainty behind it; no control characters."""
    return [
        (
            name,
            (digits(value) if isinstance(value, float) else _clean(str(value)))
            + _spread(entry, name, digits),
        )
        for name, value in entry_fields(entry).items()
    ]


def _lines(entry: Entry) -> list[str]:
    return [f"{name:<{WIDTH}}  {text}" for name, text in entry_rows(entry)]


def _spread(entry: Entry, name: str, digits: Callable[[float], str]) -> str:
    """The uncertainty of a number of K or the distortion, and its unit."""
    block, _, parameter = name.partition(".")
    std = std_of(entry, parameter) if block in {"intrinsics", "distortion"} else None
    return (f" ± {digits(std)}" if std is not None else "") + (" px" if block == "intrinsics" else "")


def _clean(text: str) -> str:
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)


def _printable(data: bytes) -> str:
    lines = data.decode("utf-8", "replace").split("\n")
    return "\n".join(map(_clean, lines))
