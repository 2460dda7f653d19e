"""Pinned entries, and the lock file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct

from calibrary.atomic import write_files
from calibrary.errors import RegistryError
from calibrary.records import Json, to_json
from calibrary.registry.locking import Lock, lock_yaml, pinned, usable_paths
from calibrary.registry.paths import single_match
from calibrary.registry.snapshot import Snapshot

__all__ = ["LockResult", "locked"]


class LockResult(Struct, frozen=True, eq=False):
    """A lock of entries in their current state, and the cameras that have no entry."""

    lock: Lock
    unanswered: tuple[str, ...]

    def write(self, path: Path) -> None:
        """Write the lock's file.

        Raises:
            InputError: the file cannot be written.
        """
        write_files({path: lock_yaml(self.lock)})

    def to_dict(self) -> dict[str, Json]:
        """Return the lock as plain data for JSON (schemas/lock-1.schema.json)."""
        return to_json(self.lock)


def locked(snapshot: Snapshot, what: Sequence[str | Path], *, recursive: bool) -> LockResult:
    """Do the work of :meth:`calibrary.Fleet.lock`."""
    paths: list[str] = []
    unanswered: list[str] = []
    for one in what:
        if Path(one).is_dir():
            from calibrary.jobs.extract.knowledge import flight_entries  # noqa: PLC0415  reads images

            found, without = flight_entries(snapshot, Path(one), recursive=recursive)
            paths += found
            unanswered += without
        else:
            paths.append(single_match(snapshot.in_use(str(one)), snapshot.paths, str(one)))
    if not what:
        paths = usable_paths(snapshot)
    if not paths:
        raise RegistryError(
            "no entry to pin: none is approved or held; 'calibrary registry approve KEY' puts one to use"
        )
    return LockResult(pinned(snapshot, paths), tuple(unanswered))
