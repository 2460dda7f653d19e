"""Proposals: entries to write, with their changes, and the findings that prevent writing."""

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
"""Fields that do not affect which K is used; for the reason see :mod:`calibrary.registry.approvals`."""


class Proposal(Struct, frozen=True, kw_only=True):
    """An entry to write.

    Attributes:
        entry: the proposed entry.
        path: path of the file: in ``proposals/`` if it needs approval, in ``cameras/`` if it is used.
        data: content of the file; None if a proposal is withdrawn.
        current: entry that it replaces; None if there is none, or it cannot be read.
        base: blob id of the file at its path; the write fails with FileConflictError if it has changed.
        changes: changed fields; all fields of a new entry, none if nothing changes.
        warnings: warnings for the user.
        approves: blob id of the proposal that is approved; None if there is none.
        replaced: path and blob id of files removed by the same commit: the approved proposal, or a draft that an older
            version wrote to ``cameras/``.
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
        """Whether this camera has neither an entry nor a proposal."""
        return self.base is None and self.current is None and not self.replaced

    @property
    def digest(self) -> str | None:
        """Id of the file in git, for ``approve --digest``; None if the proposal is withdrawn."""
        return blob_id(self.data) if self.data else None

    @property
    def file_changes(self) -> tuple[Change, ...]:
        """Changes of files to write."""
        gone = (Change(path=path, data=None, base=oid) for path, oid in self.replaced)
        return (Change(path=self.path, data=self.data, base=self.base), *gone)


class Proposals(Struct, frozen=True, kw_only=True):
    """Entries that are proposed together, with the findings of the check.

    Attributes:
        items: all proposals, also those without changes.
        findings: findings of the check on everything to be written.
        verb: first word of the commit's subject, "Approve"; None for adding and updating.
    """

    items: tuple[Proposal, ...]
    findings: tuple[Finding, ...] = ()
    verb: str | None = None

    @property
    def due(self) -> tuple[Proposal, ...]:
        """Proposals with changes."""
        return tuple(one for one in self.items if one.changes)

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Findings that prevent writing."""
        return tuple(finding for finding in self.findings if finding.severity is Severity.ERROR)

    @property
    def subject(self) -> str:
        """Subject of the commit."""
        due = self.due
        verb, ending = self.verb, ""
        if verb is None:
            approved = all(one.entry.status is Status.APPROVED for one in due)
            verb = "Add" if all(one.is_new for one in due) else "Update" if approved else "Propose"
            ending = ", approved" if approved else ""
        else:
            # An entry that only states its successor is not the subject of the commit.
            about = [one for one in due if one.current is None or one.entry.status is not one.current.status]
            due = tuple(about) or due
        named = due[0].entry.id if len(due) == 1 else f"{len(due)} cameras"
        return f"{verb} {named}{ending}"


class ChangedEntry(Record):
    """A written entry.

    Attributes:
        id: longest KEY of the entry.
        path: path of its file; in proposals/ if it needs approval.
        digest: git's id of the file, which an approval refers to; None if nothing is written.
        status: new status.
        status_before: status of the entry that it replaces; None for a new one, or one that could not be read.
        changes: changed fields; none if nothing changes.
        warnings: warnings for the user.
    """

    id: str
    path: str
    digest: ObjectId | None
    status: Status
    status_before: Status | None
    changes: tuple[FieldChange, ...]
    warnings: tuple[str, ...]


class ChangeReport(Record, tag_field="schema", tag="calibrary/registry-change-1"):
    """Output of ``calibrary registry add``, ``approve``, ``hold`` and ``retire`` with ``--json``.

    Attributes:
        registry: folder of the registry.
        commit: commit with the changes; None if nothing was written.
        entries: all named entries.
        findings: findings of the check on everything to be written.
        warnings: warnings about the commit.
    """

    registry: str
    commit: ObjectId | None
    entries: tuple[ChangedEntry, ...]
    findings: tuple[Finding, ...]
    warnings: tuple[str, ...]


def change_report(place: Path, proposals: Proposals, written: Written | None) -> ChangeReport:
    """Return the report of what was written, or would be."""
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
    """Check that the approved proposals are those that were reviewed.

    Args:
        proposals: proposals to approve.
        digests: git's ids of the proposals' files, or their beginnings.

    Raises:
        RegistryError: a proposal matches no digest, or a digest matches no proposal.
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
    """Return a proposal with its changes; ``path`` defaults to the entry's own path."""
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
    """Return whether only fields change that an approval does not cover."""
    return {change.name for change in one.changes} <= NOT_APPROVED


def differs_in_status_only(one: Proposal) -> bool:
    """Return whether only the status and its reason change."""
    return {change.name for change in one.changes} <= {"status", "reason"}


def require_not_held(current: Entry | None, remedy: str = "") -> None:
    """Check that an entry may be replaced.

    Raises:
        RegistryError: the entry is held.
    """
    if current is not None and current.status is Status.HELD:
        why = f" ({current.reason})" if current.reason else ""
        raise RegistryError(f"{current.id} is held{why}: nothing was written{remedy}")
