"""Proposing entries, and changes of their status: each beside the current one, checked, and only then written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from calibrary.calibration import Provenance
from calibrary.errors import InputError, RegistryError
from calibrary.records import Record, replace
from calibrary.registry.check import check
from calibrary.registry.entry import Entry, Status
from calibrary.registry.entry_form import digest
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from calibrary.registry.fields import FieldChange, differences
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.writing import Written
from calibrary.registry.paths import ROOT, SUFFIX, folder_of
from calibrary.registry.snapshot import Snapshot, StoredEntry
from calibrary.validation import Finding, Severity

__all__ = [
    "ChangeReport",
    "Proposal",
    "Proposals",
    "change_report",
    "checked",
    "from_branch",
    "of_current",
    "proposal_of",
    "propose",
    "require_not_held",
]

BY_HAND: Final = "numbers changed by hand"
BY_FLAGS: Final = ("tool", "date", "operator", "firmware", "focus")
"""What a flag can say of a calibration that its file does not."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """One entry as it would be written.

    Attributes:
        entry: the proposed entry.
        data: its file.
        current: the entry at its path now, None for none or one that cannot be read.
        base: blob id of the current entry; the write fails with FileConflictError if it has changed.
        changes: field by field; everything of a new entry, nothing where all is there already.
        warnings: what a person should know before agreeing.
    """

    entry: Entry
    data: bytes
    current: Entry | None
    base: str | None
    changes: tuple[FieldChange, ...]
    warnings: tuple[str, ...] = ()

    @property
    def is_new(self) -> bool:
        """Whether there is nothing at its path yet."""
        return self.base is None


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposals:
    """Entries that are proposed together, and what the check says of them.

    Attributes:
        items: every one, also those that change nothing.
        findings: of the check, over all that would be written.
        verb: what the commit does, "Approve"; None for adding and updating.
    """

    items: tuple[Proposal, ...]
    findings: tuple[Finding, ...] = ()
    verb: str | None = None

    @property
    def due(self) -> tuple[Proposal, ...]:
        """Those that change something."""
        return tuple(one for one in self.items if one.changes)

    @property
    def errors(self) -> tuple[Finding, ...]:
        """The findings that keep the entries from being written."""
        return tuple(finding for finding in self.findings if finding.severity is Severity.ERROR)

    @property
    def subject(self) -> str:
        """The commit's first line."""
        due = self.due
        verb, ending = self.verb, ""
        if verb is None:
            verb = "Add" if all(one.is_new for one in due) else "Update"
            ending = ", approved" if all(one.entry.status is Status.APPROVED for one in due) else ""
        else:
            # An entry that only names its successor is not what the commit is about.
            about = [one for one in due if one.current is None or one.entry.status is not one.current.status]
            due = tuple(about) or due
        named = due[0].entry.id if len(due) == 1 else f"{len(due)} cameras"
        return f"{verb} {named}{ending}"


class ChangedEntry(Record):
    """An entry that is written.

    Attributes:
        id: the longest KEY.
        path: of its file.
        status: as it is written.
        status_before: None for a new one, or one that could not be read.
        changes: field by field; none where all is there already.
        warnings: what a person should know before agreeing.
    """

    id: str
    path: str
    status: Status
    status_before: Status | None
    changes: tuple[FieldChange, ...]
    warnings: tuple[str, ...]


class ChangeReport(Record, tag_field="schema", tag="calibrary/registry-change-1"):
    """What calibrary registry add, approve, hold and retire print with --json.

    Attributes:
        registry: its folder.
        commit: that holds the changes; None where nothing was written.
        entries: every one that was named.
        findings: of the check, over all that would be written.
        warnings: what a person should know of the commit.
    """

    registry: str
    commit: ObjectId | None
    entries: tuple[ChangedEntry, ...]
    findings: tuple[Finding, ...]
    warnings: tuple[str, ...]


def change_report(place: Path, proposals: Proposals, written: Written | None) -> ChangeReport:
    """What was written, or would have been."""
    return ChangeReport(
        registry=str(place),
        commit=written.commit if written is not None else None,
        entries=tuple(
            ChangedEntry(
                id=one.entry.id,
                path=one.entry.path,
                status=one.entry.status,
                status_before=one.current.status if one.current is not None else None,
                changes=one.changes,
                warnings=one.warnings,
            )
            for one in proposals.items
        ),
        findings=proposals.findings,
        warnings=written.warnings if written is not None else (),
    )


def propose(
    snapshot: Snapshot,
    entries: Sequence[Entry],
    *,
    approve: bool = False,
    reason: str | None = None,
    override_held: bool = False,
    edited: bool = False,
) -> Proposals:
    """Entries beside the current ones, checked; nothing is written.

    Args:
        snapshot: the newest of the registry.
        entries: as their source and the user state them; their status is set here.
        approve: use them at once; otherwise they are drafts.
        reason: why they are approved.
        override_held: replace entries that are held.
        edited: whether they are current entries that a person has edited.

    Raises:
        InputError: two of the entries have the same path.
        RegistryError: a current entry is held and ``override_held`` is false.
    """
    seen: set[str] = set()
    items = []
    for entry in entries:
        if entry.path in seen:
            raise InputError(
                f"several of the cameras would all be {entry.id}; distinguish them by sub-camera, lens or serial"
            )
        seen.add(entry.path)
        items.append(_proposal(snapshot, entry, approve, reason, override_held=override_held, edited=edited))
    return checked(snapshot, items)


def checked(snapshot: Snapshot, items: Sequence[Proposal], verb: str | None = None) -> Proposals:
    """Proposals with the findings of :func:`calibrary.registry.check.check` on all that would be written.

    Only the entries that they can affect are read: those of their models, of their aliases, and those they
    supersede; what was wrong with others before is left to ``calibrary registry check``.
    """
    due = [one for one in items if one.changes]
    if not due:
        return Proposals(items=tuple(items), verb=verb)
    policy = snapshot.configuration.policy
    before = {path: snapshot.read(path) for path in _concerned(snapshot.paths, [one.entry for one in due])}
    own = {one.entry.path: one.data for one in due}
    known = set(check(before, policy).findings) if before else set()
    found = check({**before, **own}, policy).findings
    findings = tuple(finding for finding in found if finding.place in own or finding not in known)
    return Proposals(items=tuple(items), findings=findings, verb=verb)


def proposal_of(
    entry: Entry, current: Entry | None, base: str | None, warnings: Iterable[str] = ()
) -> Proposal:
    """A proposal with the changes that it makes."""
    changes = differences(current, entry)
    data = entry_yaml(entry) if changes else b""
    return Proposal(
        entry=entry, data=data, current=current, base=base, changes=changes, warnings=tuple(warnings)
    )


def require_not_held(current: Entry | None, remedy: str = "") -> None:
    """Make sure that an entry may be replaced.

    Raises:
        RegistryError: it is held.
    """
    if current is not None and current.status is Status.HELD:
        why = f" ({current.reason})" if current.reason else ""
        raise RegistryError(f"{current.id} is held{why}: nothing was written{remedy}")


def _concerned(paths: Iterable[str], entries: Sequence[Entry]) -> Iterator[str]:
    whole, folders = set(), set()
    for entry in entries:
        camera = entry.calibration.camera
        folders.add(folder_of(camera.make or "", camera.model or ""))
        # Beside a unit's own folder lie those of thousands of others, which it never meets.
        folders.add(entry.path.rpartition("/")[0] + "/")
        folders.update(folder_of(alias.make, alias.model) for alias in entry.aliases)
        if entry.supersedes is not None:
            whole.add(f"{ROOT}{entry.supersedes}{SUFFIX}")
    for path in paths:
        if path in whole or path.rpartition("/")[0] + "/" in folders:
            yield path


def _proposal(
    snapshot: Snapshot,
    entry: Entry,
    approve: bool,  # noqa: FBT001  passed through from propose()
    reason: str | None,
    *,
    override_held: bool,
    edited: bool,
) -> Proposal:
    base, warnings, current = snapshot.paths.get(entry.path), [], None
    if base is not None:
        try:
            current = parse_entry(snapshot.read(entry.path), entry.path)
        except InputError as error:
            warnings.append(f"the current entry cannot be read and is replaced: {error}")
    if not override_held:
        require_not_held(current, ". --override-held replaces it")
    if current is not None:
        entry = _with_current(entry, current, edited=edited)
        unchanged = replace(entry, status=current.status, reason=current.reason)
        if not differences(current, unchanged) and (not approve or current.is_usable):
            return proposal_of(current, current, base, warnings)
    status, why = (Status.APPROVED, reason) if approve else (Status.DRAFT, None)
    if entry.status is not status or entry.reason != why:
        entry = replace(entry, status=status, reason=why)
    if current is not None and current.is_usable and not approve:
        warnings.append(
            f"it is {current.status.value} now and becomes a draft, so this camera has no usable K until it is "
            "approved; --approve approves it at once"
        )
    return proposal_of(entry, current, base, warnings)


def _with_current(entry: Entry, current: Entry, *, edited: bool) -> Entry:
    """The entry with what the registry knows of its camera and no calibration file states."""
    extensions = {
        name: value
        for name, value in current.extensions.items()
        if name.startswith(("x-", "camera/")) or (name.startswith("sensor/") and entry.sensor is None)
    }
    made = _provenance(entry, current, edited=edited)
    return replace(
        entry,
        calibration=replace(entry.calibration, provenance=made),
        aliases=entry.aliases or current.aliases,
        sensor=entry.sensor or current.sensor,
        tolerance=entry.tolerance if entry.tolerance is not None else current.tolerance,
        supersedes=entry.supersedes or current.supersedes,
        extensions={**extensions, **entry.extensions},
    )


def _provenance(entry: Entry, current: Entry, *, edited: bool) -> Provenance:
    made, before = entry.calibration.provenance, current.calibration.provenance
    if edited and _source(made) == _source(before):
        if digest(entry.calibration, entry.sensor) == digest(current.calibration, current.sensor):
            return made
        by_hand = (*(text for text in made.assumptions if text != BY_HAND), BY_HAND)
        return replace(made, assumptions=by_hand)
    if made.sha256 is not None and made.sha256 == before.sha256:
        # The same file again: what a flag said of it before still holds.
        return replace(made, **{name: getattr(made, name) or getattr(before, name) for name in BY_FLAGS})
    return made


def _source(made: Provenance) -> tuple[object, ...]:
    return made.kind, made.source, made.sha256, made.sources


VERBS: Final[Mapping[Status, str]] = {
    Status.APPROVED: "Approve",
    Status.HELD: "Hold",
    Status.RETIRED: "Retire",
}


def of_current(
    snapshot: Snapshot, keys: Sequence[str], status: Status, reason: str | None, successor: str | None = None
) -> Proposals:
    """Current entries with another status; arguments and errors as of ``Registry.propose_status``."""
    stored = {one.path: one for one in (_current(snapshot, key) for key in keys)}
    items = [_changed(one, _with_status(one.entry, status, reason)) for one in stored.values()]
    if successor is not None:
        items.append(_succeeding(_current(snapshot, successor), [*stored.values()]))
    return checked(snapshot, items, VERBS[status])


def from_branch(
    snapshot: Snapshot, branch: Snapshot, keys: Sequence[str], status: Status, reason: str | None
) -> Proposals:
    """Entries that are proposed on another branch, put to use here; otherwise as :func:`of_current`."""
    items = []
    for key in dict.fromkeys(keys):
        _refuse_revision(key)
        proposed = branch.get(key)
        here = snapshot.at(proposed.path)
        current = here.entry if here is not None else None
        require_not_held(current)
        entry = _with_status(proposed.entry, status, reason)
        if current is not None and replace(entry, reason=current.reason) == current and reason is None:
            entry = current
        items.append(_told(proposal_of(entry, current, here.oid if here is not None else None)))
    return checked(snapshot, items, VERBS[status])


def _current(snapshot: Snapshot, key: str) -> StoredEntry:
    _refuse_revision(key)
    return snapshot.get(key)


def _refuse_revision(key: str) -> None:
    if "@" in key:
        raise RegistryError(f"{key}: a past revision cannot be changed; name the entry without @REV")


def _with_status(entry: Entry, status: Status, reason: str | None) -> Entry:
    if entry.status is status and reason is None:
        return entry
    return replace(entry, status=status, reason=reason)


def _changed(stored: StoredEntry, entry: Entry) -> Proposal:
    return _told(proposal_of(entry, stored.entry, stored.oid))


def _told(one: Proposal) -> Proposal:
    return one if one.changes else replace(one, warnings=(f"it is already {one.entry.status.value}",))


def _succeeding(successor: StoredEntry, retired: Sequence[StoredEntry]) -> Proposal:
    if len(retired) != 1:
        raise RegistryError(
            f"an entry supersedes one other entry, found {len(retired)} to retire; retire them one by one"
        )
    [old] = retired
    if successor.path == old.path:
        raise RegistryError(f"{old.id}: an entry does not supersede itself")
    if successor.entry.supersedes not in {None, old.id}:
        raise RegistryError(
            f"{successor.id} supersedes {successor.entry.supersedes} already; correct its file first with "
            "'calibrary registry add FILE'"
        )
    return _changed(successor, replace(successor.entry, supersedes=old.id))
