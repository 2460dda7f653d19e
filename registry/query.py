"""Selection and sorting of entries by any of their fields: ``grade=calibrated date<2025-01-01 label~P4R``.

Conditions are separated by blanks, and all must hold::

    field=VALUE[,VALUE…]    is one of these         field!=VALUE    is none of these
    field~TEXT[,TEXT…]      contains one of these   field!~TEXT     contains none of these
    field<VALUE  <= > >=    is less, greater        field / !field  is stated / is not stated

A value with blanks or commas must be quoted. Text is compared case-insensitively; a list (tags, notes) by its members.
Numbers are compared as numbers. A date may be shortened: ``date=2026-05`` is any day of May, and ``date<2025`` any day
before 2025. A field that an entry does not state matches only ``!field``, ``!=`` and ``!~``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from functools import cached_property
from operator import ge, gt, le, lt
from typing import Any, Final

from msgspec import Struct

from calibrary.errors import InputError, RegistryError
from calibrary.interop.notebook import MOST_ROWS, html_rows
from calibrary.known_camera import match_key
from calibrary.provenance import ABOUT, Provenance
from calibrary.records import Json, to_json
from calibrary.registry.fields import Row, Value, known_fields
from calibrary.registry.paths import (
    PROPOSED,
    UNIT,
    file_path,
    id_of,
    is_proposal,
    proposed_name,
    unit_folder,
)
from calibrary.registry.snapshot import ListedEntries, Snapshot, StoredEntry

SHORT_NAMES: Final[Mapping[str, str]] = {
    **{name: f"camera.{name}" for name in ("make", "model", "sub_camera", "lens", "serial")},
    **{name: f"intrinsics.{name}" for name in ("fx", "fy", "cx", "cy", "skew")},
    **{name: f"provenance.{name}" for name in Provenance.__struct_fields__},
    "size": "camera.image_size",
    "focal": "camera.focal_mm",
    "mode": "camera.capture_mode",
    "distortion": "distortion.model",
    "rms": "quality.rms_px",
    "sigma": "quality.std.fx",
    "from": "validity.from",
    "until": "validity.until",
}
"""Short names of frequent fields; others are named as in the file, or by the last part of that name."""
OWN: Final = (
    *("id", "label", "unit", "tags", "notes", "status"),
    *("grade", "firmware", "proposal", "proposed"),
)
"""Fields that are not in the file, or not in this form."""
DATES: Final = frozenset(
    {
        *(f"provenance.{name}" for name, one in ABOUT.items() if one.flag == "day"),
        "validity.from",
        "validity.until",
    }
)
SHORTEST: Final = 4
UNIT_FOLDER: Final = f"/{UNIT}"
_CONDITION = re.compile(
    r"""\s*(?P<not>!)?(?P<field>[A-Za-z_][\w.-]*)(?:(?P<op>!=|!~|<=|>=|=|~|<|>)(?P<value>(?:"[^"]*"|'[^']*'|[^\s"'])*))?(?=\s|$)"""
)
_PART = re.compile(r"""(?:"[^"]*"|'[^']*'|[^,"'])+""")
_ORDERED: Final[Mapping[str, Callable[[Any, Any], bool]]] = {"<": lt, "<=": le, ">": gt, ">=": ge}


class Condition(Struct, frozen=True, kw_only=True):
    """A condition.

    Attributes:
        field: field as it was written.
        operator: "" tests whether it is stated, "!" whether it is not.
        values: values to compare with; one must match.
    """

    field: str
    operator: str
    values: tuple[str, ...] = ()

    def holds(self, row: Row, field: str) -> bool:
        """Return whether the condition holds for an entry.

        Args:
            row: fields of the entry.
            field: full name of the field, from :func:`find_field`.

        Raises:
            InputError: the field is a number and the value is not.
        """
        value = row.get(field)
        if self.operator in {"", "!"}:
            return (value is not None) == (self.operator == "")
        if self.operator.startswith("!"):
            return value is None or not any(self._fits(field, value, wanted) for wanted in self.values)
        return value is not None and any(self._fits(field, value, wanted) for wanted in self.values)

    def _fits(self, field: str, value: Value, wanted: str) -> bool:
        if isinstance(value, tuple):
            return any(self._fits(field, member, wanted) for member in value)
        operator = self.operator.removeprefix("!")
        if operator == "~":
            return match_key(wanted) in match_key(str(value))
        if isinstance(value, bool):
            return wanted.lower() in ({"yes", "true", "1"} if value else {"no", "false", "0"})
        if isinstance(value, int | float):
            return _compared(operator, float(value), self._number(wanted))
        if field in DATES:
            return _compared(operator, value[: len(wanted)], wanted)
        return _compared(operator, match_key(value), match_key(wanted))

    def _number(self, text: str) -> float:
        try:
            return float(text)
        except ValueError:
            raise InputError(f"{self.field} is a number, and {text!r:.40} is not") from None


def _compared(operator: str, value: object, wanted: object) -> bool:
    return value == wanted if operator == "=" else _ORDERED[operator](value, wanted)


def parse_where(text: str) -> tuple[Condition, ...]:
    """Parse conditions.

    Raises:
        InputError: the text is not a list of conditions; the message states the position.
    """
    at, found = 0, []
    while text[at:].strip():
        match = _CONDITION.match(text, at)
        operator = (match["op"] or "") if match is not None else ""
        if match is None or (match["not"] and operator) or (operator and not match["value"]):
            raise InputError(
                f"{text[at:].strip()!r:.60} is not a condition, expected such as grade=calibrated, 'date<2025-01-01', "
                "label~P4R or !date"
            )
        values = tuple(_unquoted(part) for part in _PART.findall(match["value"] or ""))
        found.append(
            Condition(field=match["field"], operator="!" if match["not"] else operator, values=values)
        )
        at = match.end()
    return tuple(found)


def _unquoted(text: str) -> str:
    return re.sub(r"""["']""", "", text)


class Selection(Struct, frozen=True, kw_only=True, dict=True):
    """Selected and sorted entries.

    Attributes:
        paths: names of the entries, in order.
        rows: fields of each entry.
    """

    paths: tuple[str, ...]
    rows: tuple[Row, ...]

    @cached_property
    def known(self) -> frozenset[str]:
        """All fields that can be asked for."""
        return known_fields().union(*self.rows)

    def columns(self, names: str) -> tuple[str, ...]:
        """Return the full names of the fields in ``name,name``; errors as for :func:`find_field`."""
        return tuple(find_field(name.strip(), self.known) for name in names.split(",") if name.strip())


def select(
    found: Sequence[tuple[str, Row]], where: Sequence[Condition] = (), sort: str | None = None
) -> Selection:
    """Select the entries for which all conditions hold, sorted by ``field,-field``; - sorts from large to small.

    Args:
        found: path and fields of each entry.
        where: conditions.
        sort: fields to sort by.

    Raises:
        InputError: a field does not exist, or a value has another type than its field.
    """
    paths, rows = [path for path, _ in found], [row for _, row in found]
    every = Selection(paths=tuple(paths), rows=tuple(rows))
    if not where and not sort:
        return every
    asked = [(condition, find_field(condition.field, every.known)) for condition in where]
    order = [
        (find_field(name.strip().removeprefix("-"), every.known), name.strip().startswith("-"))
        for name in (sort or "").split(",")
        if name.strip()
    ]
    fits = [at for at, row in enumerate(rows) if all(one.holds(row, field) for one, field in asked)]
    chosen = [fits[at] for at in sort_rows([rows[at] for at in fits], order)]
    return Selection(paths=tuple(paths[at] for at in chosen), rows=tuple(rows[at] for at in chosen))


def find_field(name: str, known: Collection[str]) -> str:
    """Return the full name of a field.

    Args:
        name: a short name, a field as nested in the file (``camera.make``), or its last part.
        known: all possible fields of an entry, and those of these entries.

    Raises:
        InputError: there is no such field, or several; the message lists similar ones.
    """
    asked = name.lower().replace("-", "_")
    if asked in OWN:
        return asked
    if asked in SHORT_NAMES:
        return SHORT_NAMES[asked]
    by_case = {field.lower().replace("-", "_"): field for field in known}
    if asked in by_case:
        return by_case[asked]
    ends = sorted(field for low, field in by_case.items() if low.rpartition(".")[2] == asked)
    if len(ends) == 1:
        return ends[0]
    if ends:
        raise InputError(f"{name} may be {', '.join(ends[:8])}; write one of them")
    words = {*OWN, *SHORT_NAMES, *by_case.values(), *(field.rpartition(".")[2] for field in by_case.values())}
    near = get_close_matches(asked, sorted(words), n=3, cutoff=0.6)
    raise InputError(
        f"there is no field {name!r:.40}; "
        + (f"nearest: {', '.join(near)}" if near else f"expected {', '.join([*OWN, *SHORT_NAMES][:12])} …")
    )


def sort_rows(rows: Sequence[Row], order: Iterable[tuple[str, bool]]) -> list[int]:
    """Return the indices of rows sorted by (field, descending); rows without the field come last."""
    places = [*range(len(rows))]
    for field, descending in reversed([*order]):
        stated = [at for at in places if field in rows[at]]
        missing = [at for at in places if field not in rows[at]]
        stated.sort(key=lambda at: _sortable(rows[at][field]), reverse=descending)
        places = stated + missing
    return places


def _sortable(value: Value) -> tuple[int, float, str]:
    if isinstance(value, int | float):
        return 0, float(value), ""
    text = ", ".join(value) if isinstance(value, tuple) else value
    # Digits are compared as numbers: P4R-10 comes after P4R-9.
    return 1, 0.0, re.sub(r"\d+", lambda digits: digits[0].zfill(12), match_key(text))


def short_ids(paths: Sequence[str], every: Collection[str]) -> list[str]:
    """Return the ids of entries, with the hash of a unit as short as possible: ``dji/fc6310r/sn-0e25/5472x3648``.

    Args:
        paths: paths of the entries.
        every: paths of all entries, among which the ids must be unique.
    """
    models = {_model_and_hash(path)[0] for path in paths if UNIT_FOLDER in path}
    hashes: dict[str, set[str]] = {model: set() for model in models}
    for path in every if models else ():
        if UNIT_FOLDER in path and (named := _model_and_hash(path))[0] in hashes:
            hashes[named[0]].add(named[1])
    lengths = {model: _shortest(digits) for model, digits in hashes.items()}
    shown, found = set(paths), []
    for path in paths:
        short = id_of(path)
        if UNIT_FOLDER in path:
            model, digits = _model_and_hash(path)
            short = short.replace(f"/{UNIT}{digits}/", f"/{UNIT}{digits[: lengths[model]]}/")
        beside = is_proposal(path) and file_path(path) in shown
        found.append(f"{short}{PROPOSED}" if beside else short)
    return found


def _model_and_hash(path: str) -> tuple[str, str]:
    model, _, digits = (unit_folder(path) or "/")[:-1].rpartition(f"/{UNIT}")
    return model, digits


def _shortest(digits: Collection[str]) -> int:
    longest = max(map(len, digits))
    lengths = range(SHORTEST, longest + 1)
    return next((n for n in lengths if len({text[:n] for text in digits}) == len(digits)), longest)


class EntryListing(Struct, frozen=True, eq=False, dict=True):
    """Selected entries of a registry, and the errors of those that cannot be read.

    Attributes:
        chosen: rows of fields of the selected entries, sorted.
        unreadable: errors of entries that cannot be read.
        snapshot: state of the registry.
        columns: full names of the fields to show; None for the usual ones.
    """

    chosen: Selection
    unreadable: tuple[RegistryError, ...]
    snapshot: Snapshot
    columns: tuple[str, ...] | None = None

    @cached_property
    def entries(self) -> tuple[StoredEntry, ...]:
        """The selected entries as objects, read at first use."""
        return self.snapshot.stored(self.chosen.paths)

    @property
    def notes(self) -> list[str]:
        """Sentences about what is only proposed or not approved, and about files that are not read."""
        pairs = [*zip(self.chosen.paths, self.chosen.rows, strict=True)]
        proposed = self.snapshot.all_proposed([path for path, row in pairs if is_proposal(path)])
        said = proposed or None, self.snapshot.unread
        return [text for text in said if text is not None]

    def short_ids(self) -> list[str]:
        """Return the KEYs of the entries, with unit hashes as short as possible."""
        every = (*self.snapshot.paths, *self.snapshot.proposed)
        return short_ids(self.chosen.paths, every)

    def _repr_html_(self) -> str:
        """Return the entries as HTML, for notebooks."""
        rows = []
        for short, row in zip(self.short_ids()[:MOST_ROWS], self.chosen.rows, strict=False):
            fx, said = row["intrinsics.fx"], (row.get("label"), short, row["status"], row["grade"])
            day = str(row.get("provenance.date", ""))[:10]
            rows.append((*(str(text or "") for text in said), f"{fx:.2f}", day))
        columns = ("label", "entry", "status", "grade", "fx px", "made on")
        return html_rows(columns, rows, many=len(self.chosen.rows))

    def to_dict(self) -> dict[str, Json]:
        """Return the listing as plain data for JSON (schemas/entry-listing-1.schema.json)."""
        return to_json(ListedEntries.of(self.entries))


def listed(
    snapshot: Snapshot,
    words: Sequence[str] = (),
    *,
    statuses: Collection[str] = (),
    grades: Collection[str] = (),
    where: Sequence[str] = (),
    sort: str | None = None,
    columns: str | None = None,
) -> EntryListing:
    """Select entries.

    A proposal is included if its camera has no usable entry, or if drafts are asked for.

    Args:
        snapshot: state of the registry.
        words: parts of the id or label; all must occur.
        statuses: statuses to include; all if empty.
        grades: grades to include; all if empty.
        where: conditions; see :mod:`calibrary.registry.query`.
        sort: fields; see :func:`calibrary.registry.query.select`; by default entries are sorted by id.
        columns: fields to show; None for the usual ones.

    Raises:
        InputError: a condition or field does not exist.
    """
    conditions = [one for text in where for one in parse_where(text)]
    unreadable: list[RegistryError] = []
    paths = _paths_with_words(snapshot, [word.lower() for word in words])
    proposed = snapshot.proposed
    found = [
        (path, _row(path, row, proposed))
        for path, row in snapshot.rows(paths, unreadable=unreadable.append)
        if (not statuses or row["status"] in statuses)
        and (not grades or row["grade"] in grades)
        and (path not in proposed or "draft" in statuses or file_path(path) not in snapshot.paths)
    ]
    found.sort(key=lambda one: str(one[1]["id"]))
    chosen = select(found, conditions, sort)
    shown = chosen.columns(columns) if columns is not None else None
    return EntryListing(chosen, tuple(unreadable), snapshot, shown)


def _paths_with_words(snapshot: Snapshot, words: Sequence[str]) -> Iterator[str]:
    """Yield the paths of the entries with every word in their id or label."""
    every = (*snapshot.paths, *snapshot.proposed)
    if not words:
        yield from every
        return
    labels = snapshot.labels
    for path in every:
        label = labels.get(file_path(path), "") if labels else ""
        # The first word excludes nearly all entries of a large registry, before their ids are computed.
        if not label and words[0] not in path:
            continue
        named = f"{id_of(path)} {label}".lower()
        if all(word in named for word in words):
            yield path


def _row(path: str, stated: Row, proposed: Collection[str]) -> Row:
    """Return the fields of an entry with its id, and whether it is proposed or another proposal exists."""
    is_pending = path in proposed
    row = {**stated, "id": id_of(path), "proposed": is_pending}
    if proposed and path not in proposed and proposed_name(path) in proposed:
        row["proposal"] = f"{id_of(path)}{PROPOSED}"
    return row
