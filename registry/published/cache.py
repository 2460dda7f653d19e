"""Cache of files read over HTTP, in the user's cache folder; every file is verified again when it is used.

Roots are stored by their address, all other files by their digest. The folder may be deleted at any time. Its size is
limited (:mod:`calibrary.registry.published.pruning`).
"""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Final

from platformdirs import user_cache_path

from calibrary.errors import ParseError
from calibrary.records import Record, from_json
from calibrary.registry.published.layout import Sha256, document_bytes, sha256
from calibrary.strictjson import parse_json

__all__ = ["FILES", "ROOTS", "Cache", "CachedRoot", "cached_root"]

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
        # Few runs write anything; pruning has to scan all files.
        from calibrary.registry.published.pruning import prune_if_due  # noqa: PLC0415  the reason above

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
