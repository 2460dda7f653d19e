"""``calibrary.lock``: which entries a run rests on, so that the next run rests on the same or says that it cannot."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final, TypedDict, cast

from calibrary.errors import InputError, ParseError, RegistryError
from calibrary.registry.digest import digest
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.yaml_text import quoted, scalar
from calibrary.schemas import require
from calibrary.strictyaml import line_of, load_yaml

__all__ = [
    "LOCK_FILE",
    "Drift",
    "Lock",
    "Pin",
    "lock_yaml",
    "parse_lock",
    "pin_of",
    "read_lock",
    "refuse_drift",
    "verify",
]

LOCK_FILE: Final = "calibrary.lock"
LARGEST_LOCK: Final = 64 << 20

LEGEND: Final = """\
# The registry entries that a run rests on, written by calibrary registry lock; schema: lock-1.
# calibrary extract --registry REGISTRY --locked refuses to run on others.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pin:
    """One entry, held fast.

    Attributes:
        path: below the registry's root.
        blob: git's id of the whole file, 40 hexadecimal digits.
        digest: of its numbers alone.
    """

    path: str
    blob: str
    digest: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Lock:
    """The entries a run rests on.

    Attributes:
        registry: where the registry was, for people.
        commit: of the registry, 40 hexadecimal digits; None for a folder that is no repository.
        pins: by path.
    """

    registry: str | None = None
    commit: str | None = None
    pins: tuple[Pin, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """A pinned entry that is no longer what it was."""

    path: str
    message: str

    def __str__(self) -> str:
        return f"{self.path}: {self.message}"


class _Pin(TypedDict):
    path: str
    blob: str
    digest: str


class _Lock(TypedDict):
    registry: str | None
    commit: str | None
    entries: list[_Pin]


def pin_of(path: str, data: bytes) -> Pin:
    """The pin of an entry from its file; a checkout with CRLF line ends gives the pin of git's own bytes.

    Raises:
        InputError: the file is no entry.
    """
    entry = parse_entry(data, path, require_digest=False)
    kept = data.replace(b"\r\n", b"\n")
    blob = hashlib.sha1(b"blob %d\0" % len(kept) + kept, usedforsecurity=False).hexdigest()
    return Pin(path=path, blob=blob, digest=digest(entry.calibration, entry.sensor))


def verify(lock: Lock, current: Mapping[str, Pin]) -> tuple[Drift, ...]:
    """What of a lock no longer holds, in the order of its paths; entries it does not pin may come and go.

    Args:
        lock: what was.
        current: what is, by path; paths that the lock does not name are not looked at.
    """
    return tuple(drift for pin in lock.pins if (drift := _drift(pin, current.get(pin.path))) is not None)


def _drift(pin: Pin, now: Pin | None) -> Drift | None:
    if now is None:
        return Drift(path=pin.path, message="pinned, and no longer in the registry")
    if now.digest != pin.digest:
        return Drift(path=pin.path, message="its numbers have changed since it was pinned")
    if now.blob != pin.blob:
        message = "the same numbers, but status, key or what else it says has changed since it was pinned"
        return Drift(path=pin.path, message=message)
    return None


def lock_yaml(lock: Lock) -> bytes:
    """The lock's file, the same bytes for the same lock."""
    lines = [
        'schema: "calibrary/lock-1"',
        f"registry: {scalar(lock.registry)}",
        f"commit: {scalar(lock.commit)}",
        "entries:" if lock.pins else "entries: []",
    ]
    for pin in sorted(lock.pins, key=lambda pin: pin.path):
        lines += [
            f"  - path: {quoted(pin.path)}",
            f"    blob: {quoted(pin.blob)}",
            f"    digest: {quoted(pin.digest)}",
        ]
    return (LEGEND + "\n".join(lines) + "\n").encode()


def parse_lock(data: bytes, name: str) -> Lock:
    """Read a lock.

    Raises:
        ParseError: it is no YAML, breaks schemas/lock-1.schema.json, or pins an entry twice.
    """
    value = load_yaml(data, source=name, max_bytes=LARGEST_LOCK)
    require(value, "lock-1", source=name, locate=partial(line_of, data))
    document = cast("_Lock", value)
    pins = tuple(Pin(**pin) for pin in document["entries"])
    paths = [pin.path for pin in pins]
    if len(set(paths)) < len(paths):
        twice = next(path for path in paths if paths.count(path) > 1)
        raise ParseError(f"pins {twice} twice, wanted it once", source=name)
    return Lock(registry=document.get("registry"), commit=document.get("commit"), pins=pins)


def read_lock(path: Path) -> Lock:
    """Read a lock's file.

    Raises:
        InputError: it cannot be read, or is no lock.
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
    """Do nothing where every pin holds.

    Raises:
        RegistryError: an entry has drifted; the first is named, and how many more there are.
    """
    drifts = verify(lock, {pin.path: pin for pin in current})
    if drifts:
        more = f" (and {len(drifts) - 1} more)" if len(drifts) > 1 else ""
        at = f"check out {lock.commit[:12]}" if lock.commit is not None else "restore it"
        raise RegistryError(
            f"the registry has drifted from {name}: {drifts[0]}{more}; {at}, or accept what is there now: "
            "calibrary registry lock"
        )
