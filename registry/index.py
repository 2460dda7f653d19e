"""Index of a registry's entries at a commit, cached between runs and updated by the differences.

Reading 100 000 entries takes a minute, listing their trees a second. An :class:`Index` uses a file in the user's cache
folder (:mod:`calibrary.registry.index_file`) with the files of a commit, the names stated in their content (aliases,
superseded entries), and parsed entries by git's id of their file. Its results equal those of git at that commit; a
test compares the two over random histories.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Final, TypeVar

import msgspec
from msgspec import Struct
from platformdirs import user_cache_path

from calibrary.errors import InputError
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import LARGEST_ENTRY, parse_entry
from calibrary.registry.fields import Row, Value, entry_row
from calibrary.registry.git.history import changed
from calibrary.registry.git.repository import Repository
from calibrary.registry.index_file import ENTRIES, ROWS, IndexFile, Mention
from calibrary.registry.paths import CAMERAS, PROPOSALS, folder_of, is_entry, is_proposal, match_key
from calibrary.registry.resolution import AliasMap, is_keyed
from calibrary.strictyaml import load_yaml

__all__ = [
    "ALIAS",
    "IRREGULAR",
    "LABEL",
    "SUPERSEDES",
    "Index",
    "claimed_folder",
    "index_at",
    "label_in",
    "parsed_or_error",
    "said",
]

VERSION: Final = f"2 {' '.join(Entry.__struct_fields__)}"
"""Version of the stored form; an index with another version is rebuilt."""
BLOCK: Final = 500

LINE_OF_LABEL: Final = re.compile(rb"^label:.*$", re.MULTILINE)
T = TypeVar("T")
ALIAS, LABEL, SUPERSEDES, IRREGULAR = "alias", "label", "supersedes", "irregular"
SAYING: Final = (b"aliases", b"supersedes")
"""Keys of a file that may state names; files without them are not parsed for this."""
_PACKED: Final = msgspec.msgpack.Decoder(Entry)
_ROW: Final = msgspec.msgpack.Decoder(dict[str, Value])


def said(path: str, entry: Entry) -> Iterator[Mention]:
    """Yield the names that an entry states and others look up, by kind; see :meth:`Index.mentions`."""
    camera = entry.calibration.camera
    if entry.label is not None:
        yield path, LABEL, match_key(entry.label), entry.label
    for alias in entry.aliases:
        name = f"{match_key(alias.make)}\n{match_key(alias.model)}"
        yield path, ALIAS, name, folder_of(camera.make or "", camera.model or "")
    if entry.supersedes is not None:
        yield path, SUPERSEDES, entry.supersedes, ""


def claimed_folder(name: str) -> str:
    """Return the folder for entries of the camera named by an alias."""
    make, _, model = name.partition("\n")
    return folder_of(make, model)


class _Overlay(Struct, frozen=True):
    """Difference between the commit of the file and the requested one."""

    files: Mapping[str, str | None]
    mentions: tuple[Mention, ...]


class Index:
    """The files of a registry at one commit, and the names that they state."""

    def __init__(self, repo: Repository, commit: str, file: IndexFile) -> None:
        """Set up without reading anything; see :func:`index_at`."""
        self._repo = repo
        self._commit = commit
        self._file = file
        self._overlays: dict[str, _Overlay] = {}
        self._whole: tuple[dict[str, str], tuple[Mention, ...]] | None = None

    @cached_property
    def files(self) -> Mapping[str, str]:
        """Ids of all files in ``cameras/`` and ``proposals/``, by path, sorted."""
        found = self._asked(self._file.files)
        if found is None:
            return MappingProxyType(self._read_whole()[0])
        base, files = found
        if base != self._commit:
            for path, oid in self._overlay(base).files.items():
                if oid is None:
                    files.pop(path, None)
                else:
                    files[path] = oid
            files = dict(sorted(files.items()))
        return MappingProxyType(files)

    def mentions(self, kind: str) -> list[Mention]:
        """Return the names of one kind stated by all entries, sorted by path."""
        found = self._asked(lambda: self._file.mentions(kind))
        if found is None:
            return sorted(one for one in self._read_whole()[1] if one[1] == kind)
        base, mentions = found
        if base != self._commit:
            overlay = self._overlay(base)
            mentions = [one for one in mentions if one[0] not in overlay.files]
            mentions += [one for one in overlay.mentions if one[1] == kind]
        return sorted(mentions)

    @cached_property
    def aliases(self) -> AliasMap:
        """Folders with entries in ``cameras/`` that have an alias (make, model), by the alias as match keys."""
        found: dict[tuple[str, str], set[str]] = {}
        for path, _, name, folder in self.mentions(ALIAS):
            if not is_proposal(path):
                make, _, model = name.partition("\n")
                found.setdefault((make, model), set()).add(folder)
        return {name: frozenset(folders) for name, folders in found.items()}

    @cached_property
    def irregular(self) -> tuple[str, ...]:
        """Paths in ``cameras/`` that no camera's key gives."""
        return tuple(path for path, *_ in self.mentions(IRREGULAR))

    def parsed(self, files: Iterable[tuple[str, str, bytes]]) -> Iterator[tuple[str, Entry | InputError]]:
        """Yield the entries of files with their paths; the error if one cannot be read.

        Args:
            files: id, path and content of each; the content has been verified against the id.
        """
        source = iter(files)
        while block := [*islice(source, BLOCK)]:
            kept = self._file.kept(ENTRIES, [oid for oid, _, _ in block])
            new: dict[str, bytes] = {}
            for oid, path, data in block:
                entry = _unpacked(_PACKED, kept.get(oid)) or parsed_or_error(path, data)
                if oid not in kept and isinstance(entry, Entry):
                    new[oid] = msgspec.msgpack.encode(entry)
                yield path, entry
            if new:
                self._file.keep(ENTRIES, new)

    def rows(self, files: Iterable[tuple[str, str]]) -> Iterator[tuple[str, Row | InputError]]:
        """Yield the fields of the entries of files with their paths; the error if one cannot be read.

        Args:
            files: id and path of each; only those that are not cached are read.

        Raises:
            RegistryError: a file is not in the repository.
        """
        source = iter(files)
        while block := [*islice(source, BLOCK)]:
            packed = self._file.kept(ROWS, [oid for oid, _ in block])
            kept = {oid: row for oid in packed if (row := _unpacked(_ROW, packed[oid])) is not None}
            missing = [one for one in block if one[0] not in kept]
            contents = self._repo.read_many([oid for oid, _ in missing])
            read = self.parsed((oid, path, data) for (oid, path), data in zip(missing, contents, strict=True))
            new = {path: entry_row(entry) if isinstance(entry, Entry) else entry for path, entry in read}
            for oid, path in block:
                yield path, new[path] if path in new else kept[oid]
            if new:
                rows = {oid: new[path] for oid, path in missing}
                self._file.keep(
                    ROWS,
                    {oid: msgspec.msgpack.encode(row) for oid, row in rows.items() if isinstance(row, dict)},
                )

    def _asked(self, ask: Callable[[], tuple[str, T] | None]) -> tuple[str, T] | None:
        """Query the file, after updating it to a commit from which this one can be reached."""
        if self._whole is not None:
            return None
        base = self._file.commit()
        if base is None or not self._repo.holds(base):
            files, mentions = self._read_whole()
            self._file.replace(self._commit, files, mentions)
            return None
        if base != self._commit and self._repo.tip() == self._commit:
            overlay = self._overlay(base)
            self._file.advance(base, self._commit, overlay.files, overlay.mentions)
        found = ask()
        if found is None or not self._repo.holds(found[0]):
            self._read_whole()
            return None
        return found

    def _overlay(self, base: str) -> _Overlay:
        if base not in self._overlays:
            differing = [
                file for folder in FOLDERS for file in changed(self._repo, base, self._commit, folder)
            ]
            files = {file.path: file.after for file in differing}
            there = {path: oid for path, oid in files.items() if oid is not None}
            self._overlays[base] = _Overlay(files, tuple(_all_said(self._repo, there)))
        return self._overlays[base]

    def _read_whole(self) -> tuple[dict[str, str], tuple[Mention, ...]]:
        if self._whole is None:
            files = self._repo.listing(self._commit, *FOLDERS)
            self._whole = files, tuple(_all_said(self._repo, files))
        return self._whole


FOLDERS: Final = (CAMERAS, PROPOSALS)


def index_at(repo: Repository, commit: str, *, folder: Path | None = None) -> Index:
    """Return the index of a commit.

    Args:
        repo: the repository.
        commit: 40 hexadecimal digits.
        folder: folder of the cache file; by default the user's cache folder.
    """
    folder = folder or user_cache_path("calibrary", appauthor=False) / "registry-index"
    name = str(repo.common_dir)
    digest = hashlib.sha256(name.encode("utf-8", "surrogateescape")).hexdigest()[:32]
    shown = name.encode("utf-8", "backslashreplace").decode()
    return Index(repo, commit, IndexFile(folder / f"{digest}.sqlite", shown, VERSION))


def _all_said(repo: Repository, files: Mapping[str, str]) -> Iterator[Mention]:
    paths: Sequence[str] = [path for path in files if is_entry(path)]
    for path, data in zip(paths, repo.read_many([files[path] for path in paths]), strict=True):
        if not is_proposal(path) and not is_keyed(path):
            yield path, IRREGULAR, "", ""
        if any(word in data for word in SAYING):
            entry = parsed_or_error(path, data, require_digest=False)
            if isinstance(entry, Entry):
                yield from said(path, entry)
                continue
        if (label := label_in(data)) is not None:
            yield path, LABEL, match_key(label), label


def label_in(data: bytes) -> str | None:
    """Return the label in an entry's file, from its line alone."""
    if (line := LINE_OF_LABEL.search(data)) is None:
        return None
    try:
        stated = load_yaml(line[0], source="label", max_bytes=LARGEST_ENTRY, max_depth=1)
    except InputError:
        return None
    label = stated.get("label") if isinstance(stated, dict) else None
    return label if isinstance(label, str) else None


def parsed_or_error(path: str, data: bytes, *, require_digest: bool = True) -> Entry | InputError:
    """Return the entry of a file, or the error."""
    try:
        return parse_entry(data, path, require_digest=require_digest)
    except InputError as error:
        return error


def _unpacked(decoder: msgspec.msgpack.Decoder[T], packed: bytes | None) -> T | None:
    try:
        return decoder.decode(packed) if packed is not None else None
    except (msgspec.DecodeError, InputError):
        return None
