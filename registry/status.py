"""Whether entries are used: approved, held and retired, several at a time as one commit, or none of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from calibrary.errors import RegistryError
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status
from calibrary.registry.proposals import Proposal, Proposals, checked, proposal_of, require_not_held
from calibrary.registry.snapshot import Snapshot, StoredEntry

__all__ = ["from_branch", "of_current"]

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
        raise RegistryError(f"{key}: what it was cannot be changed; name the entry without @REV")


def _with_status(entry: Entry, status: Status, reason: str | None) -> Entry:
    if entry.status is status and reason is None:
        return entry
    return replace(entry, status=status, reason=reason)


def _changed(stored: StoredEntry, entry: Entry) -> Proposal:
    return _told(proposal_of(entry, stored.entry, stored.oid))


def _told(one: Proposal) -> Proposal:
    return one if one.changes else replace(one, warnings=(f"it is {one.entry.status.value} already",))


def _succeeding(successor: StoredEntry, retired: Sequence[StoredEntry]) -> Proposal:
    if len(retired) != 1:
        raise RegistryError(
            f"one entry supersedes one other, and {len(retired)} are to be retired; retire them singly"
        )
    [old] = retired
    if successor.path == old.path:
        raise RegistryError(f"{old.id}: an entry does not supersede itself")
    if successor.entry.supersedes not in {None, old.id}:
        raise RegistryError(
            f"{successor.id} supersedes {successor.entry.supersedes} already; put that right first in its file, by "
            "'calibrary registry add FILE'"
        )
    return _changed(successor, replace(successor.entry, supersedes=old.id))
