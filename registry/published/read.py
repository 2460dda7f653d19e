"""Reader of a published registry: the entries of a camera, with every file verified from its metadata.

The metadata defines one state. A file that does not match it means that the registry was published again in between;
then the metadata is read again and the query repeated. If the server cannot be reached, the last state and the cached
files are used, with a warning about their age.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from calibrary.calibration import CameraKey
from calibrary.errors import InputError, RegistryError
from calibrary.known_camera import match_key
from calibrary.records import from_json
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import LARGEST_ENTRY, parse_entry
from calibrary.registry.paths import folder_of
from calibrary.registry.places import PUBLISHED_FILE
from calibrary.registry.published.address import normalised
from calibrary.registry.published.cache import Cache
from calibrary.registry.published.fetch import Fetch, FetchError, fetch
from calibrary.registry.published.layout import (
    PublishedCamera,
    PublishedEntry,
    camera_path,
    entry_path,
    sha256,
)
from calibrary.registry.published.trust import GONE, SIGNERS, MixedError, Trust
from calibrary.registry.resolution import RegistryIndex
from calibrary.strictjson import parse_json

LARGEST_CAMERA: Final = 4 << 20
PAUSES_S: Final = (0.0, 0.2, 0.6)
"""Seconds to wait before a file that does not match the root is read again."""
MOST_ALIASES: Final = 32
MOST_INDEXES: Final = 4096
"""Number of cameras whose entries are kept parsed."""
AT_ONCE: Final = 8
"""Number of files read at the same time."""

UNITS_S: Final[Mapping[str, int]] = {"days": 86400, "hours": 3600, "minutes": 60}

Found = TypeVar("Found")


class _StaleError(RegistryError):
    """A file does not match the digest given by the metadata."""


class Published:
    """A published registry at one state; files are read on demand.

    Attributes:
        url: address of the registry, with a trailing slash.
        state: what is published.
        warnings: warnings for the user, as that the server cannot be reached.
    """

    def __init__(
        self, address: str, *, cache: Cache | None = None, signers: Path | None = None, fetch: Fetch = fetch
    ) -> None:
        """Read the metadata.

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
        self._is_retry = False
        self._load()

    @property
    def commit(self) -> str:
        """Published commit."""
        return self.state.commit

    @property
    def expires(self) -> datetime:
        """When this state must not be used any more."""
        return self._trust.expires

    @property
    def read(self) -> datetime:
        """When the server last confirmed this state."""
        return self._trust.read

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
        make, model = key.make or "", key.model or ""
        model_file = self._camera(CameraKey(make=make, model=model))
        aliases = model_file.aliases[:MOST_ALIASES] if model_file is not None else ()
        names = [(make, model), *((name.make, name.model) for name in aliases)]
        serials = [None, key.serial] if key.serial is not None else [None]
        keys = [CameraKey(make=one[0], model=one[1], serial=serial) for one in names for serial in serials]
        files = [self._camera(one) for one in keys]
        rows = {row.path: row for file in files if file is not None for row in file.entries}
        contents = self._entries([row.sha256 for row in rows.values()])
        earlier = self._entries([one.sha256 for row in rows.values() for one in row.earlier])
        folders = frozenset(folder_of(*name) for name in names[1:])
        return RegistryIndex(
            rows,
            lambda path: contents[rows[path].sha256],
            aliases=lambda: {(match_key(make), match_key(model)): folders} if folders else {},
            earlier=lambda path: _revisions(rows[path], earlier),
        )

    def _camera(self, key: CameraKey) -> PublishedCamera | None:
        """Return the file of a make and model, or of a unit, parsed once per process; None if it is not listed."""
        path = camera_path(key)
        try:
            digest = self._trust.digest(path)
        except FetchError as error:
            raise _unread(error) from None
        if digest is None:
            return None
        found = self._cache.documents.get(digest)
        if found is None:
            data = self._cache.get(digest) or self._fetched(path, digest, LARGEST_CAMERA)
            found = _verified_camera(data, f"{self.url}{path}")
            self._cache.remember(digest, found)
        return found

    def _entries(self, digests: Sequence[str]) -> dict[str, bytes]:
        """Return entry files by digest; several are downloaded at a time."""
        kept = {digest: self._cache.get(digest) for digest in dict.fromkeys(digests)}
        found = {digest: data for digest, data in kept.items() if data is not None}
        missing = [digest for digest in kept if digest not in found]
        fetched = partial(self._fetched, most=LARGEST_ENTRY)
        if len(missing) <= 1:
            return found | {digest: fetched(entry_path(digest), digest) for digest in missing}
        with ThreadPoolExecutor(max_workers=AT_ONCE) as pool:
            return found | dict(
                zip(missing, pool.map(fetched, map(entry_path, missing), missing), strict=True)
            )

    def _fetched(self, path: str, digest: str, most: int) -> bytes:
        """Download a file, verify it, and store it in the cache.

        Raises:
            _StaleError: the server has another content.
            RegistryError: the server cannot be reached.
        """
        try:
            data = self._fetch(f"{self.url}{path}", most=most, fresh=self._is_retry)
        except FetchError as error:
            raise _unread(error) from None
        if sha256(data) != digest:
            raise _StaleError(f"{self.url}{path}: is not the file that the metadata vouches for")
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
        """Read the metadata; errors as for the constructor.

        It may be published at this moment, or a cache on the way may give an old file, so what is missing or does not
        fit is read again.
        """
        folder = self._cache.trusted(self.url)
        for pause_s in (*PAUSES_S, None):
            try:
                self._trust, unkept = self._trusted(folder)
                break
            except (_StaleError, MixedError) as error:
                if pause_s is None:
                    raise RegistryError(str(error)) from None
                time.sleep(pause_s)
                self._is_retry = True
        self.state = self._trust.state
        offline = self._trust.offline
        told = f"{offline}; {_age(self._trust.read)} is used" if offline is not None else None
        self.warnings: tuple[str, ...] = tuple(one for one in (told, unkept) if one is not None)
        self._indexes.clear()

    def _trusted(self, folder: Path) -> tuple[Trust, str | None]:
        """Read the metadata; also return a warning if what is trusted cannot be kept."""
        how = partial(Trust, self.url, fetch=self._fetch, signers=self._signers, fresh=self._is_retry)
        try:
            try:
                return how(folder=folder), None
            except OSError as error:
                # What is trusted already holds even where nothing more can be kept.
                temporary = Path(tempfile.mkdtemp())
                weakref.finalize(self, shutil.rmtree, temporary, ignore_errors=True)
                with suppress(OSError):
                    shutil.copytree(
                        folder, temporary, dirs_exist_ok=True, ignore=shutil.ignore_patterns("*.lock")
                    )
                unkept = f"{folder}: cannot be written ({error}), so that a later run would not notice an older state"
                return how(folder=temporary), unkept
        except FetchError as error:
            if error.status not in GONE:
                raise
            if PUBLISHED_FILE in str(error):
                raise RegistryError(
                    f"{self.url}: no published registry here, expected {PUBLISHED_FILE} "
                    "('calibrary registry publish' writes it)"
                ) from None
            raise _StaleError(str(error)) from None


def _unread(error: FetchError) -> RegistryError:
    """Return the error for a file that could not be downloaded."""
    if error.status in GONE:
        return _StaleError(str(error))
    return RegistryError(f"{error}; it is not in the cache" if error.is_temporary else str(error))


def _verified_camera(data: bytes, source: str) -> PublishedCamera:
    """Parse a verified file in one step; if this fails, the slower parser gives the error message."""
    try:
        return msgspec.json.decode(data, type=PublishedCamera)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        pass
    try:
        return from_json(PublishedCamera, parse_json(data, source=source), source=source)
    except InputError as error:
        raise RegistryError(str(error)) from None


def _age(read: datetime) -> str:
    """Return the age of a cached copy in words."""
    seconds = max(0.0, (datetime.now(UTC) - read).total_seconds())
    number, unit = next(
        ((int(seconds // size), name) for name, size in UNITS_S.items() if seconds >= 2 * size), (0, "")
    )
    old = f"{number} {unit} old" if unit else "less than two minutes old"
    return f"the copy in the cache of {read:%Y-%m-%d %H:%M} UTC, {old},"


def _revisions(row: PublishedEntry, contents: Mapping[str, bytes]) -> Iterator[tuple[str, Entry]]:
    """Yield the earlier usable revisions of an entry, newest first."""
    for one in row.earlier:
        yield one.commit, parse_entry(contents[one.sha256], row.path)


def _no_file(path: str) -> bytes:
    raise RegistryError(f"{path}: not there")
