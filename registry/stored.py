"""An entry as it is stored at one state of a registry, and how it is listed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from msgspec import Struct

from calibrary.errors import RegistryError
from calibrary.records import Json, Meta, Record
from calibrary.registry.entry import Entry, EntryFields, Status
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.paths import id_of, in_use_path, is_proposal
from calibrary.registry.resolution import is_keyed

__all__ = ["EntryListing", "ListedEntry", "StoredEntry", "in_its_place"]


class StoredEntry(Struct, frozen=True, kw_only=True):
    """An entry as it is stored at one state of a registry.

    Attributes:
        entry: what the file says.
        path: of the file.
        oid: blob id of the content, from which a change of it starts; None in a plain folder.
        commit: where it was read, 40 hexadecimal digits; None in a plain folder.
        proposal: path of what is proposed to take its place; None where nothing is, or that was not asked.
    """

    entry: Entry
    path: str
    oid: str | None
    commit: str | None
    proposal: str | None = None

    @property
    def id(self) -> str:
        """The entry's longest KEY."""
        return id_of(self.path)

    @property
    def is_pending(self) -> bool:
        """Whether it waits for approval, beside what is in use or, in an older registry, in its place."""
        return is_proposal(self.path) or self.entry.status is Status.DRAFT

    @property
    def members(self) -> dict[str, Any]:
        """The members of a listed entry, by name."""
        stated = {name: getattr(self.entry, name) for name in EntryFields.__struct_fields__}
        place = {"id": self.id, "path": self.path, "commit": self.commit, "blob": self.oid}
        return {**place, "proposal": self.proposal, **stated}


class ListedEntry(EntryFields):
    """An entry as it is stored at a commit, with its calibration in the form that every command prints.

    Attributes:
        id: the longest KEY.
        path: of its file.
        commit: at which it was read; None in a plain folder.
        blob: git's id of the file, to which an approval is bound; None in a plain folder.
        proposal: path of what is proposed to take its place; None where nothing is.
    """

    id: str
    path: Annotated[str, Meta(pattern="^(cameras|proposals)/.+[.]yaml$")]
    commit: ObjectId | None
    blob: ObjectId | None
    proposal: str | None = None

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        """Its place first: a calibration is long."""
        return {name: document.pop(name) for name in ListedEntry.__annotations__} | document


class EntryListing(Record, tag_field="schema", tag="calibrary/entry-listing-1"):
    """What calibrary registry list --json prints.

    Attributes:
        entries: by path.
    """

    entries: tuple[ListedEntry, ...]

    @classmethod
    def of(cls, stored: Iterable[StoredEntry]) -> EntryListing:
        """The listing of stored entries."""
        return cls(entries=tuple(ListedEntry(**one.members) for one in stored))


def in_its_place(stored: StoredEntry) -> StoredEntry:
    """The same, if it lies where its camera belongs.

    Raises:
        RegistryError: the file of one camera lies where another's belongs.
    """
    if stored.entry.path != in_use_path(stored.path) and is_keyed(in_use_path(stored.path)):
        raise RegistryError(
            f"{stored.path}: its camera belongs at {stored.entry.path}, so this is not the K of {stored.id}; "
            f"'calibrary registry log {stored.id}' shows who wrote it"
        )
    return stored
