"""Changes of the label, tags, notes and validity days of one or many entries.

Label, tags and notes do not affect which K is used, and are changed in the file, approved or not. Days do: an entry
with new days is proposed again and needs approval, as after ``calibrary registry add``. K is never changed here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import date
from difflib import get_close_matches
from typing import Final

from msgspec import Struct

from calibrary.arguments import Terms
from calibrary.errors import InputError, RegistryError, first_of
from calibrary.records import replace
from calibrary.registry.entry import Entry, Validity
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from calibrary.registry.fields import differences
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.paths import file_path, proposed_name, unit_folder
from calibrary.registry.proposals import FREELY, Proposals, RowProblem, checked, propose
from calibrary.registry.snapshot import Snapshot, StoredEntry
from calibrary.registry.spreadsheet import csv_text, read_sheet, same_number
from calibrary.registry.stating import Change

OPERATORS: Final = ("+=", "-=", "=")
EDITABLE: Final[Mapping[str, tuple[str, ...]]] = {
    "label": ("=",),
    "tags": OPERATORS,
    "notes": ("=", "+="),
    "valid-from": ("=",),
    "valid-until": ("=",),
}
"""Editable fields, and their operators."""

Edit = Callable[[Entry], Entry]


class Assignment(Struct, frozen=True, kw_only=True):
    """One assignment to a field.

    Attributes:
        field: a field of :data:`EDITABLE`.
        operator: "=" sets, "+=" adds, "-=" removes.
        value: value as text; an empty one removes the field.
    """

    field: str
    operator: str = "="
    value: str


def parse_assignment(text: str) -> Assignment:
    """Parse ``field=value``, ``tags+=value`` or ``tags-=value``; ``+tag`` and ``-tag`` are short for the latter.

    Raises:
        InputError: the text is not an assignment, or the field cannot be set this way; the message states the right
            way.
    """
    name, is_set, value = text.partition("=")
    if not is_set and text[:1] in {"+", "-"} and text[1:].strip():
        return Assignment(field="tags", operator=f"{text[0]}=", value=text[1:].strip())
    operator = f"{name[-1:]}=" if name.endswith(("+", "-")) else "="
    name = name.removesuffix(operator[0]) if operator != "=" else name
    field = name.strip().lower().replace("_", "-")
    if not is_set:
        raise InputError(f"{text!r:.60} is not an assignment, expected FIELD=VALUE, +TAG or -TAG")
    if field not in EDITABLE:
        near = get_close_matches(field, EDITABLE, n=1)
        meant = f"; {near[0]}?" if near else f"; {', '.join(EDITABLE)} can be"
        raise InputError(
            f"{name} cannot be set here{meant}. What K is, and which camera it is of, is changed with 'calibrary "
            "registry add' and 'approve'"
        )
    if operator not in EDITABLE[field]:
        raise InputError(f"{field}{operator} is not possible, expected {' or '.join(EDITABLE[field])}")
    return Assignment(field=field, operator=operator, value=value.strip())


def _assigned(assignments: Sequence[Assignment]) -> Edit:
    """Return a function that applies assignments to an entry, in order."""

    def edit_one(entry: Entry) -> Entry:
        for one in assignments:
            entry = _set(entry, one)
        return entry

    return edit_one


def _set(entry: Entry, one: Assignment) -> Entry:
    if one.field == "label":
        return replace(entry, label=one.value or None)
    if one.field == "tags":
        words = [word.strip() for word in one.value.split(",") if word.strip()]
        if one.operator == "=":
            return replace(entry, tags=tuple(words))
        tags = {*entry.tags} | {*words} if one.operator == "+=" else {*entry.tags} - {*words}
        return replace(entry, tags=tuple(tags))
    if one.field == "notes":
        said = tuple(line.strip() for line in one.value.splitlines() if line.strip())
        notes = (*entry.notes, *said) if one.operator == "+=" else said
        return replace(entry, calibration=replace(entry.calibration, notes=notes))
    first, last = (entry.validity.first, entry.validity.last) if entry.validity is not None else (None, None)
    stated = _day(one)
    first, last = (stated, last) if one.field == "valid-from" else (first, stated)
    return replace(entry, validity=Validity.between(first, last))


def _day(one: Assignment) -> date | None:
    try:
        return date.fromisoformat(one.value) if one.value else None
    except ValueError:
        raise InputError(f"{one.field}={one.value:.40} is not a day such as 2026-05-01") from None


def edit_keys(
    snapshot: Snapshot,
    keys: Sequence[str],
    assignments: Sequence[Assignment],
    terms: Terms = FREELY,
    *,
    paths: Sequence[str] = (),
) -> Proposals:
    """Propose the same assignments for several entries; nothing is written.

    Args:
        snapshot: newest state of the registry.
        keys: keys of entries; the key of a unit is for all its entries, and a label always is.
        assignments: what is set.
        terms: whether new days are approved at once, and why.
        paths: paths of further entries.

    Raises:
        UnknownCameraError: an entry does not exist.
        AmbiguousCameraError: a key matches several units.
        InputError, RegistryError: as for :func:`edit`.
    """
    said: dict[str, list[Assignment]] = {}
    for path in dict.fromkeys([*(path for key in keys for path in _paths_of_key(snapshot, key)), *paths]):
        for one in assignments:
            for place in _places(snapshot, path, one):
                if one not in (those := said.setdefault(place, [])):
                    those.append(one)
    fields = ", ".join(dict.fromkeys(one.field for one in assignments))
    edits = {path: _assigned(those) for path, those in said.items()}
    return edit(snapshot, edits, verb=f"Set {fields} of", terms=terms)


def _paths_of_key(snapshot: Snapshot, key: str) -> list[str]:
    """Return the entry that a key names, or all entries of the one unit that it names."""
    found = [*map(file_path, snapshot.matching(key))]
    units = {unit_folder(path) for path in found}
    return found if len(units) == 1 and None not in units else [file_path(snapshot.find(key))]


def _places(snapshot: Snapshot, path: str, one: Assignment) -> list[str]:
    """Return the entries that an assignment to one of them is for: a label belongs to the unit."""
    unit = unit_folder(path)
    if one.field != "label" or unit is None:
        return [path]
    return [every for every in snapshot.cameras if unit_folder(every) == unit]


def edit(snapshot: Snapshot, changes: Mapping[str, Edit], *, verb: str, terms: Terms = FREELY) -> Proposals:
    """Propose changed entries; nothing is written.

    Args:
        snapshot: newest state of the registry.
        changes: function that returns the changed entry, by path; K is not changed.
        verb: first words of the commit's subject.
        terms: whether new days are approved at once; otherwise they are proposed.

    Raises:
        InputError: a label, tag, note or day is not valid.
        RegistryError: an entry cannot be read.
    """
    stored = [one for path in changes if (one := _filed(snapshot, path)) is not None]
    after = {one.path: _changed(one.entry, changes[one.path]) for one in stored}
    dated = [one for one in stored if after[one.path].validity != one.entry.validity]
    if not dated:
        items = [_set_free(one, after[one.path], terms) for one in stored]
        due = [one for one in items if one.fields]
        named = due[0].id if len(due) == 1 else f"{len(due)} cameras"
        return replace(checked(snapshot, items, only_new=True), title=f"{verb} {named}")
    edited = [one for one in dated if _without_days(after[one.path]) != _without_days(one.entry)]
    if edited:
        raise InputError(
            f"{edited[0].id}: a label, tags and notes are written at once and days wait for approval; set them one "
            "after the other"
        )
    waiting = next((one for one in stored if one.is_pending and snapshot.at(one.path) is not None), None)
    if waiting is not None:
        raise RegistryError(
            f"{waiting.id}: another K is proposed for it; approve that, with its days, or retire it first"
        )
    return propose(snapshot, [after[one.path] for one in stored], terms, edited=True)


def _filed(snapshot: Snapshot, path: str) -> StoredEntry | None:
    """Return what the file of an entry says, if that waits for approval; else what is in force."""
    return snapshot.at(proposed_name(path)) or snapshot.at(path)


def _set_free(stored: StoredEntry, after: Entry, terms: Terms) -> Change:
    return Change(
        action="set",
        before=stored.entry,
        after=after,
        why=terms.reason,
        data=entry_yaml(after),
        base=stored.base,
        fields=differences(stored.entry, after),
    )


def _changed(entry: Entry, change: Edit) -> Entry:
    try:
        return change(entry)
    except InputError as error:
        raise InputError(error.message, source=entry.id, place=error.place) from None


def _without_days(entry: Entry) -> Entry:
    return replace(entry, validity=None)


TABLE_FIELDS: Final = ("label", "tags", "notes")
COLUMNS: Final = (
    *(
        "label",
        "make",
        "model",
        "serial",
        "tags",
        "notes",
        "status",
        "grade",
        "sub_camera",
        "lens",
        "focal_mm",
    ),
    *("image_size", "firmware", "fx", "fy", "cx", "cy", "date", "valid_from", "valid_until", "entry", "file"),
)
MOST_TOLD: Final = 6

Cell = str | float | None


def units_csv(entries: Sequence[StoredEntry]) -> bytes:
    """Return entries as CSV, one row each; serial numbers are hashes, as in the registry."""
    rows = ([_row(one.entry, one.id, one.oid)[name] for name in COLUMNS] for one in entries)
    return csv_text(COLUMNS, rows).encode()


def _row(entry: Entry, id_: str, oid: ObjectId | None) -> dict[str, Cell]:
    calibration, validity = entry.calibration, entry.validity
    camera, K = calibration.camera, calibration.intrinsics
    first, last = (validity.first, validity.last) if validity is not None else (None, None)
    made = calibration.provenance
    return {
        "label": entry.label,
        "make": camera.make,
        "model": camera.model,
        "serial": camera.serial,
        "tags": " ".join(entry.tags),
        "notes": "\n".join(entry.notes),
        "status": entry.status.value,
        "grade": calibration.grade.value,
        "sub_camera": camera.sub_camera,
        "lens": camera.lens,
        "focal_mm": camera.focal_mm,
        "image_size": "x".join(map(str, K.image_size)),
        "firmware": made.firmware or (str(entry.firmware) if entry.firmware is not None else None),
        **{name: float(getattr(K, name)) for name in ("fx", "fy", "cx", "cy")},
        "date": made.date,
        "valid_from": first.isoformat() if first is not None else None,
        "valid_until": last.isoformat() if last is not None else None,
        "entry": id_,
        "file": oid,
    }


def edit_by_table(snapshot: Snapshot, data: bytes, source: str) -> Proposals:
    """Propose the labels, tags and notes of a table; nothing is written. Rows with errors are in the result.

    Args:
        snapshot: newest state of the registry.
        data: content of a CSV file. A row names its entry in the column ``entry``, or its unit in ``serial`` (number
            or hash).
        source: name of the file.

    Raises:
        InputError: the file is not such a table.
        RegistryError: the registry cannot be read.
    """
    sheet = read_sheet(data, source)
    names = {"_".join(name.lower().replace("-", " ").split()): name for name in sheet.columns if name}
    if not {"entry", "serial"} & names.keys() or not {*TABLE_FIELDS} & names.keys():
        raise InputError(
            f"has the columns {', '.join(names)}; expected entry or serial, and label, tags or notes, as 'calibrary "
            "registry set --out FILE' writes them",
            source=source,
        )
    work = _Import(snapshot)
    for line, cells in sheet.rows:
        work.take(line, {name: cells[written] for name, written in names.items()})
    remarks = [*_ignored(work.differing), *_unknown(names)]
    if sheet.encoding == "cp1252":
        remarks.append(
            "it is not UTF-8 and was read as Windows-1252; save it as 'CSV UTF-8' if letters are wrong"
        )
    if work.problems:
        return Proposals(items=(), problems=tuple(work.problems), remarks=tuple(remarks))
    edits: dict[str, Edit] = {path: _assigned(said) for path, said in work.assignments.items()}
    proposals = edit(snapshot, edits, verb="Set labels, tags and notes of") if edits else Proposals(items=())
    problems = [
        RowProblem(line=work.lines.get(error.place or "", 0), entry=error.place or "", message=error.message)
        for error in proposals.errors
    ]
    return replace(proposals, problems=tuple(problems), remarks=tuple(remarks))


class _Import:
    """Processes the rows of a table.

    Attributes:
        assignments: new values, by path.
        lines: line number of the assignment, by path.
        problems: rows that cannot be imported.
        differing: number of rows that differ from the registry, by column that is not imported.
    """

    def __init__(self, snapshot: Snapshot) -> None:
        self.assignments: dict[str, list[Assignment]] = {}
        self.lines: dict[str, int] = {}
        self.problems: list[RowProblem] = []
        self.differing: dict[str, int] = {}
        self._snapshot = snapshot
        self._labels: dict[str, tuple[str, int]] = {}

    def take(self, line: int, cells: Mapping[str, str]) -> None:
        """Process one row."""
        name = cells.get("entry") or cells.get("serial") or ""
        try:
            stored = self._entries_of_row(cells)
            for one in stored:
                if one.path in self.lines:
                    raise InputError(f"its entry has line {self.lines[one.path]} already")
                self.lines[one.path] = line
                self._compare(one, cells, line)
        except (InputError, RegistryError) as error:
            message = error.message if isinstance(error, InputError) else str(error)
            self.problems.append(RowProblem(line=line, entry=name, message=message))

    def _entries_of_row(self, cells: Mapping[str, str]) -> list[StoredEntry]:
        """Return the entry of a row, or all entries of its unit."""
        if key := cells.get("entry"):
            return [self._snapshot.get(key)]
        if not (serial := cells.get("serial")):
            raise InputError("names neither an entry nor a serial number")
        paths = self._snapshot.of_unit(self._snapshot.cameras, serial)
        model = cells.get("model", "")
        found = [one for path in paths if (one := _filed(self._snapshot, path)) is not None]
        found = [one for one in found if not model or model == one.entry.calibration.camera.model]
        if len({one.entry.unit for one in found}) != 1:
            several = "several units have it; state the model" if found else "no unit of the registry has it"
            raise InputError(f"the serial number {serial:.40}: {several}")
        return found

    def _compare(self, stored: StoredEntry, cells: Mapping[str, str], line: int) -> None:
        now = _texts(stored.entry, stored.id, stored.oid)
        before = self._exported(stored, cells.get("file"), now)
        for name in TABLE_FIELDS:
            said = cells.get(name)
            if said is None or said == now[name] or (before is not None and said == before[name]):
                continue
            if before is None or before[name] != now[name]:
                raise InputError(
                    f"{name} is {now[name]!r:.60} in the registry since the export, and {said!r:.60} here; "
                    "export it again"
                )
            self._assign(stored, name, said, line)
        for name in now:
            given = cells.get(name)
            if name not in {*TABLE_FIELDS, "file", "entry"} and given is not None and before is not None:
                differs = not same_number(given, before[name])
                self.differing[name] = self.differing.get(name, 0) + differs

    def _exported(self, stored: StoredEntry, oid: str | None, now: dict[str, str]) -> dict[str, str] | None:
        """Return the row as it was exported, None if unknown; without a file id, the current values."""
        if not oid or oid == stored.oid:
            return now
        try:
            data = self._snapshot.require_git("has no earlier files")[0].blob(oid)
            return _texts(parse_entry(data, stored.path), stored.id, oid)
        except (InputError, RegistryError):
            return None

    def _assign(self, stored: StoredEntry, name: str, said: str, line: int) -> None:
        unit = stored.entry.unit
        if name == "label" and unit is not None:
            label, other = self._labels.setdefault(unit, (said, line))
            if label != said:
                raise InputError(f"its unit is {label!r:.60} in line {other}, and {said!r:.60} here")
        value = ",".join(said.replace(";", " ").replace(",", " ").split()) if name == "tags" else said
        one = Assignment(field=name, value=value)
        # Raises an error for a value that an entry cannot have; the caller adds the line number.
        _assigned([one])(stored.entry)
        for path in _places(self._snapshot, stored.path, one):
            self.assignments.setdefault(path, []).append(one)


def _texts(entry: Entry, id_: str, oid: str | None) -> dict[str, str]:
    """Return the cells of a row in the form in which they are read back."""
    row = _row(entry, id_, oid)
    return {name: "" if value is None else str(value).strip(" ") for name, value in row.items()}


def _ignored(differing: Mapping[str, int]) -> list[str]:
    changed = [f"{name} ({count} rows)" for name, count in differing.items() if count]
    if not changed:
        return []
    return [
        f"not imported, as only {', '.join(EDITABLE)} are: {first_of(changed, MOST_TOLD)}; K is changed with "
        "'calibrary registry add', its days with 'set' and 'approve'"
    ]


def _unknown(names: Mapping[str, str]) -> list[str]:
    others = [written for name, written in names.items() if name not in COLUMNS]
    return [f"columns that a registry does not have: {', '.join(others[:MOST_TOLD])}"] if others else []
