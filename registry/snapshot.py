"""The entries of a registry at one state: a commit in git, or a plain folder of files.

A git repository that holds a registry is read at its commits, never in its work tree: a run rests on what was
committed, and can say which commit that was. The files that lie in a folder are read only where a person asks for them
by name, as ``folder:PATH``: a repository that is damaged must not turn into files that anyone may have edited.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import date
from functools import cached_property, partial
from pathlib import Path
from types import MappingProxyType

from msgspec import Struct

from calibrary.calibration import CameraKey
from calibrary.errors import InputError, RegistryError
from calibrary.registry.configuration import Configuration
from calibrary.registry.entry import USABLE, Entry, Status
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.fields import Row, entry_row
from calibrary.registry.folder import entry_paths, proposal_paths, read_entry_file
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
    match_key,
    proposal_path,
    the_one,
    unit_folder,
    unit_paths,
)
from calibrary.registry.resolution import RegistryIndex, Resolution
from calibrary.registry.stored import StoredEntry, in_its_place
from calibrary.registry.writing import parsed

__all__ = ["Snapshot", "used_before"]


class Snapshot(Struct, frozen=True, kw_only=True, eq=False, dict=True):
    """A registry's entries at one state, which never changes; files are read when they are asked for.

    Attributes:
        place: the registry's folder.
        configuration: of the registry, with the policy that its entries are checked against.
        repo: the repository; None for a plain folder.
        commit: 40 hexadecimal digits; None for a plain folder.
        known_paths: the paths, where they were listed already.
    """

    place: Path
    configuration: Configuration
    repo: Repository | None = None
    commit: str | None = None
    known_paths: Mapping[str, str | None] | None = None

    @cached_property
    def paths(self) -> Mapping[str, str | None]:
        """The blob id of every file below ``cameras/``, by path; None in a plain folder.

        Raises:
            RegistryError: there is no registry in the folder, or it cannot be listed.
        """
        if self.known_paths is not None:
            return self.known_paths
        if self.repo is None or self.commit is None:
            return MappingProxyType(dict.fromkeys(entry_paths(self.place)))
        # A call of is_proposal for each of a hundred thousand takes as long as all else.
        files = self.contents.files.items()
        return MappingProxyType({path: oid for path, oid in files if not path.startswith(PROPOSED)})

    @cached_property
    def proposed(self) -> Mapping[str, str | None]:
        """The blob id of every file below ``proposals/``, by path; None in a plain folder.

        Raises:
            RegistryError: it cannot be listed.
        """
        if self.repo is None or self.commit is None:
            return MappingProxyType(dict.fromkeys(proposal_paths(self.place)))
        files = self.contents.files.items()
        return MappingProxyType({path: oid for path, oid in files if path.startswith(PROPOSED)})

    @cached_property
    def contents(self) -> Index:
        """The index of the commit; for a registry in git."""
        return index_at(*self.require_git("has no index"))

    def waiting(self, paths: Iterable[str]) -> str | None:
        """A sentence on those of some entries for which another K is proposed and not approved; None without any."""
        ids = [
            id_of(path) for path in paths if not is_proposal(path) and proposal_path(path) in self.proposed
        ]
        if not ids:
            return None
        named = ", ".join(ids[:3]) + (f" and {len(ids) - 3} more" if len(ids) > 3 else "")
        return f"another K is proposed and not approved, so not used: {named} ('calibrary registry show proposals/…')"

    def require_git(self, why: str) -> tuple[Repository, str]:
        """The repository and the commit.

        Raises:
            RegistryError: the registry is a plain folder, which ``why`` completes.
        """
        if self.repo is None or self.commit is None:
            raise RegistryError(f"{self.place}: a plain folder {why}")
        return self.repo, self.commit

    def read(self, path: str) -> bytes:
        """One entry's bytes.

        Raises:
            RegistryError: it is not there, or cannot be read.
        """
        if self.repo is None or self.commit is None:
            return read_entry_file(self.place, path)
        blob = self.repo.read(self.commit, path)
        if blob is None:
            raise RegistryError(f"{path}: not in commit {self.commit[:12]}")
        return blob.data

    def read_many(self, paths: Sequence[str]) -> Iterator[bytes]:
        """The bytes of many entries, in their order, by few processes.

        Raises:
            RegistryError: one is not there, or cannot be read.
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
        """The path and bytes of every entry in ``cameras/``, in the order of the paths.

        Raises:
            RegistryError: one cannot be read.
        """
        paths = sorted(self.paths)
        return zip(paths, self.read_many(paths), strict=True)

    def entries(
        self,
        *,
        unreadable: Callable[[RegistryError], None] | None = None,
        where: Callable[[str], bool] | None = None,
    ) -> Iterator[StoredEntry]:
        """Every entry in ``cameras/``, in the order of their paths.

        Args:
            where: whether the entry at a path is wanted; others are not read.
            unreadable: called with the error of each entry that cannot be read, which then does not end the others.

        Raises:
            RegistryError: an entry cannot be read and ``unreadable`` was left out.
        """
        paths = sorted(filter(where, self.paths))
        return self._stored(zip(paths, self.read_many(paths), strict=True), unreadable)

    def proposals(
        self,
        *,
        unreadable: Callable[[RegistryError], None] | None = None,
        where: Callable[[str], bool] | None = None,
    ) -> Iterator[StoredEntry]:
        """Every proposal that lies beside what is in use, in the order of their paths; otherwise as :meth:`entries`."""
        paths = sorted(filter(where, (path for path in self.proposed if is_entry(path))))
        return self._stored(zip(paths, self.read_many(paths), strict=True), unreadable)

    def rows(
        self, paths: Iterable[str], *, unreadable: Callable[[RegistryError], None]
    ) -> Iterator[tuple[str, Row]]:
        """What the entries at some paths state, by field, in the order of the paths; without making entries of them.

        Args:
            paths: in ``cameras/`` and ``proposals/``.
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
        """The entries at some paths, in the order of these.

        Raises:
            RegistryError: one is not there, or cannot be read.
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
        oid, proposal = self._oid(path), self.beside(path)
        return StoredEntry(entry=entry, path=path, oid=oid, commit=self.commit, proposal=proposal)

    def beside(self, path: str) -> str | None:
        """The path of what is proposed to take the place of an entry; None where nothing is."""
        proposal = proposal_path(path)
        return proposal if proposal != path and proposal in self.proposed else None

    def at(self, path: str) -> StoredEntry | None:
        """The entry at a path; None where there is none.

        Raises:
            RegistryError: the entry cannot be read.
        """
        if path not in (self.proposed if is_proposal(path) else self.paths):
            return None
        return self._as_stored(self._parsed(path, self.read(path)), path)

    def pending(self, key: str) -> StoredEntry:
        """The proposal that a KEY means; a draft in ``cameras/``, where an older registry has it, is one too.

        Raises:
            UnknownCameraError: nothing of that name is proposed, and no entry is so called.
            RegistryError: the KEY fits several.
        """
        name = in_use_path(key)
        waiting = f"{PROPOSED}{name.removeprefix(ROOT)}"
        return self.get(waiting if self.matching(waiting) else key)

    def get(self, key: str) -> StoredEntry:
        """The entry that a KEY means; the proposal, where nothing of that name is in use.

        Args:
            key: see :func:`calibrary.registry.paths.find_path`; ``proposals/…`` is what is proposed.

        Raises:
            UnknownCameraError: no such camera.
            RegistryError: several, or the entry cannot be read, or is of another camera than its path says.
        """
        path = self.find(key)
        return in_its_place(self._as_stored(self._parsed(path, self.read(path)), path))

    def find(self, key: str) -> str:
        """The path of the entry that a KEY means; errors as of :meth:`get`."""
        found = self.matching(key)
        # The names of all are for the message that there is none.
        every = found or {*self.paths, *map(in_use_path, self.proposed)}
        return the_one(found, every, key)

    def matching(self, key: str) -> list[str]:
        """The paths of all entries that a KEY may mean; the proposals, where nothing of that name is in use.

        Args:
            key: as of :func:`calibrary.registry.paths.find_paths`, else a unit's label, its serial number or how the
                hash of that begins; behind it and a slash how the variant begins.
        """
        if not is_proposal(key) and (found := self.in_use(key)):
            return found
        proposed = {in_use_path(path): path for path in self.proposed if is_entry(path)}
        name = in_use_path(key)
        if not proposed:
            return []
        return [proposed[path] for path in find_paths(proposed, name) or self.of_unit(proposed, name)]

    def in_use(self, key: str) -> list[str]:
        """The paths in ``cameras/`` of all entries that a KEY may mean."""
        return find_paths(self.paths, key) or self.of_unit(self.paths, key)

    def of_unit(self, paths: Collection[str], key: str) -> list[str]:
        """Of some paths in ``cameras/`` those that a KEY by a unit's label or serial number may mean."""
        return unit_paths(paths, key, labels=lambda: self.labels, makes=self._makes)

    @cached_property
    def labels(self) -> Mapping[str, str]:
        """The label of every entry that has one, by its path in ``cameras/``; of what is only proposed too."""
        if self.repo is not None:
            said = sorted(self.contents.mentions(LABEL), key=lambda one: not is_proposal(one[0]))
            return {in_use_path(path): label for path, _, _, label in said}
        proposed = sorted(path for path in self.proposed if is_entry(path))
        waiting = zip(map(in_use_path, proposed), self.read_many(proposed), strict=True)
        found = {path: label for path, data in waiting if (label := label_in(data)) is not None}
        return found | {path: label for path, data in self.files() if (label := label_in(data)) is not None}

    def label_of(self, unit: str | None) -> str | None:
        """The label of a unit, by its folder in ``cameras/``."""
        if unit is None:
            return None
        return next((label for path, label in sorted(self.labels.items()) if path.startswith(unit)), None)

    def _makes(self) -> dict[str, str]:
        """The makes of units as their entries write them, by the names of their folders."""
        found: dict[str, str] = {}
        for path in (*self.paths, *self.proposed):
            folder = path.split("/")[1]
            if folder not in found and unit_folder(path) is not None:
                with suppress(RegistryError):
                    found[folder] = self._parsed(path, self.read(path)).calibration.camera.make or ""
        return found

    def index(self) -> RegistryIndex:
        """All entries, for callers that resolve many cameras.

        Raises:
            RegistryError: the registry cannot be listed.
        """
        repo, commit = self.repo, self.commit
        if repo is None or commit is None:
            # An entry written by hand needs no digest in a folder; one that is there must fit.
            return RegistryIndex(self.paths, self.read, proposed=self.proposed, require_digest=False)
        return RegistryIndex(
            self.paths,
            self.read,
            proposed=self.proposed,
            aliases=lambda: self.contents.aliases,
            earlier=partial(used_before, repo, commit),
        )

    def index_for(self, key: CameraKey) -> RegistryIndex:
        """The entries that one camera may meet, listed by git in their own folders, without all others.

        Raises:
            RegistryError: as of :meth:`index`.
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
        """The entry that is used for a camera; see :func:`calibrary.registry.resolution.resolve`.

        Raises:
            RegistryError: two entries fit equally well, or a candidate cannot be read.
        """
        return self.index_for(key).resolve(key, on=on, statuses=statuses)

    def _parsed(self, path: str, data: bytes) -> Entry:
        return parsed(data, path, require_digest=self.repo is not None)


def used_before(repo: Repository, at: str, path: str) -> Iterator[tuple[str, Entry]]:
    """The commit and content of an entry's revisions that were in use, newest first."""
    for revision in history(repo, path, at):
        if revision.oid is None or is_proposal(revision.path):
            continue
        with suppress(InputError):
            entry = parse_entry(repo.blob(revision.oid), revision.path)
            if entry.is_usable:
                yield revision.commit, entry
