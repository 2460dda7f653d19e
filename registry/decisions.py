"""Approving, holding and retiring of entries: changes of the status, proposed and checked like new entries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from calibrary.errors import RegistryError
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status, Validity
from calibrary.registry.fields import differences
from calibrary.registry.paths import in_use_path
from calibrary.registry.proposals import Proposal, Proposals, proposal_of, require_not_held
from calibrary.registry.proposing import CurrentFiles, checked
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.stored import StoredEntry

__all__ = ["approving", "of_current"]

VERBS: Final[Mapping[Status, str]] = {
    Status.APPROVED: "Approve",
    Status.HELD: "Hold",
    Status.RETIRED: "Retire",
}


def of_current(
    snapshot: Snapshot, keys: Sequence[str], status: Status, reason: str | None, successor: str | None = None
) -> Proposals:
    """Propose to hold or retire current entries; arguments and errors as for ``Registry.propose_status``."""
    stored = {one.path: one for one in (_current(snapshot, key) for key in keys)}
    items = []
    for one in stored.values():
        if not one.is_pending:
            items.append(_changed(one, _with_status(one.entry, status, reason)))
        elif status is Status.RETIRED:
            items.append(_withdrawn(one, reason))
        else:
            raise RegistryError(
                f"{one.id} is only proposed, and only what is approved can be {status.value}: 'calibrary registry "
                f"approve {one.id}' comes first"
            )
    if successor is not None:
        items.append(_succeeding(_current(snapshot, successor), [*stored.values()]))
    return checked(snapshot, items, VERBS[status])


def approving(
    snapshot: Snapshot,
    source: Snapshot,
    keys: Sequence[str],
    reason: str | None,
    *,
    validity: Validity | None = None,
    force: str | None = None,
) -> Proposals:
    """Propose to approve proposals.

    Args:
        snapshot: state of the branch where the entries become usable.
        source: state of the branch with the proposals; the same, or another branch.
        keys: keys of the proposals.
        reason: reason for the approval.
        validity: days of validity, instead of those in the proposal.
        force: reason for accepting a K that contradicts known facts about its camera.

    Raises:
        UnknownCameraError: a proposal or entry does not exist.
        RegistryError: a key is ambiguous or contains a revision, or the current entry is held.
    """
    items: dict[str, Proposal] = {}
    for key in keys:
        _refuse_revision(key)
        proposed = source.pending(key)
        here = CurrentFiles.of(snapshot, in_use_path(proposed.path))
        if proposed.is_pending:
            require_not_held(here.current)
        entry = _with_status(proposed.entry, Status.APPROVED, reason)
        if validity is not None:
            entry = replace(entry, validity=validity)
        if proposed.is_pending and here.current is not None:
            # Labels and tags set since the proposal are kept: the approval does not cover them.
            entry = replace(
                entry, label=here.current.label or entry.label, tags=here.current.tags or entry.tags
            )
        is_here = here.proposed_oid is not None and here.proposed_oid == proposed.oid
        if proposed.is_pending and here.current is not None and entry.reason is None:
            same = replace(entry, reason=here.current.reason) == here.current
            entry = here.current if same else entry
        gone = ((proposed.path, here.proposed_oid),) if is_here and here.proposed_oid is not None else ()
        # Without a usable entry, the proposal is compared with itself: only the status changes.
        before = here.current if here.current is not None else proposed.entry if is_here else None
        proposal = _warned(proposal_of(entry, before, here.oid, replaced=gone))
        items[entry.path] = replace(proposal, approves=proposed.oid) if proposed.is_pending else proposal
    return checked(snapshot, [*items.values()], VERBS[Status.APPROVED], force=force)


def _withdrawn(stored: StoredEntry, reason: str | None) -> Proposal:
    """Remove a rejected proposal; it remains in the history."""
    entry = replace(stored.entry, status=Status.RETIRED, reason=reason)
    return Proposal(
        entry=entry,
        path=stored.path,
        data=None,
        current=stored.entry,
        base=stored.oid,
        changes=differences(stored.entry, entry),
    )


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
    return _warned(proposal_of(entry, stored.entry, stored.oid, path=stored.path))


def _warned(one: Proposal) -> Proposal:
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
