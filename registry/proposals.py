"""What is proposed: an entry as it would be written, what a change comes to, and what keeps it from being written."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.errors import RegistryError
from calibrary.records import Record
from calibrary.registry.entry import Entry, Status
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.fields import FieldChange, differences
from calibrary.registry.git.objects import ObjectId, blob_id
from calibrary.registry.git.writing import Change, Written
from calibrary.registry.paths import proposal_path
from calibrary.validation import Finding, Severity

__all__ = [
    "ChangeReport",
    "Proposal",
    "Proposals",
    "change_report",
    "differs_in_status_only",
    "needs_no_approval",
    "proposal_of",
    "require_digests",
    "require_not_held",
]

SHORT_DIGEST: Final = re.compile("[0-9a-f]{8,40}")
NOT_APPROVED: Final = frozenset({"label", "tags", "notes"})
"""Fields for people, which decide nothing about which K is used; :mod:`calibrary.registry.approvals` says why."""


class Proposal(Struct, frozen=True, kw_only=True):
    """One entry as it would be written.

    Attributes:
        entry: the proposed entry.
        path: of the file that is written: in ``proposals/`` what waits for approval, in ``cameras/`` what is used.
        data: its file; None where a proposal is withdrawn.
        current: the entry that it is to replace, None for none or one that cannot be read.
        base: blob id of the file at its path; the write fails with FileConflictError if it has changed.
        changes: field by field; everything of a new entry, nothing where all is there already.
        warnings: what a person should know before agreeing.
        approves: blob id of the proposal that is put to use; None where none is.
        replaced: path and blob id of files that go in the same commit: the proposal that is approved, or a draft that
            an older version wrote to ``cameras/``.
    """

    entry: Entry
    path: str
    data: bytes | None
    current: Entry | None
    base: str | None
    changes: tuple[FieldChange, ...]
    warnings: tuple[str, ...] = ()
    replaced: tuple[tuple[str, str], ...] = ()
    approves: str | None = None

    @property
    def is_new(self) -> bool:
        """Whether nothing of this camera is in use or waits."""
        return self.base is None and self.current is None and not self.replaced

    @property
    def digest(self) -> str | None:
        """Of the file, as ``approve --digest`` takes it: git's id of its content."""
        return blob_id(self.data) if self.data else None

    @property
    def file_changes(self) -> tuple[Change, ...]:
        """What becomes of which file."""
        gone = (Change(path=path, data=None, base=oid) for path, oid in self.replaced)
        return (Change(path=self.path, data=self.data, base=self.base), *gone)


class Proposals(Struct, frozen=True, kw_only=True):
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
            approved = all(one.entry.status is Status.APPROVED for one in due)
            verb = "Add" if all(one.is_new for one in due) else "Update" if approved else "Propose"
            ending = ", approved" if approved else ""
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
        path: of its file; in proposals/ where it waits for approval.
        digest: git's id of the file, to which an approval is bound; None where nothing is written.
        status: as it is written.
        status_before: of the entry that it is to replace; None for a new one, or one that could not be read.
        changes: field by field; none where all is there already.
        warnings: what a person should know before agreeing.
    """

    id: str
    path: str
    digest: ObjectId | None
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
                path=one.path,
                digest=one.digest,
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


def require_digests(proposals: Proposals, digests: Sequence[str]) -> None:
    """Make sure that what is approved is what was looked at.

    Args:
        proposals: that would be approved.
        digests: of the proposals' files, git's ids, or how they begin.

    Raises:
        RegistryError: a proposal has none of them, or one is of no proposal.
    """
    left = {text.lower() for text in digests}
    if wrong := next((text for text in sorted(left) if SHORT_DIGEST.fullmatch(text) is None), None):
        raise RegistryError(
            f"{wrong!r:.60} is not a digest: expected at least 8 hexadecimal digits, as 'calibrary registry add' "
            "prints them"
        )
    for one in proposals.due:
        if one.approves is None:
            continue
        of_it = {text for text in left if one.approves.startswith(text)}
        if not of_it:
            raise RegistryError(
                f"{one.entry.id}: nothing was written: what is proposed now has the digest {one.approves[:12]}; look "
                f"at it ('calibrary registry show {proposal_path(one.path)}') and approve that one"
            )
        left -= of_it
    if left:
        raise RegistryError(f"nothing was written: {min(left)} is the digest of none of these proposals")


def proposal_of(
    entry: Entry,
    current: Entry | None,
    base: str | None,
    warnings: Iterable[str] = (),
    *,
    path: str | None = None,
    replaced: tuple[tuple[str, str], ...] = (),
) -> Proposal:
    """A proposal with the changes that it makes; written to the entry's own path unless another is named."""
    changes = differences(current, entry)
    return Proposal(
        entry=entry,
        path=path or entry.path,
        data=entry_yaml(entry) if changes else b"",
        current=current,
        base=base,
        changes=changes,
        warnings=tuple(warnings),
        replaced=replaced,
    )


def needs_no_approval(one: Proposal) -> bool:
    """Whether nothing changes but what an approval is not of."""
    return {change.name for change in one.changes} <= NOT_APPROVED


def differs_in_status_only(one: Proposal) -> bool:
    """Whether nothing changes but whether and why it is used."""
    return {change.name for change in one.changes} <= {"status", "reason"}


def require_not_held(current: Entry | None, remedy: str = "") -> None:
    """Make sure that an entry may be replaced.

    Raises:
        RegistryError: it is held.
    """
    if current is not None and current.status is Status.HELD:
        why = f" ({current.reason})" if current.reason else ""
        raise RegistryError(f"{current.id} is held{why}: nothing was written{remedy}")
