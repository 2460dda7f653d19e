"""The entries of a registry at one state: a commit in git, or a plain folder of files.

A registry in git is always read from commits, never from its work tree, so that a run can state the commit it used.
Files in a folder are read only on explicit request, as ``folder:PATH``: a damaged repository must not be mistaken for
a folder of files that anyone may have edited.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import date
from functools import cached_property, partial
from pathlib import Path
from types import MappingProxyType

from msgspec import Struct

from calibrary.calibration import CameraKey
from calibrary.errors import InputError, RegistryError, first_of
from calibrary.known_camera import match_key
from calibrary.registry.configuration import Configuration
from calibrary.registry.entry import USABLE, Entry, Status
from calibrary.registry.entry_yaml import LARGEST_ENTRY, parse_entry
from calibrary.registry.fields import Row, entry_row
from calibrary.registry.git.history import history
from calibrary.registry.git.repository import Repository
from calibrary.registry.index import LABEL, Index, index_at, label_in, parsed_or_error
from calibrary.registry.paths import (
    PROPOSED,
    ROOT,
    find_paths,
    folder_of,
    id_of,
    in_use_path,
    is_entry,
    is_proposal,
    proposal_path,
    single_match,
    unit_folder,
    unit_paths,
)
from calibrary.registry.resolution import RegistryIndex, Resolution
from calibrary.registry.stored import StoredEntry, require_own_path
from calibrary.registry.writing import parsed

__all__ = ["Snapshot", "entry_paths", "proposal_paths", "read_entry_file", "used_before"]


def entry_paths(root: Path) -> list[str]:
    """Return the sorted paths of all entries below a registry's root; links to folders are not followed.

    Raises:
        RegistryError: there is no registry here, or a folder cannot be read.
    """
    if not (root / ROOT).is_dir():
        raise RegistryError(
            f"{root}: no registry here: expected a folder 'cameras' with one YAML file a camera"
        )
    return _entries_below(root, ROOT)


def proposal_paths(root: Path) -> list[str]:
    """Return the same for proposals."""
    return _entries_below(root, PROPOSED)


def _entries_below(root: Path, top: str) -> list[str]:
    def refuse(error: OSError) -> None:
        raise RegistryError(f"{error.filename}: cannot be read: {error.strerror}") from None

    start = len(str(root)) + 1 if str(root) != "." else 0
    found = []
    for folder, _, names in os.walk(root / top, onerror=refuse) if (root / top).is_dir() else ():
        below = folder[start:].replace(os.sep, "/")
        found += [f"{below}/{name}" for name in names if is_entry(name)]
    return sorted(found)


def read_entry_file(root: Path, path: str) -> bytes:
    """Return the content of one entry file.

    Raises:
        RegistryError: it is not a regular file, too large, or cannot be read.
    """
    file = root / path
    try:
        if file.is_symlink() or not file.is_file():
            raise RegistryError(f"{path}: expected a regular file")
        with file.open("rb") as opened:
            data = opened.read(LARGEST_ENTRY + 1)
    except OSError as error:
        raise RegistryError(f"{path}: cannot be read: {error.strerror}") from None
    if len(data) > LARGEST_ENTRY:
        raise RegistryError(f"{path}: is larger than {LARGEST_ENTRY >> 10} KiB, expected one camera's entry")
    return data


class Snapshot(Struct, frozen=True, kw_only=True, eq=False, dict=True):
    """A registry's entries at one immutable state; files are read on demand.

    Attributes:
        place: folder of the registry.
        configuration: configuration of the registry, with the policy for entries.
        repo: the repository; None for a plain folder.
        commit: 40 hexadecimal digits; None for a plain folder.
        known_paths: the paths, if they are already known.
    """

    place: Path
    configuration: Configuration
    repo: Repository | None = None
    commit: str | None = None
    known_paths: Mapping[str, str | None] | None = None

    @cached_property
    def paths(self) -> Mapping[str, str | None]:
        """Blob id of every file below ``cameras/``, by path; None in a plain folder.

        Raises:
            RegistryError: there is no registry in the folder, or it cannot be listed.
        """
        if self.known_paths is not None:
            return self.known_paths
        if self.repo is None or self.commit is None:
            return MappingProxyType(dict.fromkeys(entry_paths(self.place)))
        # Calling is_proposal 100 000 times would take as long as everything else.
        files = self.contents.files.items()
        return MappingProxyType({path: oid for path, oid in files if not path.startswith(PROPOSED)})

    @cached_property
    def proposed(self) -> Mapping[str, str | None]:
        """Blob id of every file below ``proposals/``, by path; None in a plain folder.

        Raises:
            RegistryError: the folder cannot be listed.
        """
        if self.repo is None or self.commit is None:
            return MappingProxyType(dict.fromkeys(proposal_paths(self.place)))
        files = self.contents.files.items()
        return MappingProxyType({path: oid for path, oid in files if path.startswith(PROPOSED)})

    @cached_property
    def contents(self) -> Index:
        """The index of the commit, for a registry in git."""
        return index_at(*self.require_git("has no index"))

    def waiting(self, paths: Iterable[str]) -> str | None:
        """Return a sentence about entries in ``paths`` with another K waiting for approval; None if there are none."""
        ids = [
            id_of(path) for path in paths if not is_proposal(path) and proposal_path(path) in self.proposed
        ]
        if not ids:
            return None
        show = "('calibrary registry show proposals/…')"
        return f"another K is proposed and not approved, so not used: {first_of(ids)} {show}"

    def require_git(self, why: str) -> tuple[Repository, str]:
        """Return the repository and the commit.

        Raises:
            RegistryError: the registry is a plain folder; ``why`` completes the message.
        """
        if self.repo is None or self.commit is None:
            raise RegistryError(f"{self.place}: a plain folder {why}")
        return self.repo, self.commit

    def read(self, path: str) -> bytes:
        """Return the content of an entry file.

        Raises:
            RegistryError: it does not exist, or cannot be read.
        """
        if self.repo is None or self.commit is None:
            return read_entry_file(self.place, path)
        blob = self.repo.read(self.commit, path)
        if blob is None:
            raise RegistryError(f"{path}: not in commit {self.commit[:12]}")
        return blob.data

    def read_many(self, paths: Sequence[str]) -> Iterator[bytes]:
        """Yield the contents of many entry files, in order, using few processes.

        Raises:
            RegistryError: a file does not exist, or cannot be read.
        """
        if self.repo is None:
            return (self.read(path) for path in paths)
        oids = [oid for path in paths if (oid := self._oid(path)) is not None]
        if len(oids) < len(paths):
            missing = next(path for path in paths if self._oid(path) is None)
            raise RegistryError(f"{missing}: not in commit {(self.commit or '')[:12]}")
        return self.repo.read_many(oids)

    def _oid(self, path: str) -> str | None:
        return (self.proposed if is_proposal(path) else self.paths).get(path)

    def files(self) -> Iterator[tuple[str, bytes]]:
        """Yield path and content of every entry in ``cameras/``, sorted by path.

        Raises:
            RegistryError: an entry cannot be read.
        """
        paths = sorted(self.paths)
        return zip(paths, self.read_many(paths), strict=True)

    def entries(
        self,
        *,
        unreadable: Callable[[RegistryError], None] | None = None,
        where: Callable[[str], bool] | None = None,
    ) -> Iterator[StoredEntry]:
        """Yield every entry in ``cameras/``, sorted by path.

        Args:
            where: selects paths; other entries are not read.
            unreadable: called with the error of each entry that cannot be read; the others are still returned.

        Raises:
            RegistryError: an entry cannot be read and ``unreadable`` is not given.
        """
        paths = sorted(filter(where, self.paths))
        return self._stored(zip(paths, self.read_many(paths), strict=True), unreadable)

    def proposals(
        self,
        *,
        unreadable: Callable[[RegistryError], None] | None = None,
        where: Callable[[str], bool] | None = None,
    ) -> Iterator[StoredEntry]:
        """Yield every proposal, sorted by path; otherwise like :meth:`entries`."""
        paths = sorted(filter(where, (path for path in self.proposed if is_entry(path))))
        return self._stored(zip(paths, self.read_many(paths), strict=True), unreadable)

    def rows(
        self, paths: Iterable[str], *, unreadable: Callable[[RegistryError], None]
    ) -> Iterator[tuple[str, Row]]:
        """Yield the fields of the entries at some paths, in order, without creating entries.

        Args:
            paths: paths in ``cameras/`` and ``proposals/``.
            unreadable: called with the error of each entry that cannot be read.
        """
        wanted = sorted(paths)
        if self.repo is None:
            files = self._read_as_entries(zip(wanted, self.read_many(wanted), strict=True))
            found: Iterable[tuple[str, Row | InputError]] = (
                (path, entry_row(entry) if isinstance(entry, Entry) else entry) for path, entry in files
            )
        else:
            found = self.contents.rows((self._oid(path) or "", path) for path in wanted)
        for path, row in found:
            if isinstance(row, InputError):
                unreadable(RegistryError(str(row)))
            else:
                yield path, row

    def stored(self, paths: Sequence[str]) -> tuple[StoredEntry, ...]:
        """Return the entries at some paths, in order.

        Raises:
            RegistryError: an entry does not exist, or cannot be read.
        """
        return tuple(self._stored(zip(paths, self.read_many(paths), strict=True), None))

    def _stored(
        self, files: Iterable[tuple[str, bytes]], unreadable: Callable[[RegistryError], None] | None
    ) -> Iterator[StoredEntry]:
        for path, entry in self._read_as_entries(files):
            if isinstance(entry, Entry):
                yield self._as_stored(entry, path)
                continue
            error = RegistryError(str(entry))
            if unreadable is None:
                raise error
            unreadable(error)

    def _read_as_entries(
        self, files: Iterable[tuple[str, bytes]]
    ) -> Iterator[tuple[str, Entry | InputError]]:
        if self.repo is None:
            return ((path, parsed_or_error(path, data, require_digest=False)) for path, data in files)
        return self.contents.parsed((self._oid(path) or "", path, data) for path, data in files)

    def _as_stored(self, entry: Entry, path: str) -> StoredEntry:
        oid, proposal = self._oid(path), self.proposal_for(path)
        return StoredEntry(entry=entry, path=path, oid=oid, commit=self.commit, proposal=proposal)

    def proposal_for(self, path: str) -> str | None:
        """Return the path of the proposal to replace an entry; None if there is none."""
        proposal = proposal_path(path)
        return proposal if proposal != path and proposal in self.proposed else None

    def at(self, path: str) -> StoredEntry | None:
        """Return the entry at a path; None if there is none.

        Raises:
            RegistryError: the entry cannot be read.
        """
        if path not in (self.proposed if is_proposal(path) else self.paths):
            return None
        return self._as_stored(self._parsed(path, self.read(path)), path)

    def pending(self, key: str) -> StoredEntry:
        """Return the proposal that a KEY names; in older registries also a draft in ``cameras/``.

        Raises:
            UnknownCameraError: there is neither a proposal nor an entry of that name.
            RegistryError: the KEY matches several.
        """
        name = in_use_path(key)
        waiting = f"{PROPOSED}{name.removeprefix(ROOT)}"
        return self.get(waiting if self.matching(waiting) else key)

    def get(self, key: str) -> StoredEntry:
        """Return the entry that a KEY names; the proposal, if no entry of that name is in use.

        Args:
            key: see :func:`calibrary.registry.paths.find_path`; ``proposals/…`` names a proposal.

        Raises:
            UnknownCameraError: the camera does not exist.
            RegistryError: several entries match, or the entry cannot be read, or is of another camera than its path.
        """
        path = self.find(key)
        return require_own_path(self._as_stored(self._parsed(path, self.read(path)), path))

    def find(self, key: str) -> str:
        """Return the path of the entry that a KEY names; errors as for :meth:`get`."""
        found = self.matching(key)
        # If nothing matches, the error message lists similar names.
        every = found or {*self.paths, *map(in_use_path, self.proposed)}
        return single_match(found, every, key)

    def matching(self, key: str) -> list[str]:
        """Return the paths of all entries that a KEY may name; the proposals, if no entry of that name is in use.

        Args:
            key: as for :func:`calibrary.registry.paths.find_paths`, or a unit's label, its serial number or the
                beginning of its hash, optionally followed by a slash and the beginning of the variant.
        """
        if not is_proposal(key) and (found := self.in_use(key)):
            return found
        proposed = {in_use_path(path): path for path in self.proposed if is_entry(path)}
        name = in_use_path(key)
        if not proposed:
            return []
        return [proposed[path] for path in find_paths(proposed, name) or self.of_unit(proposed, name)]

    def in_use(self, key: str) -> list[str]:
        """Return the paths in ``cameras/`` of all entries that a KEY may name."""
        return find_paths(self.paths, key) or self.of_unit(self.paths, key)

    def of_unit(self, paths: Collection[str], key: str) -> list[str]:
        """Return those of some paths that a KEY by a unit's label or serial number may name."""
        return unit_paths(paths, key, labels=lambda: self.labels, makes=self._makes)

    @cached_property
    def labels(self) -> Mapping[str, str]:
        """Labels of all entries and proposals that have one, by path in ``cameras/``."""
        if self.repo is not None:
            said = sorted(self.contents.mentions(LABEL), key=lambda one: not is_proposal(one[0]))
            return {in_use_path(path): label for path, _, _, label in said}
        proposed = sorted(path for path in self.proposed if is_entry(path))
        waiting = zip(map(in_use_path, proposed), self.read_many(proposed), strict=True)
        found = {path: label for path, data in waiting if (label := label_in(data)) is not None}
        return found | {path: label for path, data in self.files() if (label := label_in(data)) is not None}

    def label_of(self, unit: str | None) -> str | None:
        """Return the label of a unit, by its folder in ``cameras/``."""
        if unit is None:
            return None
        return next((label for path, label in sorted(self.labels.items()) if path.startswith(unit)), None)

    def _makes(self) -> dict[str, str]:
        """Return the makes of units as written in their entries, by folder name."""
        found: dict[str, str] = {}
        for path in (*self.paths, *self.proposed):
            folder = path.split("/")[1]
            if folder not in found and unit_folder(path) is not None:
                with suppress(RegistryError):
                    found[folder] = self._parsed(path, self.read(path)).calibration.camera.make or ""
        return found

    def index(self) -> RegistryIndex:
        """Return an index of all entries, for resolving many cameras.

        Raises:
            RegistryError: the registry cannot be listed.
        """
        repo, commit = self.repo, self.commit
        if repo is None or commit is None:
            # In a folder, an entry written by hand needs no digest; an existing one must match.
            return RegistryIndex(self.paths, self.read, proposed=self.proposed, require_digest=False)
        return RegistryIndex(
            self.paths,
            self.read,
            proposed=self.proposed,
            aliases=lambda: self.contents.aliases,
            earlier=partial(used_before, repo, commit),
        )

    def index_for(self, key: CameraKey) -> RegistryIndex:
        """Return an index of the entries that may match one camera, by listing only their folders.

        Raises:
            RegistryError: as for :meth:`index`.
        """
        if self.repo is None or self.commit is None or not key.make or not key.model:
            return self.index()
        aliases = self.contents.aliases
        others = aliases.get((match_key(key.make), match_key(key.model)), frozenset())
        folders = sorted({folder_of(key.make, key.model), *others})
        listed = self.repo.listing(self.commit, *folders, *map(proposal_path, folders))
        return RegistryIndex(
            [*self.contents.irregular, *(path for path in listed if not is_proposal(path))],
            self.read,
            proposed=filter(is_proposal, listed),
            aliases=lambda: aliases,
            earlier=partial(used_before, self.repo, self.commit),
        )

    def resolve(
        self, key: CameraKey, *, on: date | None = None, statuses: Collection[Status] = USABLE
    ) -> Resolution | None:
        """Return the entry for a camera; see :func:`calibrary.registry.resolution.resolve`.

        Raises:
            RegistryError: two entries match equally well, or a candidate cannot be read.
        """
        return self.index_for(key).resolve(key, on=on, statuses=statuses)

    def _parsed(self, path: str, data: bytes) -> Entry:
        return parsed(data, path, require_digest=self.repo is not None)


def used_before(repo: Repository, at: str, path: str) -> Iterator[tuple[str, Entry]]:
    """Yield (commit, entry) for an entry's earlier usable revisions, newest first."""
    for revision in history(repo, path, at):
        if revision.oid is None or is_proposal(revision.path):
            continue
        with suppress(InputError):
            entry = parse_entry(repo.blob(revision.oid), revision.path)
            if entry.is_usable:
                yield revision.commit, entry
