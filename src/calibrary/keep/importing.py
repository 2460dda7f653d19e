"""Bringing many calibrations into a registry as one commit: a folder of files of any format, or the catalogue.

Nothing that stands is lost: what is there already stays as it is, and a file that cannot be taken is told and holds
up no other.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

from calibrary.errors import CalibraryError, RegistryError
from calibrary.keep.adding import Proposal, Wish, propose
from calibrary.keep.admission import objections
from calibrary.keep.catalogue_entries import KIND, catalogue_entries
from calibrary.keep.keeper import Keeper, note_of
from calibrary.keep.operand import Reading
from calibrary.parsers.image_names import is_image
from calibrary.records import Json, replace, to_json
from calibrary.registry.digest import digest
from calibrary.registry.entry import Entry, Status
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.writing import Written
from calibrary.validation import Finding, Severity

__all__ = ["Fate", "Import", "Item", "import_catalogue", "import_folder", "imported_json", "write_import"]

SKIPPED_FOLDERS: Final = frozenset({".git"})


class Fate(StrEnum):
    """What becomes of one calibration."""

    NEW = "new"
    CHANGED = "changed"
    SAME = "same"
    LEFT = "left"
    FAILED = "failed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """One calibration on its way in.

    Attributes:
        source: the file's name below the folder, or the catalogue's title.
        fate: what becomes of it.
        entry_id: of the entry it is, where that is known.
        why: why it is left or failed, or what a person should know of it.
    """

    source: str
    fate: Fate
    entry_id: str | None = None
    why: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Import:
    """What would be written.

    Attributes:
        what: is imported, in words for the history.
        items: every calibration that was found.
        due: the entries to write, each with the id of the content it takes the place of.
        findings: what the registry's check says of them.
    """

    what: str
    items: tuple[Item, ...]
    due: tuple[tuple[Entry, str | None], ...]
    findings: tuple[Finding, ...]

    def count(self, fate: Fate) -> int:
        """How many calibrations have this fate."""
        return sum(item.fate is fate for item in self.items)


def import_folder(
    keeper: Keeper,
    folder: Path,
    reading: Reading,
    wish: Wish,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Import:
    """Every calibration file below a folder, as it would be written.

    Args:
        keeper: of the registry.
        folder: is gone through to its bottom; links to folders are not followed, and images are left out, for a
            folder of them is a flight and no set of calibrations.
        reading: answers to what the files leave open.
        wish: what was said of all of them.
        progress: called with how many files are done, and of how many.

    Raises:
        RegistryError: the folder cannot be read.
    """
    files = list(_files(folder))
    items: list[Item] = []
    due: dict[str, tuple[Entry, str | None, str]] = {}
    for at, path in enumerate(files, start=1):
        source = path.relative_to(folder).as_posix()
        for item, proposal in _of_file(keeper, path, source, reading, wish):
            items.append(item if proposal is None else _taken_in(due, item, proposal))
        if progress is not None:
            progress(at, len(files))
    entries = [(entry, base) for entry, base, _ in due.values()]
    name = folder.resolve().name or "a folder"
    return _judged(keeper, f"the calibrations of {name}", items, entries)


def import_catalogue(keeper: Keeper) -> Import:
    """Every camera of the built-in catalogue whose K can be derived, as drafts.

    An entry that came from the catalogue before and is still a draft follows it; any other stays.
    """
    entries, left = catalogue_entries()
    listed = keeper.registry.snapshot().paths
    items = [Item(source=camera.title, fate=Fate.LEFT, why=camera.why) for camera in left]
    due = []
    for entry in entries:
        base = listed.get(entry.path)
        standing = _standing(keeper, entry.path, base)
        fate, why = _fate(entry, standing) if base is not None else (Fate.NEW, None)
        source = entry.calibration.provenance.tag or entry.id
        items.append(Item(source=source, fate=fate, entry_id=entry.id, why=why))
        if fate in {Fate.NEW, Fate.CHANGED}:
            due.append((entry, base))
    return _judged(keeper, "the catalogue of known cameras", items, due)


def write_import(keeper: Keeper, found: Import, *, reason: str | None = None) -> Written | None:
    """Write them as one commit; None where nothing is due.

    Raises:
        FileConflictError: somebody has changed one meanwhile; nothing was written.
        RegistryError: they cannot be written.
    """
    if not found.due:
        return None
    entries = [entry for entry, _ in found.due]
    whose = "entry" if len(entries) == 1 else "entries"
    note = note_of(f"Import {found.what}: {len(entries)} {whose}", entries, reason)
    return keeper.save(found.due, note)


def imported_json(found: Import, commit: str | None) -> dict[str, Json]:
    """The JSON form of an import (schemas/registry-import-1.schema.json)."""
    items: list[Json] = [
        {"source": item.source, "fate": item.fate.value, "entry": item.entry_id, "why": item.why}
        for item in found.items
    ]
    findings: list[Json] = [to_json(finding) for finding in found.findings]
    return {
        "schema": "calibrary/registry-import-1",
        "commit": commit,
        "due": len(found.due),
        "items": items,
        "findings": findings,
    }


def _files(folder: Path) -> Iterator[Path]:
    if not folder.is_dir():
        raise RegistryError(
            f"{folder}: no such folder; wanted one with calibration files, or the word 'catalogue'; 'calibrary "
            "registry add' takes a single file"
        )

    def refuse(error: OSError) -> None:
        raise RegistryError(f"{error.filename}: cannot be read: {error.strerror}") from None

    for here, folders, names in os.walk(folder, onerror=refuse):
        folders[:] = sorted(name for name in folders if name not in SKIPPED_FOLDERS)
        for name in sorted(names):
            path = Path(here, name)
            if not name.startswith(".") and not is_image(path) and path.is_file():
                yield path


def _of_file(
    keeper: Keeper, path: Path, source: str, reading: Reading, wish: Wish
) -> Iterator[tuple[Item, Proposal | None]]:
    try:
        proposals, _ = propose(keeper, path, reading, wish)
    except CalibraryError as error:
        told = str(error).removeprefix(f"{path.name}: ").removeprefix(f"{path}: ")
        yield Item(source=source, fate=Fate.FAILED, why=told), None
        return
    for proposal in proposals:
        fate = Fate.SAME if not proposal.changes else Fate.NEW if proposal.base is None else Fate.CHANGED
        why = "; ".join(proposal.remarks) or None
        yield Item(source=source, fate=fate, entry_id=proposal.entry.id, why=why), proposal


def _taken_in(due: dict[str, tuple[Entry, str | None, str]], item: Item, proposal: Proposal) -> Item:
    """Two files of one camera: alike they are one, otherwise the first stands and the other is told."""
    if item.fate is Fate.SAME:
        return item
    entry = proposal.entry
    other = due.setdefault(entry.path, (entry, proposal.base, item.source))
    if other[0] is entry:
        return item
    if _numbers(other[0]) == _numbers(entry):
        return replace(item, fate=Fate.SAME, why=f"the same numbers as in {other[2]}")
    why = (
        f"{other[2]} holds other numbers of the same camera; 'calibrary registry add' takes the one that is right, "
        "or flags (--lens, --sub-camera, --serial) that tell the two cameras apart"
    )
    return replace(item, fate=Fate.FAILED, why=why)


def _standing(keeper: Keeper, path: str, base: str | None) -> Entry | None:
    if base is None:
        return None
    try:
        return parse_entry(keeper.registry.repo.blob(base), path)
    except CalibraryError:
        return None


def _fate(entry: Entry, standing: Entry | None) -> tuple[Fate, str | None]:
    if standing is None:
        return Fate.LEFT, "what stands there cannot be read: 'calibrary registry check' says why"
    made = standing.calibration.provenance
    if made.kind != KIND:
        grade = standing.calibration.grade.value
        return Fate.LEFT, f"an entry of grade {grade}, {made.kind}, stands there already"
    if _said(entry) == _said(standing):
        return Fate.SAME, None
    if standing.status is not Status.DRAFT:
        return Fate.LEFT, f"it is {standing.status.value}; the catalogue says something else by now"
    return Fate.CHANGED, None


def _numbers(entry: Entry) -> str:
    return digest(entry.calibration, entry.sensor)


def _said(entry: Entry) -> tuple[object, ...]:
    """What the catalogue says of a camera, whichever version of the program wrote it down."""
    return _numbers(entry), entry.aliases, entry.tolerance, entry.notes


def _judged(
    keeper: Keeper, what: str, items: Sequence[Item], due: Sequence[tuple[Entry, str | None]]
) -> Import:
    """With what speaks against entries taken out of what is due: one bad file holds up no other."""
    entries = [entry for entry, _ in due]
    findings = objections(keeper, entries) if entries else ()
    refused: dict[str, str] = {}
    for finding in findings:
        if finding.severity is Severity.ERROR:
            refused.setdefault(finding.place or "", finding.message)
    ids = {entry.path: entry.id for entry in entries}
    bad = {ids[path]: message for path, message in refused.items() if path in ids}
    judged = tuple(
        replace(item, fate=Fate.FAILED, why=bad[item.entry_id])
        if item.entry_id in bad and item.fate in {Fate.NEW, Fate.CHANGED}
        else item
        for item in items
    )
    return Import(
        what=what,
        items=judged,
        due=tuple((entry, base) for entry, base in due if entry.path not in refused),
        findings=findings,
    )
