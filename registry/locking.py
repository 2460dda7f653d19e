"""``calibrary.lock``: pinning the entries that a run rests on, and answering from just those later.

A git registry still has the entries as they were, so a run is repeated from the pinned commit whatever became of
the registry since, and is told what has changed. A plain folder has only what lies there: if that is something
else, the run is refused.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from calibrary.errors import InputError, RegistryError
from calibrary.records import Json
from calibrary.registry.entry import Status
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.pins import Lock, Pin, pin_of, read_lock, refuse_drift
from calibrary.registry.resolution import RegistryIndex
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.writing import parsed

__all__ = ["Locked", "lock_json", "locked", "pinned", "usable_paths"]

MOST_LISTED = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Locked:
    """What answers under a lock.

    Attributes:
        index: of the pinned entries alone, as they were.
        warnings: what has become of them in the registry since.
    """

    index: RegistryIndex
    warnings: tuple[str, ...] = ()


def pinned(snapshot: Snapshot, paths: Iterable[str]) -> Lock:
    """A lock of some entries as they stand.

    Args:
        snapshot: of the registry.
        paths: of the entries.

    Raises:
        RegistryError: one is not there or cannot be read.
    """
    wanted = sorted(set(paths))
    pins = tuple(_pin(path, data) for path, data in zip(wanted, snapshot.read_many(wanted), strict=True))
    # A folder's whole path tells about a disk, and a remote's address may hold a password.
    return Lock(registry=snapshot.place.name or None, commit=snapshot.commit, pins=pins)


def lock_json(lock: Lock) -> dict[str, Json]:
    """What the lock's file says (schemas/lock-1.schema.json)."""
    entries: list[Json] = [
        {"path": pin.path, "blob": pin.blob, "digest": pin.digest}
        for pin in sorted(lock.pins, key=lambda pin: pin.path)
    ]
    return {
        "schema": "calibrary/lock-1",
        "registry": lock.registry,
        "commit": lock.commit,
        "entries": entries,
    }


def usable_paths(snapshot: Snapshot) -> list[str]:
    """The paths of the entries that may be used.

    Raises:
        RegistryError: one cannot be read.
    """
    files = snapshot.files()
    return [path for path, data in files if parsed(data, path, require_digest=False).is_usable]


def locked(snapshot: Snapshot, lock_file: Path) -> Locked:
    """The pinned entries of a registry and no others, each of them as it was.

    Raises:
        InputError: the lock cannot be read.
        RegistryError: an entry cannot be had as it was: the registry does not hold the pinned commit, the commit
            does not hold what is pinned, or what lies in a plain folder has changed.
    """
    lock = read_lock(lock_file)
    repo = snapshot.repo
    if repo is None or lock.commit is None:
        there = [pin.path for pin in lock.pins if pin.path in snapshot.paths]
        return Locked(index=_pinned_index(lock, {path: snapshot.read(path) for path in there}, lock_file))
    if repo.tip(lock.commit) is None:
        hint = "; this clone is shallow: git fetch --unshallow brings the rest" if repo.is_shallow else ""
        raise RegistryError(
            f"{repo.path} does not hold commit {lock.commit[:12]}, which {lock_file} pins{hint}; bring it "
            f"(calibrary registry pull), or accept what is there now: calibrary registry lock"
        )
    files = {}
    for pin in lock.pins:
        blob = repo.read(lock.commit, pin.path)
        if blob is not None:
            files[pin.path] = blob.data
    return Locked(index=_pinned_index(lock, files, lock_file), warnings=_since(snapshot, lock, lock.commit))


def _pinned_index(lock: Lock, files: Mapping[str, bytes], lock_file: Path) -> RegistryIndex:
    refuse_drift(lock, [_pin(path, data) for path, data in files.items()], name=str(lock_file))
    return RegistryIndex(files, files.__getitem__, require_digest=False)


def _since(snapshot: Snapshot, lock: Lock, commit: str) -> tuple[str, ...]:
    """What has become of pinned entries: a run that is repeated on a retired one should not go unnoticed."""
    told = []
    for pin in lock.pins:
        oid = snapshot.paths.get(pin.path)
        if oid == pin.blob:
            continue
        told.append(f"{pin.path} {_became(snapshot.read(pin.path), pin) if oid is not None else 'is gone'}")
    if not told:
        return ()
    more = f" and {len(told) - MOST_LISTED} more" if len(told) > MOST_LISTED else ""
    return (
        f"the lock's entries are used as they were at {commit[:12]}; since then "
        f"{'; '.join(told[:MOST_LISTED])}{more} ('calibrary registry lock' pins what is there now)",
    )


def _became(data: bytes, pin: Pin) -> str:
    try:
        entry = parse_entry(data, pin.path, require_digest=False)
    except InputError:
        return "was changed, and cannot be read"
    if entry.status is Status.RETIRED:
        return "was retired" + (f" ({entry.reason})" if entry.reason else "")
    return "was changed"


def _pin(path: str, data: bytes) -> Pin:
    try:
        return pin_of(path, data)
    except InputError as error:
        raise RegistryError(str(error)) from None
