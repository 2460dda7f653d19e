"""Cache of files read over HTTP, in the user's cache folder; every file is verified again when it is used.

What is trusted is stored by its address, all other files by their digest. The folder may be deleted at any time, but an
address is then trusted anew. Its size is limited: what was not used for the longest time goes first.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Final

from msgspec import Struct
from platformdirs import user_cache_path

from calibrary.registry.published.layout import PublishedCamera, sha256

LARGEST: Final = 16 << 20
MOST_DOCUMENTS: Final = 2048
"""Number of camera files kept parsed per process."""
TRUSTED, FILES = "trusted", "files"
"""Folders of the cache."""


@dataclass(slots=True)
class Cache:
    """A cache folder.

    Attributes:
        folder: the folder, created at the first write. If that fails, the next run only takes longer.
        documents: parsed files of this process, by digest.
        written: bytes written by this process since the folder was last pruned.
    """

    folder: Path
    documents: dict[str, PublishedCamera] = field(default_factory=dict, compare=False, repr=False)
    written: int | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of_user(cls) -> Cache:
        """Return the cache in the user's cache folder, one per process."""
        return _shared(user_cache_path("calibrary", appauthor=False) / "published")

    def trusted(self, url: str) -> Path:
        """Return the folder of what is trusted at an address."""
        return self.folder / TRUSTED / sha256(url.encode("utf-8", "surrogatepass"))[:32]

    def get(self, digest: str) -> bytes | None:
        """Return the file with a digest; None if there is none, or it is damaged."""
        try:
            data = _read(self._file(digest))
        except OSError:
            return None
        return data if sha256(data) == digest else None

    def keep(self, data: bytes, digest: str) -> None:
        """Store a file by its digest; from time to time, old files are then removed."""
        _write(self._file(digest), data)
        self.written = prune_if_due(self.folder, self.written, len(data))

    def remember(self, digest: str, document: PublishedCamera) -> None:
        """Keep a parsed file for this process."""
        if len(self.documents) >= MOST_DOCUMENTS:
            self.documents.clear()
        self.documents[digest] = document

    def _file(self, digest: str) -> Path:
        return self.folder / FILES / digest[:2] / digest


@cache
def _shared(folder: Path) -> Cache:
    return Cache(folder)


def _read(file: Path) -> bytes:
    """Read a file, and note once a day that it is used."""
    with file.open("rb", buffering=0) as opened:
        if time.time() - os.fstat(opened.fileno()).st_mtime > EVERY_S:
            with suppress(OSError):
                os.utime(file)
        return opened.read(LARGEST)


def _write(file: Path, data: bytes) -> None:
    """Write a file in place, without waiting for the disk: a part of it is told by its digest when it is used."""
    with suppress(OSError):
        try:
            file.write_bytes(data)
        except FileNotFoundError:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)


CACHE_MIB: Final = "CALIBRARY_CACHE_MIB"
"""Environment variable with the largest size of the cache of published registries, in MiB."""
USUAL_MIB: Final = 256
LONGEST_S: Final = 365 * 86_400
"""Seconds that a file is kept without being used."""
EVERY_S: Final = 86_400
STAMP: Final = "pruned"
OFTEN: Final = 16
"""A process prunes again after writing this fraction of the limit."""


class _File(Struct, frozen=True):
    path: Path
    size: int
    time_s: float


def prune_if_due(folder: Path, written: int | None, more: int) -> int:
    """Prune if this was not done for a day, or much was written since; return the bytes written since pruning.

    Args:
        folder: folder of the cache.
        written: bytes written by this process since; None if it has not written yet.
        more: bytes that it has just written.
    """
    total = (written or 0) + more
    if total <= _limit() // OFTEN and (written is not None or time.time() - _time(folder / STAMP) <= EVERY_S):
        return total
    prune(folder)
    return 0


def prune(folder: Path, *, limit: int | None = None) -> int:
    """Remove files that were not used for long, and above the limit those unused for the longest; return their number.

    Args:
        folder: folder of the cache.
        limit: bytes; by default from $CALIBRARY_CACHE_MIB.
    """
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / STAMP).touch()
    now, files = time.time(), sorted(_below(folder / FILES), key=lambda one: one.time_s)
    total, removed = sum(one.size for one in files), 0
    for one in files:
        if now - one.time_s <= LONGEST_S and total <= (_limit() if limit is None else limit):
            break
        with suppress(OSError):
            one.path.unlink()
            total -= one.size
            removed += 1
    return removed


def _below(folder: Path) -> Iterator[_File]:
    for at, _, names in os.walk(folder):
        for name in names:
            path = Path(at, name)
            with suppress(OSError):
                found = path.stat()
                yield _File(path, found.st_size, found.st_mtime)


def _time(file: Path) -> float:
    try:
        return file.stat().st_mtime
    except OSError:
        return 0.0


def _limit() -> int:
    stated = os.environ.get(CACHE_MIB, "")
    return (int(stated) if stated.isdecimal() else USUAL_MIB) << 20
