"""The JSON form of an entry: what its file says, in the form in which calibrations are printed everywhere."""

from __future__ import annotations

from calibrary.records import Json, to_json
from calibrary.registry.snapshot import StoredEntry

__all__ = ["stored_json"]


def stored_json(stored: StoredEntry) -> dict[str, Json]:
    """One entry as it stands at a commit (schemas/entry-listing-1.schema.json)."""
    entry = stored.entry
    firmware, validity = entry.firmware, entry.validity
    return {
        "id": stored.id,
        "path": stored.path,
        "commit": stored.commit,
        "blob": stored.oid,
        "status": entry.status.value,
        "reason": entry.reason,
        "calibration": to_json(entry.calibration),
        "firmware": {"min": firmware.min, "max": firmware.max} if firmware is not None else None,
        "valid": {
            "from": validity.first.isoformat() if validity.first is not None else None,
            "until": validity.last.isoformat() if validity.last is not None else None,
        }
        if validity is not None
        else None,
        "aliases": [{"make": alias.make, "model": alias.model} for alias in entry.aliases],
        "tolerance": entry.tolerance,
        "supersedes": entry.supersedes,
    }
