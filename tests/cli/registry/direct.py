"""Entries put straight into a registry, for the commands that only read it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from calibrary.registry.entry import Entry
from calibrary.registry.git.writing import Change, write
from calibrary.registry.proposals import note_of
from calibrary.registry.registry import Registry
from tests.registry.entries import put_entries


def put(place: Path, *entries: Entry, subject: str = "Put it there") -> str:
    """Write entries over the current ones; the commit."""
    registry = Registry.open(place)
    current = registry.snapshot().paths
    due = [(entry, current.get(entry.path)) for entry in entries]
    return put_entries(registry, due, note_of(subject, entries)).commit


def put_bytes(place: Path, files: Mapping[str, bytes | None]) -> str:
    """Write files that may be no entries, as a person with plain git could; the commit."""
    registry = Registry.open(place, durable=False)
    current = registry.snapshot().paths
    changes = [Change(path=path, data=data, base=current.get(path)) for path, data in files.items()]
    return write(registry.repo, changes, "By hand\n").commit
