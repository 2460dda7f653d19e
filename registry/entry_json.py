"""The JSON form of an entry: what its file says, in the form in which calibrations are printed everywhere."""

from __future__ import annotations

from calibrary.records import Json, fields_json
from calibrary.registry.snapshot import StoredEntry

__all__ = ["stored_json"]


def stored_json(stored: StoredEntry) -> dict[str, Json]:
    """One entry as it stands at a commit (schemas/entry-listing-1.schema.json)."""
    said = fields_json(stored.entry)
    del said["schema"]
    return {"id": stored.id, "path": stored.path, "commit": stored.commit, "blob": stored.oid} | said
