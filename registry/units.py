"""The units of a registry as a table: export for a spreadsheet, and import of changes to it.

Only fields that do not affect K are imported: labels, tags and notes. Every row contains the id of the entry's file at
the time of the export, so that changes by others since then are detected, cell by cell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from msgspec import Struct

from calibrary.errors import InputError, RegistryError
from calibrary.records import Record
from calibrary.registry.editing import Assignment, Edit, assigned, edit
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.writing import Written
from calibrary.registry.paths import in_use_path, proposal_path, unit_folder
from calibrary.registry.proposals import ChangeReport, Proposals, change_report
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.spreadsheet import csv_text, read_sheet, same_number
from calibrary.registry.stored import StoredEntry

__all__ = ["RowProblem", "UnitsImport", "UnitsReport", "import_units", "units_csv", "units_report"]

EDITABLE: Final = ("label", "tags", "notes")
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


class RowProblem(Record):
    """A row that cannot be imported.

    Attributes:
        line: line number in the file.
        entry: id of the entry, or the name of the unit in the row.
        message: error, with a remedy.
    """

    line: int
    entry: str
    message: str


class UnitsImport(Struct, frozen=True, kw_only=True):
    """Changes made by a table.

    Attributes:
        proposals: entries to write, checked.
        problems: rows with errors; nothing is written if there are any.
        remarks: parts of the table that were not imported, with the reason.
    """

    proposals: Proposals
    problems: tuple[RowProblem, ...]
    remarks: tuple[str, ...]


class UnitsReport(Record, tag_field="schema", tag="calibrary/registry-units-1"):
    """Output of ``calibrary registry units import --json``.

    Attributes:
        file: name of the file.
        change: changes that were written, or would be.
        problems: rows that cannot be imported; nothing is written if there are any.
        remarks: parts of the file that were not imported, with the reason.
    """

    file: str
    change: ChangeReport
    problems: tuple[RowProblem, ...]
    remarks: tuple[str, ...]


def units_report(snapshot: Snapshot, source: str, done: UnitsImport, written: Written | None) -> UnitsReport:
    """Return the report of an import."""
    return UnitsReport(
        file=source,
        change=change_report(snapshot.place, done.proposals, written),
        problems=done.problems,
        remarks=done.remarks,
    )


def units_csv(entries: Sequence[StoredEntry], *, excel: bool = False) -> bytes:
    """Return entries as CSV, one row each; serial numbers are hashes, as in the registry."""
    rows = ([_row(one.entry, one.id, one.oid)[name] for name in COLUMNS] for one in entries)
    return csv_text(COLUMNS, rows, excel=excel).encode()


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


def import_units(snapshot: Snapshot, data: bytes, source: str) -> UnitsImport:
    """Propose the labels, tags and notes of a table; nothing is written.

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
    if not {"entry", "serial"} & names.keys() or not {*EDITABLE} & names.keys():
        raise InputError(
            f"has the columns {', '.join(names)}; expected entry or serial, and label, tags or notes, as 'calibrary "
            "registry units export' writes them",
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
        return UnitsImport(
            proposals=Proposals(items=()), problems=tuple(work.problems), remarks=tuple(remarks)
        )
    edits: dict[str, Edit] = {path: assigned(said) for path, said in work.assignments.items()}
    proposals = edit(snapshot, edits, verb="Edit") if edits else Proposals(items=())
    problems = [
        RowProblem(line=work.lines.get(error.place or "", 0), entry=error.place or "", message=error.message)
        for error in proposals.errors
    ]
    return UnitsImport(proposals=proposals, problems=tuple(problems), remarks=tuple(remarks))


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
            stored = self._meant(cells)
            for one in stored:
                if one.path in self.lines:
                    raise InputError(f"its entry has line {self.lines[one.path]} already")
                self.lines[one.path] = line
                self._compare(one, cells, line)
        except (InputError, RegistryError) as error:
            message = error.message if isinstance(error, InputError) else str(error)
            self.problems.append(RowProblem(line=line, entry=name, message=message))

    def _meant(self, cells: Mapping[str, str]) -> list[StoredEntry]:
        """Return the entry of a row, or all entries of its unit."""
        if key := cells.get("entry"):
            return [self._snapshot.get(key)]
        if not (serial := cells.get("serial")):
            raise InputError("names neither an entry nor a serial number")
        every = {*self._snapshot.paths, *map(in_use_path, self._snapshot.proposed)}
        paths = self._snapshot.of_unit(every, serial)
        model = cells.get("model", "")
        found = [
            one
            for path in paths
            if (one := self._snapshot.at(path) or self._snapshot.at(proposal_path(path)))
        ]
        found = [one for one in found if not model or model == one.entry.calibration.camera.model]
        if len({one.entry.unit for one in found}) != 1:
            several = "several units have it; state the model" if found else "no unit of the registry has it"
            raise InputError(f"the serial number {serial:.40}: {several}")
        return found

    def _compare(self, stored: StoredEntry, cells: Mapping[str, str], line: int) -> None:
        now = _texts(stored.entry, stored.id, stored.oid)
        before = self._exported(stored, cells.get("file"), now)
        for name in EDITABLE:
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
            if name not in {*EDITABLE, "file", "entry"} and given is not None and before is not None:
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
        unit, paths = stored.entry.unit, [stored.path]
        if name == "label" and unit is not None:
            # A label belongs to the unit: a row of one entry sets it for all.
            label, other = self._labels.setdefault(unit, (said, line))
            if label != said:
                raise InputError(f"its unit is {label!r:.60} in line {other}, and {said!r:.60} here")
            every = (*self._snapshot.paths, *self._snapshot.proposed)
            paths = [path for path in every if unit_folder(path) == unit]
        value = ",".join(said.replace(";", " ").replace(",", " ").split()) if name == "tags" else said
        one = Assignment(field=name, value=value)
        # Raises an error for a value that an entry cannot have; the caller adds the line number.
        assigned([one])(stored.entry)
        for path in paths:
            self.assignments.setdefault(path, []).append(one)


def _texts(entry: Entry, id_: str, oid: str | None) -> dict[str, str]:
    """Return the cells of a row in the form in which they are read back."""
    row = _row(entry, id_, oid)
    return {name: "" if value is None else str(value).strip(" ") for name, value in row.items()}


def _ignored(differing: Mapping[str, int]) -> list[str]:
    changed = [f"{name} ({count} rows)" for name, count in differing.items() if count]
    if not changed:
        return []
    more = f" and {len(changed) - MOST_TOLD} more" if len(changed) > MOST_TOLD else ""
    return [
        f"not imported, as only {', '.join(EDITABLE)} are: {', '.join(changed[:MOST_TOLD])}{more}; K is changed with "
        "'calibrary registry add', its days with 'set' and 'approve'"
    ]


def _unknown(names: Mapping[str, str]) -> list[str]:
    others = [written for name, written in names.items() if name not in COLUMNS]
    return [f"columns that a registry does not have: {', '.join(others[:MOST_TOLD])}"] if others else []
