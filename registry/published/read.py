"""Reader of a published registry: the entries of a camera, with every file verified from the root.

A root defines one state. A file that does not match it means that the registry was published again in between; then
the root is read again and the query repeated. If the server cannot be reached, the last root and the cached files are
used, with a warning about their age.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from calibrary.calibration import CameraKey
from calibrary.errors import InputError, RegistryError
from calibrary.known_camera import match_key
from calibrary.records import Record, from_json, replace
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import LARGEST_ENTRY, parse_entry
from calibrary.registry.paths import folder_of
from calibrary.registry.published.address import normalised
from calibrary.registry.published.cache import Cache, CachedRoot
from calibrary.registry.published.fetch import Fetch, FetchError, fetch
from calibrary.registry.published.layout import (
    ROOT_FILE,
    SIGNATURE_FILE,
    PublishedCamera,
    PublishedEntry,
    PublishedRegistry,
    PublishedTree,
    camera_path,
    entry_path,
    reason_against,
    sha256,
    tree_paths,
)
from calibrary.registry.resolution import RegistryIndex
from calibrary.strictjson import parse_json

__all__ = ["SIGNERS", "Published"]

SIGNERS: Final = "CALIBRARY_SIGNERS"
"""Environment variable with an "ALLOWED SIGNERS" file of ssh-keygen(1); a root must then be signed by one of them."""

LARGEST_ROOT: Final = 1 << 20
LARGEST_PART: Final = 1 << 20
LARGEST_CAMERA: Final = 4 << 20
LARGEST_SIGNATURE: Final = 64 << 10
PAUSES_S: Final = (0.0, 0.2, 0.6)
"""Seconds to wait before a file that does not match the root is read again."""
GONE: Final = frozenset({404, 410})
MOST_ALIASES: Final = 32
MOST_INDEXES: Final = 4096
"""Number of cameras whose entries are kept parsed."""
AT_ONCE: Final = 8
"""Number of files read at the same time."""

UNITS_S: Final[Mapping[str, int]] = {"days": 86400, "hours": 3600, "minutes": 60}

_VERSION = re.compile(r"calibrary/published-(\d{1,9})")

Kind = TypeVar("Kind", bound=Record)
Found = TypeVar("Found")


class _StaleError(RegistryError):
    """A file does not match the digest given by the root."""


class Published:
    """A published registry at one state; files are read on demand.

    Attributes:
        url: address of the registry, with a trailing slash.
        root: root of this state.
        read: time when the root was read from the server; in the past if it is from the cache.
        warnings: warnings for the user: the server cannot be reached, or has an older state than before.
    """

    def __init__(
        self,
        address: str,
        *,
        cache: Cache | None = None,
        signers: Path | None = None,
        fetch: Fetch = fetch,
    ) -> None:
        """Read the root.

        Args:
            address: address of the folder.
            cache: cache of files; by default the user's own.
            signers: accepted signers; by default from $CALIBRARY_SIGNERS.
            fetch: function that downloads a file.

        Raises:
            RegistryError: the address is not valid, there is no published registry, it cannot be reached and was never
                read before, or it is not signed by an accepted signer.
        """
        self.url: Final = normalised(address)
        self._cache: Final = cache or Cache.of_user()
        named = os.environ.get(SIGNERS)
        self._signers: Final = signers or (Path(named) if named else None)
        self._fetch: Final = fetch
        self._indexes: dict[tuple[str, str, str], RegistryIndex] = {}
        self._is_retry = False
        self.warnings: tuple[str, ...] = ()
        self._load_root()

    @property
    def commit(self) -> str:
        """Published commit."""
        return self.root.commit

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
        """Return the file of a make and model, or of a unit; None if it is not in the tree."""
        path = camera_path(key)
        part: Mapping[str, str] = self.root.tree
        for name, file in tree_paths(path, self.root.depth):
            digest = part.get(name)
            if digest is None or file is None:
                return None
            if file == path:
                return self._document(PublishedCamera, path, digest, LARGEST_CAMERA)
            part = self._document(PublishedTree, file, digest, LARGEST_PART).tree
        return None

    def _document(self, kind: type[Kind], path: str, digest: str, most: int) -> Kind:
        """Return a part of the tree or a camera file, parsed once per process."""
        found = self._cache.documents.get(digest)
        if not isinstance(found, kind):
            data = self._cache.get(digest) or self._fetched(path, digest, most)
            found = _verified_record(kind, data, f"{self.url}{path}")
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
            data = self._fetch(f"{self.url}{path}", most=most, fresh=self._is_retry).data or b""
        except FetchError as error:
            if error.status in GONE:
                raise _StaleError(str(error)) from None
            hint = "; it is not in the cache" if error.is_temporary else ""
            raise RegistryError(f"{error}{hint}") from None
        if sha256(data) != digest:
            raise _StaleError(f"{self.url}{path}: is not the file that {ROOT_FILE} vouches for")
        self._cache.keep(data, digest)
        return data

    def _consistent(self, work: Callable[[], Found]) -> Found:
        """Run ``work`` with a consistent root: repeat it with a new root if a file does not match.

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
                    self._load_root()
            return work()
        except _StaleError as error:
            raise RegistryError(
                f"{error}; it was damaged on the server or on the way, or is being published at this moment: try "
                "again, or publish it again"
            ) from None
        finally:
            self._is_retry = False

    def _load_root(self) -> None:
        """Read the root from the server; if the server cannot be reached, use the cached one.

        Raises:
            RegistryError: as for the constructor.
        """
        cached = self._cache.root(self.url)
        try:
            found = self._fetched_root(cached)
        except FetchError as error:
            if cached is None or not error.is_temporary:
                raise self._no_root(error) from None
            self._use_root(cached, (f"{error}; {_age(cached)} is used",))
            return
        self._use_root(found, _older_than_before(self.url, cached, found) if cached is not None else ())
        self._cache.keep_root(found)

    def _fetched_root(self, cached: CachedRoot | None) -> CachedRoot:
        """Download the root, and verify its signature if signers are given.

        Raises:
            FetchError: the download failed, or is not the root of a published registry.
            RegistryError: it is not signed by an accepted signer.
        """
        needs_signature = self._signers is not None and (cached is None or cached.signature is None)
        etag = cached.etag if cached is not None and not self._is_retry and not needs_signature else None
        for is_last in (False, True):
            answer = self._fetch(f"{self.url}{ROOT_FILE}", most=LARGEST_ROOT, etag=etag, fresh=self._is_retry)
            now = datetime.now(UTC)
            if answer.data is None and cached is not None:
                return replace(cached, read=now)
            text = _root_text(self.url, answer.data or b"")
            found = CachedRoot(
                url=self.url,
                etag=answer.etag,
                read=now,
                sha256=sha256(text.encode()),
                text=text,
                signature=self._fetched_signature() if self._signers is not None else None,
            )
            reason = _reason_against(found, self._signers)
            if reason is None:
                break
            # Root and signature are separate files: the registry may have been published again between the two.
            if is_last:
                raise RegistryError(f"{self.url}: {reason}")
            self._is_retry = True
        return found

    def _fetched_signature(self) -> str | None:
        try:
            answer = self._fetch(f"{self.url}{SIGNATURE_FILE}", most=LARGEST_SIGNATURE, fresh=self._is_retry)
        except FetchError as error:
            if error.status in GONE:
                return None
            raise
        return (answer.data or b"").decode("ascii", "replace")

    def _use_root(self, cached: CachedRoot, warnings: tuple[str, ...]) -> None:
        """Use a root as the state of this reader.

        Raises:
            RegistryError: it is not signed by an accepted signer.
        """
        reason = _reason_against(cached, self._signers)
        if reason is not None:
            raise RegistryError(f"{self.url}: {reason}")
        self.root = _record(PublishedRegistry, cached.text.encode(), f"{self.url}{ROOT_FILE}")
        self.read = cached.read
        self.warnings = warnings
        self._indexes.clear()

    def _no_root(self, error: FetchError) -> RegistryError:
        if error.status in GONE:
            return RegistryError(
                f"{self.url}: no published registry here, expected {ROOT_FILE} ('calibrary registry publish' writes it)"
            )
        return error


def _record(kind: type[Kind], data: bytes, source: str) -> Kind:
    """Parse a document of the registry.

    Raises:
        RegistryError: the document is not valid.
    """
    try:
        return from_json(kind, parse_json(data, source=source), source=source)
    except InputError as error:
        raise RegistryError(str(error)) from None


def _verified_record(kind: type[Kind], data: bytes, source: str) -> Kind:
    """Parse a verified file in one step; if this fails, the slower parser gives the error message."""
    try:
        return msgspec.json.decode(data, type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return _record(kind, data, source)


def _root_text(url: str, data: bytes) -> str:
    """Return the text of a root.

    Raises:
        FetchError: it is not a root. It may be a login page, so the cache may be used instead.
    """
    source = f"{url}{ROOT_FILE}"
    try:
        text = data.decode()
    except UnicodeDecodeError:
        raise FetchError(f"{source}: is not UTF-8 text", is_temporary=True) from None
    version = _VERSION.search(text[:200])
    if version is not None and int(version[1]) > 1:
        raise FetchError(
            f"{source}: is of version {version[1]}, and this calibrary reads version 1; upgrade it",
            is_temporary=False,
        )
    try:
        _record(PublishedRegistry, data, source)
    except RegistryError as error:
        raise FetchError(str(error), is_temporary=True) from None
    return text


def _age(cached: CachedRoot) -> str:
    """Return the age of a cached copy in words."""
    seconds = max(0.0, (datetime.now(UTC) - cached.read).total_seconds())
    number, unit = next(
        ((int(seconds // size), name) for name, size in UNITS_S.items() if seconds >= 2 * size), (0, "")
    )
    old = f"{number} {unit} old" if unit else "less than two minutes old"
    return f"the copy in the cache of {cached.read:%Y-%m-%d %H:%M} UTC, {old},"


def _older_than_before(url: str, cached: CachedRoot, found: CachedRoot) -> tuple[str, ...]:
    """Return a warning if the server has an older state than before, such as a restored backup or from an attacker."""
    before, now = (_record(PublishedRegistry, one.text.encode(), url) for one in (cached, found))
    if now.date >= before.date:
        return ()
    return (
        f"{url}: is of {now.date:%Y-%m-%d %H:%M} UTC, older than what was read before "
        f"({before.date:%Y-%m-%d %H:%M} UTC, commit {before.commit[:12]})",
    )


def _reason_against(root: CachedRoot, signers: Path | None) -> str | None:
    """Return why a root must not be used; None if it has an accepted signature, or no signers are given."""
    if signers is None:
        return None
    if root.signature is None:
        return f"is not signed, and ${SIGNERS} asks for a signature"
    return reason_against(root.text.encode(), root.signature, signers)


def _revisions(row: PublishedEntry, contents: Mapping[str, bytes]) -> Iterator[tuple[str, Entry]]:
    """Yield the earlier usable revisions of an entry, newest first."""
    for one in row.earlier:
        yield one.commit, parse_entry(contents[one.sha256], row.path)


def _no_file(path: str) -> bytes:
    raise RegistryError(f"{path}: not there")
