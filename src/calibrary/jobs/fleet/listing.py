"""Entries of a registry that were selected, read when they are asked for."""

from __future__ import annotations

from functools import cached_property

from msgspec import Struct

from calibrary.errors import RegistryError
from calibrary.interop.notebook import MOST_ROWS, html_rows
from calibrary.records import Json, to_json
from calibrary.registry import stored
from calibrary.registry.query import Selection, short_ids
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.stored import StoredEntry

__all__ = ["EntryListing"]


class EntryListing(Struct, frozen=True, eq=False, dict=True):
    """Selected entries of a registry, and the errors of those that cannot be read.

    Attributes:
        chosen: rows of fields of the selected entries, sorted.
        unreadable: errors of entries that cannot be read.
        snapshot: state of the registry.
    """

    chosen: Selection
    unreadable: tuple[RegistryError, ...]
    snapshot: Snapshot

    @cached_property
    def entries(self) -> tuple[StoredEntry, ...]:
        """The selected entries as objects, read at first use."""
        return self.snapshot.stored(self.chosen.paths)

    def short_ids(self) -> list[str]:
        """Return the KEYs of the entries, with unit hashes as short as possible."""
        every = (*self.snapshot.paths, *self.snapshot.proposed)
        return short_ids(self.chosen.paths, every)

    def _repr_html_(self) -> str:
        """Return the entries as HTML, for notebooks."""
        rows = []
        for short, row in zip(self.short_ids()[:MOST_ROWS], self.chosen.rows, strict=False):
            fx, said = row["intrinsics.fx"], (row.get("label"), short, row["status"], row["grade"])
            day = str(row.get("provenance.date", ""))[:10]
            rows.append((*(str(text or "") for text in said), f"{fx:.2f}", day))
        columns = ("label", "entry", "status", "grade", "fx px", "made on")
        return html_rows(columns, rows, many=len(self.chosen.rows))

    def to_dict(self) -> dict[str, Json]:
        """Return the listing as plain data for JSON (schemas/entry-listing-1.schema.json)."""
        return to_json(stored.EntryListing.of(self.entries))
