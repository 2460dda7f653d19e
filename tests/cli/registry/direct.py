"""Entries put straight into a registry, for the commands that only read it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from calibrary.registry.entry import Entry
from calibrary.registry.git.writing import FileChange, write
from calibrary.registry.proposals import message_of
from calibrary.registry.registry import Registry
from tests.registry.entries import put_entries


def put(place: Path, *entries: Entry, subject: str = "Put it there") -> str:
    """Write entries over the current ones; the commit."""
    registry = Registry.open(place)
    current = registry.snapshot().cameras
    due = [(entry, current.get(entry.path)) for entry in entries]
    return put_entries(registry, due, message_of(subject, entries)).commit


def put_bytes(place: Path, files: Mapping[str, bytes | None]) -> str:
    """Write files that may be no entries, as a person with plain git could; the commit."""
    registry = Registry.open(place, durable=False)
    current = registry.snapshot().cameras
    changes = [FileChange(path=path, data=data, base=current.get(path)) for path, data in files.items()]
    return write(registry.repo, changes, "By hand\n").commit
