"""Reader of a published registry: the entries of a camera, with every file verified from the signed manifest.

The manifest defines one state. A file that is gone or damaged means that the registry was published again in between;
then the manifest is read again and the query repeated. If the server cannot be reached, the last manifest and the
cached files are used, with a warning about their age, until it expires.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from calibrary.atomic import write_files
from calibrary.calibration import CameraKey
from calibrary.errors import InputError, RegistryError
from calibrary.known_camera import match_key
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status
from calibrary.registry.entry_yaml import parsed
from calibrary.registry.git.locks import writer_lock
from calibrary.registry.paths import ROOT, UNIT, slug
from calibrary.registry.places import PUBLISHED_FILE
from calibrary.registry.published.address import normalised
from calibrary.registry.published.cache import Cache
from calibrary.registry.published.fetch import Fetch, FetchError, fetch
from calibrary.registry.published.manifest import (
    LARGEST_CAMERA,
    LARGEST_LIST,
    LARGEST_MANIFEST,
    Manifest,
    NoManifestError,
    Opened,
    PublishedCamera,
    PublishedEntry,
    PublishedList,
    file_of,
    model_of,
    opened,
    require_trusted,
    sha256,
)
from calibrary.registry.resolution import RegistryIndex

PAUSES_S: Final = (0.0, 0.2, 0.6)
"""Seconds to wait before the manifest is read again, because a file does not match it."""
GONE: Final = frozenset({403, 404, 410})
"""Statuses by which servers say that there is no such file; buckets that may not be listed answer 403."""
MOST_ALIASES: Final = 32
MOST_INDEXES: Final = 4096
"""Number of cameras whose entries are kept parsed."""
WAIT_S: Final = 30.0
SIGNERS: Final = "CALIBRARY_SIGNERS"
"""Environment variable with an "ALLOWED SIGNERS" file of ssh-keygen(1), one of whom has to sign the manifest."""

Found = TypeVar("Found")


class _StaleError(RegistryError):
    """A file is not the one that the manifest vouches for."""


class Published:
    """A published registry at one state; files are read on demand.

    Attributes:
        url: address of the registry, with a trailing slash.
        manifest: what is published.
        read: when the server last confirmed it.
        warnings: warnings for the user, as that the server cannot be reached.
    """

    def __init__(
        self, address: str, *, cache: Cache | None = None, signers: Path | None = None, fetch: Fetch = fetch
    ) -> None:
        """Read the manifest.

        Args:
            address: address of the folder.
            cache: cache of files; by default the user's own.
            signers: accepted signers; by default from $CALIBRARY_SIGNERS.
            fetch: function that downloads a file.

        Raises:
            RegistryError: the address is not valid, there is no published registry, it cannot be reached and was never
                read before, or it must not be used: it expired, goes back, or is signed by others.
        """
        self.url: Final = normalised(address)
        self._cache: Final = cache or Cache.of_user()
        named = os.environ.get(SIGNERS)
        self._signers: Final = signers or (Path(named) if named else None)
        self._fetch: Final = fetch
        self._indexes: dict[tuple[str, str, str], RegistryIndex] = {}
        self._list: PublishedList | None = None
        self._is_retry = False
        self._load()

    @property
    def commit(self) -> str:
        """Published commit."""
        return self.manifest.commit

    def index_for(self, key: CameraKey) -> RegistryIndex:
        """Return an index of the entries that may match a camera.

        Raises:
            RegistryError: a file cannot be read, or does not match its digest.
        """
        if not key.make or not key.model:
            return RegistryIndex((), _no_file)
        name = (match_key(key.make), match_key(key.model), match_key(key.serial or ""))
        found = self._indexes.get(name)
        if found is None:
            if len(self._indexes) >= MOST_INDEXES:
                self._indexes.clear()
            found = self._indexes[name] = self._consistent(partial(self._index, key))
        return found

    def _index(self, key: CameraKey) -> RegistryIndex:
        if self._list is None:
            self._list = self._decoded(PublishedList, self.manifest.cameras, LARGEST_LIST)
        listed = self._list
        make, model = match_key(key.make or ""), match_key(key.model or "")
        own = model_of(make, model)
        others = listed.aliases.get(own, ())[:MOST_ALIASES]
        units = [f"/{UNIT}{slug(key.serial)}"] if key.serial is not None else []
        names = [f"{name}{unit}" for name in (own, *others) for unit in ("", *units)]
        digests = [digest for name in names if (digest := listed.cameras.get(name)) is not None]
        files = [self._decoded(PublishedCamera, digest, LARGEST_CAMERA) for digest in digests]
        rows = {row.path: row for file in files for row in file.entries}
        return RegistryIndex(
            [*rows, *(path for file in files for path in file.refused)],
            lambda path: _entries(rows[path]) if path in rows else _no_entry(path),
            aliases=lambda: {(make, model): frozenset(f"{ROOT}{name}/" for name in others)},
        )

    def _decoded(self, kind: type[Found], digest: str, most: int) -> Found:
        """Read the file with a digest, from the cache if it is there.

        Raises:
            RegistryError: it cannot be read, or is not of this kind.
        """
        try:
            return msgspec.json.decode(self._cache.get(digest) or self._fetched(digest, most), type=kind)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            raise RegistryError(f"{self.url}{file_of(digest)}: is not as published: {error}") from None

    def _fetched(self, digest: str, most: int) -> bytes:
        """Download a file, verify it, and store it in the cache.

        Raises:
            _StaleError: the server has none, or another content.
            RegistryError: the server cannot be reached.
        """
        try:
            data = self._fetch(f"{self.url}{file_of(digest)}", most=most, fresh=self._is_retry)
        except FetchError as error:
            if error.status in GONE:
                raise _StaleError(str(error)) from None
            raise RegistryError(
                f"{error}; it is not in the cache" if error.is_temporary else str(error)
            ) from None
        if sha256(data) != digest:
            raise _StaleError(f"{self.url}{file_of(digest)}: is not the file that the manifest vouches for")
        self._cache.keep(data, digest)
        return data

    def _consistent(self, work: Callable[[], Found]) -> Found:
        """Run ``work`` with one state: repeat it with a new one if a file does not match.

        Raises:
            RegistryError: a file never matches: it is damaged on the server.
        """
        try:
            for pause_s in PAUSES_S:
                try:
                    return work()
                except _StaleError:
                    time.sleep(pause_s)
                    self._is_retry = True
                    self._load()
            return work()
        except _StaleError as error:
            raise RegistryError(
                f"{error}; it was damaged on the server or on the way, or is being published at this moment: try "
                "again, or publish it again"
            ) from None
        finally:
            self._is_retry = False

    def _load(self) -> None:
        """Read the manifest; errors as for the constructor."""
        memory = self._cache.trusted(self.url)
        known, told = _remembered(memory, self.url), None
        self.read = datetime.now(UTC)
        try:
            data = self._fetch(f"{self.url}{PUBLISHED_FILE}", most=LARGEST_MANIFEST, fresh=self._is_retry)
            found = opened(data, f"{self.url}{PUBLISHED_FILE}")
        except (FetchError, NoManifestError) as error:
            if isinstance(error, FetchError) and error.status in GONE:
                raise RegistryError(
                    f"{error}: no published registry here, expected {PUBLISHED_FILE} ('calibrary registry publish' "
                    "writes it)"
                ) from None
            if known is None or (isinstance(error, FetchError) and not error.is_temporary):
                raise
            self.read = datetime.fromtimestamp(memory.stat().st_mtime, UTC)
            found, told = known, f"{error}; the copy in the cache of {self.read:%Y-%m-%d %H:%M} UTC is used"
        require_trusted(found, known, self._signers, self.url, memory)
        if found is not known:
            told = _remember(memory, found, self.url)
        self.manifest: Manifest = found.manifest
        self.warnings: tuple[str, ...] = (told,) if told is not None else ()
        self._list = None
        self._indexes.clear()


def _remembered(memory: Path, url: str) -> Opened | None:
    """Return the manifest that was read last at an address; None if none was.

    Raises:
        RegistryError: it is damaged.
    """
    try:
        return opened(memory.read_bytes(), str(memory))
    except OSError:
        return None
    except RegistryError:
        raise RegistryError(f"{memory}: is damaged; remove it, and {url} is trusted anew") from None


def _remember(memory: Path, found: Opened, url: str) -> str | None:
    """Keep a manifest, unless another process has read a newer one; return a warning if it cannot be kept."""
    try:
        memory.parent.mkdir(parents=True, exist_ok=True)
        with writer_lock(memory.parent, wait_s=WAIT_S):
            newest = _remembered(memory, url)
            if newest is None or newest.manifest.version <= found.manifest.version:
                write_files({memory: found.data})
    except (OSError, RegistryError, InputError) as error:
        return f"{memory}: cannot be written ({error}), so that a later run would not notice an older state"
    return None


def _entries(row: PublishedEntry) -> Iterator[Entry]:
    """Yield what is in force of an entry on any day, first that of no particular one.

    Raises:
        RegistryError: it cannot be read.
    """
    for data in (row.entry, *row.others):
        yield replace(parsed(bytes(data), row.path), status=Status(row.status), reason=row.reason)


def _no_entry(path: str) -> tuple[Entry, ...]:
    raise RegistryError(
        f"{path}: its keeper's registry has it and cannot read it: 'calibrary registry check' says why"
    )


def _no_file(path: str) -> tuple[Entry, ...]:
    raise RegistryError(f"{path}: not there")
