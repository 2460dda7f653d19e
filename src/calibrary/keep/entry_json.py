"""The JSON form of an entry: what its file says, in the form in which calibrations are printed everywhere."""

from __future__ import annotations

from calibrary.keep.keeper import Held
from calibrary.records import Json, to_json

__all__ = ["held_json"]


def held_json(held: Held) -> dict[str, Json]:
    """One entry as it stands at a commit (schemas/entry-listing-1.schema.json)."""
    entry = held.entry
    firmware, validity = entry.firmware, entry.validity
    return {
        "id": held.id,
        "path": held.path,
        "commit": held.commit,
        "blob": held.oid,
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
