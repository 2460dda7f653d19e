"""Cache of files read over HTTP, in the user's cache folder; every file is verified again when it is used.

Roots are stored by their address, all other files by their digest. The folder may be deleted at any time. Its size is
limited (:mod:`calibrary.registry.published.cache`).
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Final

import msgspec
from msgspec import Struct
from platformdirs import user_cache_path

from calibrary.errors import CalibraryError, ParseError
from calibrary.records import Record, from_json
from calibrary.registry.published.layout import (
    PublishedCamera,
    PublishedRegistry,
    PublishedTree,
    Sha256,
    document_bytes,
    sha256,
)
from calibrary.strictjson import parse_json

__all__ = ["CACHE_MIB", "FILES", "ROOTS", "Cache", "CachedRoot", "cached_root", "prune", "prune_if_due"]

LARGEST: Final = 16 << 20
MOST_DOCUMENTS: Final = 2048
"""Number of documents kept parsed per process; a part of the tree has about 25 kB."""
ROOTS, FILES = "roots", "files"
"""Folders of the cache."""


class CachedRoot(Record, tag_field="schema", tag="calibrary/cached-root-1"):
    """The root of a published registry, as it was read.

    Attributes:
        url: address of the registry.
        etag: ETag of the server.
        read: time when it was read, or last confirmed by the server.
        sha256: SHA-256 of the text.
        text: content of calibrary.json.
        signature: content of calibrary.json.sig; None if there was none.
    """

    url: str
    etag: str | None
    read: datetime
    sha256: Sha256
    text: str
    signature: str | None


@dataclass(slots=True)
class Cache:
    """A cache folder.

    Attributes:
        folder: the folder, created at the first write. If that fails, the next run only takes longer.
        documents: parsed files of this process, by digest.
        written: bytes written by this process since the folder was last pruned.
    """

    folder: Path
    documents: dict[str, Record] = field(default_factory=dict, compare=False, repr=False)
    written: int | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of_user(cls) -> Cache:
        """Return the cache in the user's cache folder, one per process."""
        return _shared(user_cache_path("calibrary", appauthor=False) / "published")

    def root(self, url: str) -> CachedRoot | None:
        """Return the root last read from an address; None if there is none, or it is damaged."""
        file = self._root_file(url)
        found = cached_root(file)
        return found if found is not None and found.url == url else None

    def keep_root(self, root: CachedRoot) -> None:
        """Store a root, replacing the previous one."""
        _write(self._root_file(root.url), document_bytes(root))

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

    def remember(self, digest: str, document: Record) -> None:
        """Keep a parsed file for this process."""
        if len(self.documents) >= MOST_DOCUMENTS:
            self.documents.clear()
        self.documents[digest] = document

    def _root_file(self, url: str) -> Path:
        return self.folder / ROOTS / f"{sha256(url.encode('utf-8', 'surrogatepass'))[:32]}.json"

    def _file(self, digest: str) -> Path:
        return self.folder / FILES / digest[:2] / digest


@cache
def _shared(folder: Path) -> Cache:
    return Cache(folder)


def cached_root(file: Path) -> CachedRoot | None:
    """Return the root in a file of the cache; None if it is damaged."""
    try:
        found = from_json(CachedRoot, parse_json(_read(file), source=file.name), source=file.name)
    except (OSError, ParseError):
        return None
    return found if sha256(found.text.encode()) == found.sha256 else None


def _read(file: Path) -> bytes:
    with file.open("rb") as opened:
        return opened.read(LARGEST)


def _write(file: Path, data: bytes) -> None:
    """Write a file atomically, without waiting for the disk, since it is verified again when used."""
    temporary = file.with_name(f".{file.name[:40]}.{os.urandom(4).hex()}")
    with suppress(OSError):
        try:
            try:
                temporary.write_bytes(data)
            except FileNotFoundError:
                file.parent.mkdir(parents=True, exist_ok=True)
                temporary.write_bytes(data)
            temporary.replace(file)
        except OSError:
            temporary.unlink(missing_ok=True)
            raise


CACHE_MIB: Final = "CALIBRARY_CACHE_MIB"
"""Environment variable with the largest size of the cache of published registries, in MiB."""
USUAL_MIB: Final = 256
LONGEST_S: Final = 30 * 86_400
"""Seconds that a file is kept after no root refers to it any more."""
LONGEST_UNREAD_S: Final = 365 * 86_400
"""Seconds that an unread root is kept; the newest of all is kept forever."""
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
    """Remove old files, and files above the limit; return their number.

    Args:
        folder: folder of the cache.
        limit: bytes; by default from $CALIBRARY_CACHE_MIB.
    """
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / STAMP).touch()
    now = time.time()
    files = {one.path.name: one for one in _below(folder / FILES)}
    needed = _needed(folder / ROOTS, files, now)
    loose = sorted((one for name, one in files.items() if name not in needed), key=lambda one: one.time_s)
    total, removed = sum(one.size for one in files.values()), 0
    for one in loose:
        if now - one.time_s <= LONGEST_S and total <= (_limit() if limit is None else limit):
            break
        with suppress(OSError):
            one.path.unlink()
            total -= one.size
            removed += 1
    return removed


def _needed(roots: Path, files: Mapping[str, _File], now: float) -> set[str]:
    """Return the digests of files that kept roots refer to; remove roots that were not read for a long time."""
    found = [(cached_root(one.path), one) for one in _below(roots)]
    newest = max((root.read for root, _ in found if root is not None), default=None)
    needed: set[str] = set()
    for root, file in found:
        is_kept = root is not None and root.read == newest
        if not is_kept and now - file.time_s > LONGEST_UNREAD_S:
            with suppress(OSError):
                file.path.unlink()
        elif root is not None:
            with suppress(msgspec.MsgspecError, CalibraryError):
                state = from_json(PublishedRegistry, msgspec.json.decode(root.text))
                needed.update(_led_to(state.tree, state.depth, files))
    return needed


def _led_to(tree: Mapping[str, str], depth: int, files: Mapping[str, _File]) -> Iterator[str]:
    """Yield the existing files that a part of the tree refers to."""
    for digest in tree.values():
        data = _content(files.get(digest))
        if data is None:
            continue
        yield digest
        with suppress(msgspec.MsgspecError, CalibraryError):
            if depth:
                yield from _led_to(msgspec.json.decode(data, type=PublishedTree).tree, depth - 1, files)
                continue
            for row in msgspec.json.decode(data, type=PublishedCamera).entries:
                yield from (row.sha256, *(one.sha256 for one in row.earlier))


def _content(file: _File | None) -> bytes | None:
    if file is None:
        return None
    try:
        data = file.path.read_bytes()
    except OSError:
        return None
    return data if sha256(data) == file.path.name else None


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
