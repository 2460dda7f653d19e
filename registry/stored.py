"""An entry as stored at one state of a registry, and its form in a listing."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from msgspec import Struct

from calibrary.errors import RegistryError
from calibrary.records import Json, Meta, Record
from calibrary.registry.approvals import Standing
from calibrary.registry.entry import Entry, EntryFields, Status
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.paths import id_of, in_use_path, is_proposal
from calibrary.registry.resolution import is_keyed

__all__ = ["ListedEntries", "ListedEntry", "StoredEntry", "require_own_path"]


class StoredEntry(Struct, frozen=True, kw_only=True):
    """An entry as stored at one state of a registry.

    Attributes:
        entry: content of the file.
        path: path of the file.
        oid: blob id of the content; None in a plain folder.
        base: blob id of the file in the tree, the base for a change; it differs where something else is in force.
        commit: commit it was read from, 40 hexadecimal digits; None in a plain folder.
        proposal: path of the proposal to replace it; None if there is none, or it was not looked up.
        standing: what the statements say of it; None for a proposal, and in a registry without statements.
    """

    entry: Entry
    path: str
    oid: str | None
    commit: str | None
    proposal: str | None = None
    base: str | None = None
    standing: Standing | None = None

    @property
    def id(self) -> str:
        """Longest KEY of the entry."""
        return id_of(self.path)

    @property
    def is_pending(self) -> bool:
        """Whether it needs approval: a proposal or, in older registries, a draft."""
        return is_proposal(self.path) or self.entry.status is Status.DRAFT

    @property
    def members(self) -> dict[str, Any]:
        """Members of a listed entry, by name."""
        stated = {name: getattr(self.entry, name) for name in EntryFields.__struct_fields__}
        place = {"id": self.id, "path": self.path, "commit": self.commit, "blob": self.oid}
        remark = self.standing.remark if self.standing is not None else None
        return {**place, "proposal": self.proposal, "remark": remark, **stated}


class ListedEntry(EntryFields):
    """An entry as stored at a commit, with its calibration in the common printed form.

    Attributes:
        id: longest KEY of the entry.
        path: path of its file.
        commit: commit it was read from; None in a plain folder.
        blob: git's id of the file, which an approval refers to; None in a plain folder.
        proposal: path of the proposal to replace it; None if there is none.
        remark: what its file says that is not in force; None if nothing.
    """

    id: str
    path: Annotated[str, Meta(pattern="^(cameras|proposals)/.+[.]yaml$")]
    commit: ObjectId | None
    blob: ObjectId | None
    proposal: str | None = None
    remark: str | None = None

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        """Put the identification first, since a calibration is long."""
        return {name: document.pop(name) for name in ListedEntry.__annotations__} | document


class ListedEntries(Record, tag_field="schema", tag="calibrary/entry-listing-1"):
    """Output of ``calibrary registry list --json``.

    Attributes:
        entries: entries, by path.
    """

    entries: tuple[ListedEntry, ...]

    @classmethod
    def of(cls, stored: Iterable[StoredEntry]) -> ListedEntries:
        """Make the listing of stored entries."""
        return cls(entries=tuple(ListedEntry(**one.members) for one in stored))


def require_own_path(stored: StoredEntry) -> StoredEntry:
    """Return the entry, if its path is that of its camera.

    Raises:
        RegistryError: the file is at the path of another camera.
    """
    if stored.entry.path != in_use_path(stored.path) and is_keyed(in_use_path(stored.path)):
        raise RegistryError(
            f"{stored.path}: its camera belongs at {stored.entry.path}, so this is not the K of {stored.id}; "
            f"'calibrary registry log {stored.id}' shows who wrote it"
        )
    return stored
