"""Import of many calibrations into a registry as one commit: a folder of files of any format, or the catalogue.

Existing entries stay unchanged. A file that cannot be imported is reported and does not stop the others.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final

from msgspec import Struct

from calibrary import parsers
from calibrary.arguments import Reading
from calibrary.errors import CalibraryError, RegistryError
from calibrary.jobs.exchange.add import AddRequest, propose_file
from calibrary.jobs.exchange.catalogue_entries import KIND, catalogue_entries
from calibrary.jobs.exchange.material import require_reason, with_material_changes
from calibrary.progress import log
from calibrary.records import Meta, Record, replace
from calibrary.registry.entry import Entry, Status, digest
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.writing import Written
from calibrary.registry.paths import proposal_path
from calibrary.registry.proposals import Proposal, Proposals, checked, proposal_of, save
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import Snapshot
from calibrary.validation import Finding, Severity

__all__ = [
    "Fate",
    "Import",
    "ImportReport",
    "Item",
    "import_catalogue",
    "import_folder",
    "report_of",
    "write_import",
]

SKIPPED_FOLDERS: Final = frozenset({".git"})


class Fate(StrEnum):
    """Outcome for one calibration."""

    NEW = "new"
    CHANGED = "changed"
    SAME = "same"
    LEFT = "left"
    FAILED = "failed"


class Item(Record):
    """One calibration of an import.

    Attributes:
        source: file name relative to the folder, or the title in the catalogue.
        fate: outcome.
        entry: id of the entry, if known.
        reason: why it was not imported, or a remark.
    """

    source: str
    fate: Fate
    entry: str | None = None
    reason: str | None = None


class ImportReport(Record, tag_field="schema", tag="calibrary/registry-import-1"):
    """Output of ``calibrary registry import --json``.

    Attributes:
        commit: the written commit; None if nothing was written.
        due: number of entries that were written, or would be.
        items: all calibrations found.
        findings: of the registry check.
    """

    commit: ObjectId | None
    due: Annotated[int, Meta(ge=0)]
    items: tuple[Item, ...]
    findings: tuple[Finding, ...]


class Import(Struct, frozen=True, kw_only=True):
    """A prepared import.

    Attributes:
        what: description of the import for the history.
        items: all calibrations found.
        due: the entries to write, all of which pass the check.
        proposals: all proposed entries, with the findings of the check.
    """

    what: str
    items: tuple[Item, ...]
    due: Proposals
    proposals: Proposals

    def count(self, fate: Fate) -> int:
        """Number of calibrations with this outcome."""
        return sum(item.fate is fate for item in self.items)


def import_folder(
    registry: Registry,
    folder: Path,
    reading: Reading,
    request: AddRequest,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Import:
    """Prepare the import of all calibration files in a folder.

    Args:
        registry: to import to.
        folder: read with all sub-folders; links to folders are not followed, and images are skipped, because a
            folder of images is a flight, not a set of calibrations.
        reading: what the files do not state.
        request: the user's statements on all of them.
        progress: called with the number of files done and the total.

    Raises:
        RegistryError: the folder cannot be read.
    """
    files = list(_files(folder))
    items: list[Item] = []
    due: dict[str, tuple[Proposal, str]] = {}
    for at, path in enumerate(files, start=1):
        source = path.relative_to(folder).as_posix()
        for item, proposal in _of_file(registry, path, source, reading, request):
            items.append(item if proposal is None else _taken_in(due, item, proposal))
        if progress is not None:
            progress(at, len(files))
    name = folder.resolve().name or "a folder"
    proposed = [proposal for proposal, _ in due.values()]
    return _judged(registry.snapshot(), f"the calibrations of {name}", items, proposed)


def import_catalogue(registry: Registry) -> Import:
    """Prepare the import of all cameras of the built-in catalogue for which K can be derived, as drafts.

    An earlier entry from the catalogue that is still a draft is updated; any other entry stays unchanged.
    """
    entries, left = catalogue_entries()
    snapshot = registry.snapshot()
    items = [Item(source=camera.title, fate=Fate.LEFT, reason=camera.reason) for camera in left]
    due = []
    for entry in entries:
        beside = proposal_path(entry.path)
        # A draft that an older version wrote to cameras/ is updated there.
        path = entry.path if entry.path in snapshot.paths and beside not in snapshot.proposed else beside
        there = (snapshot.proposed if path == beside else snapshot.paths).get(path)
        current = _readable(snapshot, path) if there is not None else None
        fate, reason = _fate(entry, current) if there is not None else (Fate.NEW, None)
        source = entry.calibration.provenance.tag or entry.id
        items.append(Item(source=source, fate=fate, entry=entry.id, reason=reason))
        if fate in {Fate.NEW, Fate.CHANGED}:
            due.append(proposal_of(entry, current, there, path=path))
    return _judged(snapshot, "the catalogue of known cameras", items, due)


def write_import(registry: Registry, found: Import, *, reason: str | None = None) -> Written | None:
    """Write the import as one commit; returns None if there is nothing to write.

    Raises:
        FileConflictError: an entry has changed in the meantime; nothing was written.
        RegistryError: the registry cannot be written, or an approved K would change by more than the policy's
            limits and no reason is given.
    """
    count = len(found.due.items)
    if not count:
        return None
    require_reason(found.proposals, reason)
    whose = "entry" if count == 1 else "entries"
    return save(registry, found.due, subject=f"Import {found.what}: {count} {whose}", reason=reason)


def report_of(found: Import, commit: str | None) -> ImportReport:
    """Make the report of an import and its commit."""
    return ImportReport(
        commit=commit,
        due=len(found.due.items),
        items=found.items,
        findings=found.proposals.findings,
    )


def _files(folder: Path) -> Iterator[Path]:
    if not folder.is_dir():
        raise RegistryError(
            f"{folder}: no such folder; expected one with calibration files, or the word 'catalogue'; 'calibrary "
            "registry add' takes a single file"
        )

    def refuse(error: OSError) -> None:
        raise RegistryError(f"{error.filename}: cannot be read: {error.strerror}") from None

    for here, folders, names in os.walk(folder, onerror=refuse):
        folders[:] = sorted(name for name in folders if name not in SKIPPED_FOLDERS)
        for name in sorted(names):
            path = Path(here, name)
            if not name.startswith(".") and path.is_file() and not parsers.is_image_file(path):
                yield path


def _of_file(
    registry: Registry, path: Path, source: str, reading: Reading, request: AddRequest
) -> Iterator[tuple[Item, Proposal | None]]:
    try:
        proposals = propose_file(registry, path, reading, request)
    except CalibraryError as error:
        log.info("not imported: %s", error)
        failure = str(error).removeprefix(f"{path.name}: ").removeprefix(f"{path}: ")
        yield Item(source=source, fate=Fate.FAILED, reason=failure), None
        return
    for proposal in proposals.items:
        fate = Fate.SAME if not proposal.changes else Fate.NEW if proposal.is_new else Fate.CHANGED
        reason = "; ".join((*_moved(proposal), *proposal.warnings)) or None
        yield Item(source=source, fate=fate, entry=proposal.entry.id, reason=reason), proposal


def _moved(proposal: Proposal) -> Iterator[str]:
    """Describe how far K moved: the word "changed" alone is no basis for a decision."""
    if proposal.current is not None and proposal.changes:
        before, after = (one.calibration.intrinsics for one in (proposal.current, proposal.entry))
        if before != after:
            yield f"fx {before.fx:.6g} → {after.fx:.6g} px ({after.fx / before.fx - 1.0:+.2%})"


def _taken_in(due: dict[str, tuple[Proposal, str]], item: Item, proposal: Proposal) -> Item:
    """Add a proposal to ``due``; a second file of the same camera is ignored if equal and fails if different."""
    if item.fate is Fate.SAME:
        return item
    first, source = due.setdefault(proposal.entry.path, (proposal, item.source))
    if first is proposal:
        return item
    if _numbers(first.entry) == _numbers(proposal.entry):
        return replace(item, fate=Fate.SAME, reason=f"the same numbers as in {source}")
    reason = (
        f"{source} has other numbers for the same camera; add the right one with 'calibrary registry add', or "
        "distinguish the two cameras with --lens, --sub-camera or --serial"
    )
    return replace(item, fate=Fate.FAILED, reason=reason)


def _readable(snapshot: Snapshot, path: str) -> Entry | None:
    try:
        return parse_entry(snapshot.read(path), path)
    except CalibraryError:
        return None


def _fate(entry: Entry, current: Entry | None) -> tuple[Fate, str | None]:
    if current is None:
        return Fate.LEFT, "the current entry cannot be read: 'calibrary registry check' gives the reason"
    made = current.calibration.provenance
    if made.kind != KIND:
        grade = current.calibration.grade.value
        return Fate.LEFT, f"there is already an entry of grade {grade}, {made.kind}"
    if _said(entry) == _said(current):
        return Fate.SAME, None
    if current.status is not Status.DRAFT:
        return Fate.LEFT, f"it is {current.status.value}; the catalogue has changed since"
    return Fate.CHANGED, None


def _numbers(entry: Entry) -> str:
    return digest(entry.calibration, entry.sensor, entry.rig)


def _said(entry: Entry) -> tuple[object, ...]:
    """The parts of an entry that come from the catalogue, independent of the program version that wrote it."""
    return _numbers(entry), entry.aliases, entry.tolerance, entry.notes


def _judged(snapshot: Snapshot, what: str, items: Sequence[Item], proposed: Sequence[Proposal]) -> Import:
    """Make the import without the entries that fail a check, so that one bad file does not block the others."""
    proposals = with_material_changes(checked(snapshot, proposed), snapshot.configuration.policy)
    errors: dict[str, str] = {}
    for finding in proposals.findings:
        if finding.severity is Severity.ERROR:
            errors.setdefault(finding.place or "", finding.message)
    bad = {one.entry.id: errors[one.path] for one in proposed if one.path in errors}
    return Import(
        what=what,
        items=tuple(
            replace(item, fate=Fate.FAILED, reason=bad[item.entry])
            if item.entry in bad and item.fate in {Fate.NEW, Fate.CHANGED}
            else item
            for item in items
        ),
        due=Proposals(items=tuple(one for one in proposed if one.path not in errors)),
        proposals=proposals,
    )
