"""``calibrary.lock``: pins the entries that a run uses, so that a later run uses the same ones or is refused.

A registry in git still contains the pinned entries, so a run can be repeated from the pinned commit whatever has
changed since; the changes are reported. A commit also pins its history: images of an earlier period get the revision
that was in use then, up to that commit. A plain folder contains only the current files: if they differ, the run is
refused.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Final

from msgspec import Struct, field

from calibrary.errors import InputError, ParseError, RegistryError, first_of
from calibrary.records import Meta, Record, from_json, replace, require_declared, to_json
from calibrary.registry.entry import Status, digest
from calibrary.registry.entry_yaml import Layout, document_lines, parse_entry
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.paths import proposed_name
from calibrary.registry.resolution import RegistryIndex
from calibrary.registry.snapshot import Snapshot
from calibrary.strictyaml import line_of, load_yaml

MOST_LISTED = 3


class Locked(Struct, frozen=True, kw_only=True):
    """The registry under a lock.

    Attributes:
        index: index of the pinned entries only, in their pinned state.
        warnings: changes of these entries in the registry since.
    """

    index: RegistryIndex
    warnings: tuple[str, ...] = ()


def pinned(snapshot: Snapshot, paths: Iterable[str]) -> Lock:
    """Pin entries in their current state.

    Args:
        snapshot: state of the registry.
        paths: paths of the entries.

    Raises:
        RegistryError: an entry does not exist, cannot be read, or is not approved.
    """
    pins = []
    for path in sorted(set(paths)):
        stored = snapshot.at(path)
        if stored is None and snapshot.at(proposed_name(path)) is not None:
            raise RegistryError(str(snapshot.only_proposed(path)))
        if stored is None:
            raise RegistryError(f"{path}: not in commit {(snapshot.commit or '')[:12]}")
        if not stored.entry.is_usable:
            raise RegistryError(
                f"{stored.id} is {stored.entry.status.value}: only what is approved is pinned"
            )
        pins.append(_pin(path, snapshot.read(path)))
    # A folder's full path may be private, and a remote's address may contain a password.
    return Lock(registry=snapshot.place.name or None, commit=snapshot.commit, pins=tuple(pins))


def usable_paths(snapshot: Snapshot, unreadable: list[str]) -> list[str]:
    """Return the paths of the entries that may be used; the errors of those that cannot be read are added to a list."""
    rows = snapshot.rows(snapshot.paths, unreadable=lambda error: unreadable.append(str(error)))
    return [path for path, row in rows if row["status"] == Status.APPROVED]


def locked(snapshot: Snapshot, lock_file: Path) -> Locked:
    """Return the pinned entries of a registry, in their pinned state.

    Raises:
        InputError: the lock cannot be read.
        RegistryError: a pinned state is not available: the registry lacks the pinned commit, the commit lacks a pinned
            file, or a file in a plain folder has changed.
    """
    lock = read_lock(lock_file)
    repo = snapshot.repo
    if repo is None or lock.commit is None:
        return Locked(index=_pinned_index(snapshot, lock, lock_file))
    if not repo.holds(lock.commit):
        raise RegistryError(
            f"{repo.path} does not hold commit {lock.commit[:12]}, which {lock_file} pins{repo.unshallow_hint}; bring "
            f"it (calibrary registry sync), or accept what is there now: calibrary registry lock"
        )
    # What was in force on earlier days is pinned with the commit.
    index = _pinned_index(replace(snapshot, commit=lock.commit), lock, lock_file)
    return Locked(index=index, warnings=_changes_since(snapshot, lock, lock.commit))


def _pinned_index(snapshot: Snapshot, lock: Lock, lock_file: Path) -> RegistryIndex:
    there = [
        pin.path for pin in lock.pins if (one := snapshot.at(pin.path)) is not None and one.entry.is_usable
    ]
    refuse_drift(lock, [_pin(path, snapshot.read(path)) for path in there], name=str(lock_file))
    return RegistryIndex(there, snapshot.choices)


def _changes_since(snapshot: Snapshot, lock: Lock, commit: str) -> tuple[str, ...]:
    """Return warnings about changes of pinned entries, so that a run with a retired one does not go unnoticed."""
    differences = []
    for pin in lock.pins:
        try:
            stored = snapshot.at(pin.path)
            if stored is None:
                differences.append(f"{pin.path} is gone")
            elif stored.entry.status is Status.RETIRED:
                why = f" ({stored.entry.reason})" if stored.entry.reason else ""
                differences.append(f"{pin.path} was retired{why}")
            elif _pin(pin.path, snapshot.read(pin.path)).blob != pin.blob:
                differences.append(f"{pin.path} was changed")
        except RegistryError as error:
            differences.append(str(error))
    if not differences:
        return ()
    return (
        f"the lock's entries are used as they were at {commit[:12]}; since then "
        f"{first_of(differences, MOST_LISTED, '; ')} ('calibrary registry lock' pins what is there now)",
    )


def _pin(path: str, data: bytes) -> Pin:
    try:
        return pin_of(path, data)
    except InputError as error:
        raise RegistryError(str(error)) from None


LOCK_FILE: Final = "calibrary.lock"
LARGEST_LOCK: Final = 64 << 20

LEGEND: Final = """\
# The registry entries that a run rests on, written by calibrary registry lock; schema: lock-1.
# calibrary extract --registry REGISTRY --locked refuses to run on others.
"""


LAYOUT: Final = Layout(nulls=frozenset({"registry", "commit", "entries"}))


class Pin(Record):
    """A pinned entry.

    Attributes:
        path: path below the registry's root.
        blob: git's id of the whole file, 40 hexadecimal digits.
        digest: digest of its numbers only.
    """

    path: Annotated[str, Meta(pattern="^cameras/[^/]+/.*[.]yaml$")]
    blob: ObjectId
    digest: Annotated[str, Meta(pattern="^sha256:[0-9a-f]{64}$")]

    def __post_init__(self) -> None:
        require_declared(self)


class Lock(Record, tag_field="schema", tag="calibrary/lock-1"):
    """The entries used by a run.

    Attributes:
        registry: name of the registry's folder, for information.
        commit: commit of the registry, 40 hexadecimal digits; None for a folder without a repository.
        pins: pinned entries, by path.
        unanswered: cameras without an entry to pin, in sentences.
    """

    _unwritten = frozenset({"unanswered"})

    registry: str | None = None
    commit: ObjectId | None = None
    pins: tuple[Pin, ...] = field(name="entries")
    unanswered: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        require_declared(self)


class Drift(Struct, frozen=True, kw_only=True):
    """A pinned entry that has changed."""

    path: str
    message: str

    def __str__(self) -> str:
        return f"{self.path}: {self.message}"


def pin_of(path: str, data: bytes) -> Pin:
    """Return the pin of an entry file; CRLF line ends of a checkout do not change it.

    Raises:
        InputError: the file is not an entry.
    """
    entry = parse_entry(data, path, require_digest=False)
    kept = data.replace(b"\r\n", b"\n")
    blob = hashlib.sha1(b"blob %d\0" % len(kept) + kept, usedforsecurity=False).hexdigest()
    return Pin(path=path, blob=blob, digest=digest(entry.calibration, entry.sensor, entry.rig))


def verify(lock: Lock, current: Mapping[str, Pin]) -> tuple[Drift, ...]:
    """Return the violated pins of a lock, by path; changes of other entries are ignored.

    Args:
        lock: the pinned state.
        current: the current state, by path; other paths than those of the lock are ignored.
    """
    return tuple(drift for pin in lock.pins if (drift := _drift(pin, current.get(pin.path))) is not None)


def _drift(pin: Pin, now: Pin | None) -> Drift | None:
    if now is None:
        return Drift(path=pin.path, message="pinned, but no longer in the registry")
    if now.digest != pin.digest:
        return Drift(path=pin.path, message="its numbers have changed since it was pinned")
    if now.blob != pin.blob:
        message = "the same numbers, but its key or another field has changed since it was pinned"
        return Drift(path=pin.path, message=message)
    return None


def lock_yaml(lock: Lock) -> bytes:
    """Return the lock file, deterministically."""
    ordered = replace(lock, pins=tuple(sorted(lock.pins, key=lambda pin: pin.path)))
    return (LEGEND + "\n".join(document_lines(to_json(ordered), LAYOUT)) + "\n").encode()


def parse_lock(data: bytes, name: str) -> Lock:
    """Read a lock.

    Raises:
        ParseError: it is not YAML, does not match schemas/lock-1.schema.json, or contains an entry twice.
    """
    value = load_yaml(data, source=name, max_bytes=LARGEST_LOCK)
    lock = from_json(Lock, value, source=name, locate=partial(line_of, data))
    paths = [pin.path for pin in lock.pins]
    if len(set(paths)) < len(paths):
        twice = next(path for path in paths if paths.count(path) > 1)
        raise ParseError(f"pins {twice} twice, expected it once", source=name)
    return lock


def read_lock(path: Path) -> Lock:
    """Read a lock file.

    Raises:
        InputError: the file cannot be read, or is not a lock.
    """
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_LOCK + 1)
    except OSError as error:
        raise InputError(
            f"cannot be read: {error.strerror}; 'calibrary registry lock' writes one", source=str(path)
        ) from None
    return parse_lock(data, str(path))


def refuse_drift(lock: Lock, current: Iterable[Pin], *, name: str) -> None:
    """Raise an error unless all pins hold.

    Raises:
        RegistryError: an entry has changed; the message names the first, and the number of further ones.
    """
    drifts = verify(lock, {pin.path: pin for pin in current})
    if drifts:
        more = f" (and {len(drifts) - 1} more)" if len(drifts) > 1 else ""
        at = f"check out {lock.commit[:12]}" if lock.commit is not None else "restore it"
        raise RegistryError(
            f"the registry differs from {name}: {drifts[0]}{more}; {at}, or accept what is there now: "
            "calibrary registry lock"
        )
