"""What was read of a registry before, in the user's cache folder.

A :class:`Cache` is one file, which nothing needs. The name of each value says all that the value follows from: git's
ids of files and folders, and digests. So nothing in it gets old, and whichever commit is read finds what it shares with
others. A file that is damaged or of another version is thrown away. A :class:`Memory` holds what this reader has seen
in force; without it, a statement that is taken out is not missed.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from struct import Struct as Layout
from typing import Final, TypeVar
from zlib import crc32

import msgspec
from msgspec import Struct
from platformdirs import user_cache_path

from calibrary.registry.git.repository import Repository

T = TypeVar("T")
LENGTH_AND_SUM: Final = Layout("<II")
LARGEST: Final = 256 << 20
"""Bytes; 10 000 entries take 15 MB, and each change of one takes its share again."""
_VALUES: Final = msgspec.msgpack.Decoder(dict[str, msgspec.Raw])


def cache_folder() -> Path:
    """Return the folder of these files."""
    return user_cache_path("calibrary", appauthor=False) / "registries"


def file_of(repo: Repository, suffix: str, folder: Path | None = None) -> Path:
    """Return the file of a repository."""
    name = hashlib.sha256(os.fsencode(repo.common_dir)).hexdigest()[:32]
    return (folder or cache_folder()) / f"{name}{suffix}"


class Cache:
    """Values by name in one file of blocks, to which they are only appended, so that several processes may write."""

    def __init__(self, file: Path, version: str) -> None:
        """Set up without reading the file; one of another version is thrown away."""
        self.file: Final = file
        self._start: Final = crc32(version.encode())
        self._is_whole = True

    @cached_property
    def _kept(self) -> dict[str, msgspec.Raw]:
        found: dict[str, msgspec.Raw] = {}
        for block in self._blocks():
            found.update(_VALUES.decode(block))
        return found

    def _blocks(self) -> Iterator[memoryview]:
        try:
            data = memoryview(self.file.read_bytes())
        except OSError:
            return
        at, self._is_whole = 0, False
        while at + LENGTH_AND_SUM.size <= len(data):
            size, checksum = LENGTH_AND_SUM.unpack_from(data, at)
            at += LENGTH_AND_SUM.size
            block = data[at : at + size]
            if crc32(block, self._start) != checksum:
                return
            yield block
            at += size
        self._is_whole = at == len(data) <= LARGEST

    def get(self, decoder: msgspec.msgpack.Decoder[T], names: Iterable[str]) -> dict[str, T]:
        """Return the values that are kept; of equal ones, as the standings of most entries, one object."""
        read, found = dict[bytes, T](), dict[str, T]()
        for name in names:
            if (raw := self._kept.get(name)) is None:
                continue
            data = bytes(raw)
            if data not in read:
                read[data] = decoder.decode(data)
            found[name] = read[data]
        return found

    def keep(self, values: Mapping[str, object]) -> None:
        """Keep values, if the file can be written."""
        if not values:
            return
        packed = {name: msgspec.Raw(msgspec.msgpack.encode(one)) for name, one in values.items()}
        self._kept.update(packed)
        block = msgspec.msgpack.encode(packed)
        head = LENGTH_AND_SUM.pack(len(block), crc32(block, self._start))
        with suppress(OSError):
            self.file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not self._is_whole:
                self.file.unlink(missing_ok=True)
                self._is_whole = True
            with self.file.open("ab", buffering=0) as opened:
                opened.write(head + block)


class _Seen(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A line of the memory: ids of statements that were seen on a branch, by their subject, or are given up."""

    commit: str
    ref: str
    seen: dict[str, list[str]] = {}
    given_up: list[str] = []


class Memory:
    """Ids of the statements that this reader has seen, by branch and subject: lines that are only appended."""

    def __init__(self, repo: Repository, folder: Path | None = None) -> None:
        """Set up without reading the file."""
        self._repo, self._file = repo, file_of(repo, ".seen", folder)
        self._branches: dict[str, dict[str, set[str]]] = {}

    def seen(self, ref: str) -> dict[str, set[str]]:
        """Return the ids of the statements that were seen on a branch, by their subject."""
        if ref not in self._branches:
            self._branches[ref] = self._read(ref)
        return self._branches[ref]

    def _read(self, ref: str) -> dict[str, set[str]]:
        lines, found = [*self._lines()], dict[str, set[str]]()
        # Another registry in the place of a former one is not measured by that, now or later.
        if not any(map(self._repo.holds, dict.fromkeys(one.commit for one in reversed(lines)))):
            with suppress(OSError):
                self._file.unlink(missing_ok=True)
            return found
        for one in lines:
            if one.ref != ref:
                continue
            for subject, names in one.seen.items():
                found.setdefault(subject, set()).update(names)
            for ids in found.values() if one.given_up else ():
                ids.difference_update(one.given_up)
        return found

    def _lines(self) -> Iterator[_Seen]:
        try:
            data = self._file.read_bytes()
        except OSError:
            return
        for line in data.splitlines():
            with suppress(msgspec.MsgspecError, UnicodeError):
                yield msgspec.json.decode(line, type=_Seen)

    def remember(self, commit: str, ref: str, seen: Mapping[str, Iterable[str]]) -> None:
        """Keep the ids of statements that were seen at a commit of a branch, by their subject."""
        known = self.seen(ref)
        new = {name: [one for one in ids if one not in known.get(name, ())] for name, ids in seen.items()}
        if new := {name: ids for name, ids in new.items() if ids}:
            self._append(_Seen(commit=commit, ref=ref, seen=new))
            for name, ids in new.items():
                known.setdefault(name, set()).update(ids)

    def give_up(self, commit: str, ref: str, names: Iterable[str]) -> None:
        """Forget statements that were given up on a branch."""
        self._append(_Seen(commit=commit, ref=ref, given_up=[*names]))

    def _append(self, line: _Seen) -> None:
        with suppress(OSError):
            self._file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            with self._file.open("ab", buffering=0) as opened:
                opened.write(b"\n" + msgspec.json.encode(line) + b"\n")
