"""Entries put straight into a registry, for the commands that only read it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from calibrary.keep.keeper import Keeper, note_of
from calibrary.registry.entry import Entry
from calibrary.registry.fleet import Note, Registry
from calibrary.registry.git.writing import Change

__all__ = ["put", "put_bytes"]


def put(place: Path, *entries: Entry, subject: str = "Put it there") -> str:
    """Write entries over whatever stands there; the commit."""
    keeper = Keeper.open(place)
    standing = keeper.registry.snapshot().paths
    due = [(entry, standing.get(entry.path)) for entry in entries]
    return keeper.save(due, note_of(subject, entries)).commit


def put_bytes(place: Path, files: Mapping[str, bytes | None]) -> str:
    """Write files that may be no entries, as a person with plain git could; the commit."""
    registry = Registry.open(place, durable=False)
    standing = registry.snapshot().paths
    changes = [Change(path=path, data=data, base=standing.get(path)) for path, data in files.items()]
    return registry.put_many(changes, Note(subject="By hand")).commit
