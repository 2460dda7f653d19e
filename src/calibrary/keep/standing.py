"""Whether an entry is used: approved, held and retired, several at a time as one commit, or none of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calibrary.errors import RegistryError
from calibrary.keep.admission import objections
from calibrary.keep.fields import FieldChange, differences
from calibrary.keep.keeper import Held, Keeper, note_of
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status
from calibrary.registry.git.writing import Written
from calibrary.validation import Finding

__all__ = ["Decision", "decide", "decide_from", "write_decisions"]

VERBS = {Status.APPROVED: "Approve", Status.HELD: "Hold", Status.RETIRED: "Retire"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """One entry before and after.

    Attributes:
        held: as it stands, or as it is proposed on the branch it is approved from.
        standing: what the entry takes the place of; None where it is new.
        base: the content's id of that; a write holds only while it still stands.
        entry: as it is to be.
        changes: field by field; nothing where it has this status already.
    """

    held: Held
    standing: Entry | None
    base: str | None
    entry: Entry
    changes: tuple[FieldChange, ...]


def decide(
    keeper: Keeper, keys: Sequence[str], status: Status, reason: str | None, successor: str | None = None
) -> tuple[tuple[Decision, ...], tuple[Finding, ...]]:
    """What giving entries a status would change, and what the registry's check says of it.

    Args:
        keeper: of the registry.
        keys: of the entries, without a revision.
        status: that they shall have.
        reason: why.
        successor: KEY of the entry that takes the place of a retired one; it will say so.

    Raises:
        UnknownCameraError: there is no such entry.
        RegistryError: a key means several, names a revision, or the successor supersedes another already.
    """
    held = {one.path: one for one in (_now(keeper, key) for key in keys)}
    decisions = [_decision(one, _with_status(one.entry, status, reason)) for one in held.values()]
    if successor is not None:
        decisions.append(_succeeding(_now(keeper, successor), [*held.values()]))
    entries = [decision.entry for decision in decisions if decision.changes]
    return tuple(decisions), objections(keeper, entries) if entries else ()


def decide_from(
    keeper: Keeper, keys: Sequence[str], branch: str, status: Status, reason: str | None
) -> tuple[tuple[Decision, ...], tuple[Finding, ...]]:
    """The same of entries that are proposed on another branch: they come from there, and are put to use here.

    Args:
        keeper: of the registry.
        keys: of the entries, without a revision.
        branch: on which they are.
        status: that they shall have.
        reason: why.

    Raises:
        UnknownCameraError: there is no such entry on the branch.
        RegistryError: there is no such branch, a key means several, or a person pinned what stands here.
    """
    decisions = []
    for key in dict.fromkeys(keys):
        _refuse_revision(key)
        proposed = keeper.get(f"{key}@{branch}")
        here = keeper.at(proposed.path)
        standing = here.entry if here is not None else None
        if standing is not None and standing.status is Status.HELD:
            why = f" ({standing.reason})" if standing.reason else ""
            raise RegistryError(f"{proposed.id} is held{why}: a person pinned it; nothing was written")
        entry = _with_status(proposed.entry, status, reason)
        if standing is not None and replace(entry, reason=standing.reason) == standing and reason is None:
            entry = standing
        decisions.append(
            Decision(
                held=proposed,
                standing=standing,
                base=here.oid if here is not None else None,
                entry=entry,
                changes=differences(standing, entry),
            )
        )
    entries = [decision.entry for decision in decisions if decision.changes]
    return tuple(decisions), objections(keeper, entries) if entries else ()


def write_decisions(
    keeper: Keeper, decisions: Sequence[Decision], status: Status, reason: str | None
) -> Written:
    """Write them as one commit.

    Raises:
        FileConflictError: somebody has changed one since it was read; nothing was written.
        RegistryError: they cannot be written.
    """
    due = [decision for decision in decisions if decision.changes]
    concerned = [one.entry for one in due if one.entry.status is not one.held.entry.status] or [
        one.entry for one in due
    ]
    named = concerned[0].id if len(concerned) == 1 else f"{len(concerned)} cameras"
    note = note_of(f"{VERBS[status]} {named}", [one.entry for one in due], reason)
    return keeper.save([(one.entry, one.base) for one in due], note)


def _now(keeper: Keeper, key: str) -> Held:
    _refuse_revision(key)
    return keeper.get(key)


def _refuse_revision(key: str) -> None:
    if "@" in key:
        raise RegistryError(f"{key}: what it was cannot be changed; name the entry without @REV")


def _with_status(entry: Entry, status: Status, reason: str | None) -> Entry:
    if entry.status is status and reason is None:
        return entry
    return replace(entry, status=status, reason=reason)


def _decision(held: Held, entry: Entry) -> Decision:
    return Decision(
        held=held,
        standing=held.entry,
        base=held.oid,
        entry=entry,
        changes=differences(held.entry, entry),
    )


def _succeeding(successor: Held, retired: Sequence[Held]) -> Decision:
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
    return _decision(successor, replace(successor.entry, supersedes=old.id))
