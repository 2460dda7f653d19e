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
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

from msgspec import Struct

from calibrary.calibration import CameraKey
from calibrary.errors import InputError, RegistryError, first_of
from calibrary.known_camera import match_key
from calibrary.policy import Policy
from calibrary.records import Json, Meta, Record, replace
from calibrary.registry.configuration import Configuration
from calibrary.registry.contents import LABEL, NAMED, Contents, label_in, parsed_or_error
from calibrary.registry.entry import USABLE, Entry, EntryFields, Status
from calibrary.registry.entry_yaml import LARGEST_ENTRY, entry_yaml, parsed
from calibrary.registry.fields import Row, entry_row
from calibrary.registry.git.errors import TooLargeError
from calibrary.registry.git.history import history
from calibrary.registry.git.objects import ObjectId, blob_id
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import (
    EVENTS,
    PROPOSED,
    ROOT,
    file_path,
    find_paths,
    folder_of,
    id_of,
    is_entry,
    is_proposal,
    proposed_name,
    single_match,
    unit_folder,
    unit_paths,
)
from calibrary.registry.resolution import OnlyProposed, RegistryIndex, Resolution
from calibrary.registry.standing import Book, Standing, label_subject, standing_of
from calibrary.registry.statements import (
    LARGEST_STATEMENT,
    RULES,
    content_of,
    entry_in,
    entry_path,
    subject_of,
)

MOST_INDICES = 256
"""Models of which the entries stay in memory."""

AT_ONCE = 500
"""Number of files of which the contents are held in memory."""

FOLLOWED = "rules followed"
"""What a reader keeps the ids of the rules by that it has seen in force."""

MOST_TOLD = 3
"""Number of proposals that one message tells of."""

MANY = 200
"""Number of entries from which all statements are read at once."""


def paths_below(root: Path, top: str = ROOT) -> list[str]:
    """Return the sorted paths of all files in a folder, by default ``cameras/``; links to folders are not followed.

    Raises:
        RegistryError: there is no registry here, or a folder cannot be read.
    """

    def refuse(error: OSError) -> None:
        raise RegistryError(f"{error.filename}: cannot be read: {error.strerror}") from None

    if not (root / ROOT).is_dir():
        raise RegistryError(
            f"{root}: no registry here: expected a folder 'cameras' with one YAML file a camera"
        )
    start = len(str(root)) + 1 if str(root) != "." else 0
    found = []
    for folder, _, names in os.walk(root / top, onerror=refuse) if (root / top).is_dir() else ():
        below = folder[start:].replace(os.sep, "/")
        found += [f"{below}/{name}" for name in names]
    return sorted(found)


def read_entry_file(root: Path, path: str) -> bytes:
    """Return the content of one file of a registry.

    Raises:
        RegistryError: it is not a regular file, too large, or cannot be read.
    """
    file, most = root / path, LARGEST_STATEMENT if path.startswith(EVENTS) else LARGEST_ENTRY
    try:
        if file.is_symlink() or not file.is_file():
            raise RegistryError(f"{path}: expected a regular file")
        with file.open("rb") as opened:
            data = opened.read(most + 1)
    except OSError as error:
        raise RegistryError(f"{path}: cannot be read: {error.strerror}") from None
    if len(data) > most:
        raise TooLargeError(f"{path}: is larger than {most >> 10} KiB, expected one camera's entry")
    return data


class Snapshot(Struct, frozen=True, kw_only=True, eq=False, dict=True):
    """A registry's entries at one immutable state; files are read on demand.

    A name of an entry is its path in ``cameras/``, which is what is in force of it, or that path and ``@proposed``,
    which is what its file says and too few people have approved.

    Attributes:
        place: folder of the registry.
        configuration: configuration of the registry.
        repo: the repository; None for a plain folder.
        commit: 40 hexadecimal digits; None for a plain folder.
    """

    place: Path
    configuration: Configuration
    repo: Repository | None = None
    commit: str | None = None

    @cached_property
    def cameras(self) -> Mapping[str, str | None]:
        """Blob id of the file of every entry, by path; None in a plain folder, and if it has no file.

        Raises:
            RegistryError: there is no registry in the folder, or it cannot be listed.
        """
        files = {path: oid for path, oid in self._files.items() if is_entry(path)}
        return MappingProxyType({**files, **dict.fromkeys(self._unfiled())})

    @cached_property
    def paths(self) -> Mapping[str, str | None]:
        """Those of :attr:`cameras` of which anything is or was in force.

        Raises:
            RegistryError: as for :attr:`cameras`.
        """
        standings = self.standings(self.cameras)
        return MappingProxyType({path: oid for path, oid in self.cameras.items() if standings[path].is_used})

    @cached_property
    def proposed(self) -> Mapping[str, str | None]:
        """Blob id of the file of everything that is only proposed, by name; None in a plain folder."""
        standings = self.standings(self.cameras)
        waiting = {path: oid for path, oid in self.cameras.items() if standings[path].is_proposed}
        return MappingProxyType({proposed_name(path): oid for path, oid in waiting.items()})

    def _unfiled(self, *folders: str) -> list[str]:
        """Return the paths in use without a file: an approval holds its content."""
        said = self._listing(*(f"{EVENTS}{folder}" for folder in folders or (ROOT,)))
        paths = {*map(entry_path, said)}
        new = sorted(path for path in paths - self._files.keys() if path.startswith(ROOT) and is_entry(path))
        return [path for path, one in self.standings(new).items() if one.is_used]

    def _listing(self, *folders: str) -> Mapping[str, str]:
        """Return the files of folders by path, with the names by which :meth:`_contents` reads them."""
        if self.repo is not None and self.commit is not None:
            return self.repo.listing(self.commit, *folders)
        return {path: path for folder in folders for path in paths_below(self.place, folder)}

    def _contents(self, names: Sequence[str]) -> Iterable[bytes]:
        if self.repo is not None:
            return self.repo.objects(names)
        return (read_entry_file(self.place, name) for name in names)

    @cached_property
    def strays(self) -> tuple[str, ...]:
        """Paths of all other files in ``cameras/``, which nothing reads."""
        return tuple(path for path in self._files if not is_entry(path))

    @property
    def files(self) -> tuple[str, ...]:
        """Paths of the files of entries."""
        return tuple(filter(is_entry, self._files))

    @property
    def unread(self) -> str | None:
        """A sentence about the files that are not read; None if there are none."""
        said = [self.configuration.damage] if self.configuration.damage is not None else []
        if self.strays:
            check = "('calibrary registry check' says what to do)"
            said.append(f"not read, as no camera's KEY gives these paths: {first_of(self.strays)} {check}")
        return "; ".join(said) or None

    @cached_property
    def _files(self) -> Mapping[str, str | None]:
        if self.repo is None or self.commit is None:
            return dict.fromkeys(paths_below(self.place))
        return self.contents.files

    @cached_property
    def contents(self) -> Contents:
        """The files of the commit, for a registry in git."""
        return Contents(*self.require_git("has no commit"))

    @property
    def policy(self) -> Policy:
        """The limits in force."""
        return self.book.rules.policy

    def waiting(self, paths: Iterable[str]) -> str | None:
        """Return a sentence about entries in ``paths`` with another K waiting for approval; None if there are none."""
        own = [file_path(path) for path in paths]
        ids = [id_of(path) for path, one in self.standings(own).items() if one.is_used and one.is_proposed]
        show = f"('calibrary registry show KEY{PROPOSED}')"
        return f"another K is proposed and not approved, so not used: {first_of(ids)} {show}" if ids else None

    def only_proposed(self, path: str) -> OnlyProposed:
        """Return what is to say of what is proposed for an entry.

        Raises:
            RegistryError: its file, or the statements, cannot be read.
        """
        path = file_path(path)
        key, asked = id_of(path), self.book.rules.approvals.count
        if self.repo is None or self.commit is None:
            return OnlyProposed(key=key, asked=asked)
        [newest, *_] = history(self.repo, path, self.commit, most=1) or [None]
        by, digest = newest.author.name if newest is not None else None, (self._files.get(path) or "")[:12]
        says = content_of(self._parsed(path, self.committed(path)))
        found, people = self.book.in_force(subject_of(path)), self.book.rulebook.people
        same = (found.approvals[name] for name, one in found.waiting.items() if one.says == says)
        have = max((len(people.counted(approvals)) for approvals in same), default=0)
        return OnlyProposed(key=key, by=by, have=have, asked=asked, digest=digest)

    def all_proposed(self, names: Iterable[str] | None = None) -> str:
        """Return the sentences on the first few of some proposals, by default of all; empty if there are none."""
        every = sorted(self.proposed if names is None else names)
        more = f"; {len(every) - MOST_TOLD} more are proposed" if len(every) > MOST_TOLD else ""
        return "; ".join(str(self.only_proposed(name)) for name in every[:MOST_TOLD]) + more

    @cached_property
    def _is_tip(self) -> bool:
        return self.repo is not None and self.repo.tip() == self.commit

    @property
    def _ref(self) -> str:
        return (self.repo.head_ref if self.repo is not None else None) or "HEAD"

    def _seen(self) -> Mapping[str, Collection[str]]:
        """Return the ids of the statements that were seen before on this branch, by their subject."""
        return self.contents.memory.seen(self._ref) if self._is_tip else {}

    def _remember(self, seen: Mapping[str, Iterable[str]]) -> None:
        if self._is_tip and self.commit is not None:
            self.contents.memory.remember(self.commit, self._ref, seen)

    @cached_property
    def book(self) -> Book:
        """The statements.

        Raises:
            RegistryError: the registry has none, or not one foundation.
        """
        if self.repo is None:
            return Book(self._listing, self._contents, may_be_free=True)
        if not self._is_tip and self._listing("statements/") and not self._listing(EVENTS):
            raise RegistryError(
                f"{(self.commit or '')[:12]} is of a former layout, which is not read any more: 'git show' shows "
                "its files"
            )
        seen = self._seen()
        known = next(iter(seen.get(RULES, ())), None)
        found = Book(self._listing, self._contents, known=known, followed=seen.get(FOLLOWED, ()))
        self._remember({RULES: [found.rulebook.foundation], FOLLOWED: [*found.rulebook.chain]})
        return found

    @cached_property
    def _standings(self) -> dict[str, Standing]:
        return {}

    def standings(self, paths: Iterable[str]) -> dict[str, Standing]:
        """Return what is in force of entries."""
        wanted = [*paths]
        if missing := [path for path in wanted if path not in self._standings]:
            _ = self.book
            in_git = self.repo is not None
            made = (
                self.contents.standings(missing, self._stand, self._seen) if in_git else self._stand(missing)
            )
            self._standings.update(made)
        return {path: self._standings[path] for path in wanted}

    def standing(self, path: str) -> Standing:
        """Return what is in force of one entry."""
        return self.standings([path])[path]

    def _stand(self, paths: Sequence[str]) -> dict[str, Standing]:
        book, subjects = self.book, [subject_of(path) for path in paths]
        if len(paths) > MANY:
            book.read_all()
        known = self._seen()
        there = dict(self._filed([path for path in paths if path in self._files], RegistryError))
        found, seen = {}, {}
        for path, subject in zip(paths, subjects, strict=True):
            file = there.get(path)
            here = file if isinstance(file, Entry) else None
            in_force = book.in_force(subject, here, expected=known.get(subject, ()))
            found[path] = standing_of(book, path, file, in_force)
            if in_force.problem is None:
                seen[subject] = [one.id for one in book.statements(subject)]
        self._remember(seen)
        return found

    def _filed(
        self, paths: Sequence[str], tolerated: type[RegistryError] = TooLargeError
    ) -> Iterator[tuple[str, Entry | InputError]]:
        """Yield what the files of entries say."""
        if self.repo is not None:
            yield from self.contents.parsed(self._each(paths, tolerated))
            return
        for _, path, data in self._each(paths, tolerated):
            # In a folder, an entry written by hand needs no digest; an existing one must match.
            yield (
                path,
                data if isinstance(data, InputError) else parsed_or_error(path, data, require_digest=False),
            )

    def _each(
        self, paths: Sequence[str], tolerated: type[RegistryError] = TooLargeError
    ) -> Iterator[tuple[str, str, bytes | InputError]]:
        """Yield id, path and content of files of the tree; the error of one for a reason that is tolerated.

        Raises:
            RegistryError: a file cannot be read for another reason, as in a damaged repository.
        """
        for start in range(0, len(paths), AT_ONCE):
            some = paths[start : start + AT_ONCE]
            try:
                contents: list[bytes | InputError] = [*self.committed_many(some)]
            except tolerated:
                contents = [self._committed(path, tolerated) for path in some]
            for path, data in zip(some, contents, strict=True):
                yield self._files.get(path) or "", path, data

    def _committed(self, path: str, tolerated: type[RegistryError]) -> bytes | InputError:
        try:
            return self.committed(path)
        except tolerated as error:
            return InputError(str(error))

    def require_git(self, why: str) -> tuple[Repository, str]:
        """Return the repository and the commit.

        Raises:
            RegistryError: the registry is a plain folder; ``why`` completes the message.
        """
        if self.repo is None or self.commit is None:
            raise RegistryError(f"{self.place}: a plain folder {why}")
        return self.repo, self.commit

    def entry(self, name: str) -> Entry:
        """Return what is in force of an entry, or what is proposed.

        Raises:
            RegistryError: it does not exist, cannot be read, or nobody can say what is in force of it.
        """
        path = file_path(name)
        standing = self.standing(path)
        if standing.problem is not None:
            raise RegistryError(standing.problem)
        if standing.entries and not is_proposal(name):
            return standing.entries[0]
        return self._parsed(path, self.committed(path))

    def read(self, name: str) -> bytes:
        """Return the file of an entry that is in force, or of what is proposed; errors as for :meth:`entry`."""
        standing, entry = self.standing(file_path(name)), self.entry(name)
        is_own = standing.is_here or is_proposal(name) or not standing.entries
        return self.committed(file_path(name)) if is_own else entry_yaml(entry)

    def committed(self, path: str) -> bytes:
        """Return the content of a file as it is in the tree.

        Raises:
            RegistryError: it does not exist, or cannot be read.
        """
        if self.repo is None or self.commit is None:
            return read_entry_file(self.place, path)
        try:
            blob = self.repo.read(self.commit, path)
        except TooLargeError as error:
            raise TooLargeError(f"{path}: {error}") from None
        if blob is None:
            raise RegistryError(f"{path}: not in commit {self.commit[:12]}")
        return blob.data

    def committed_many(self, paths: Sequence[str]) -> Iterator[bytes]:
        """Yield the contents of many files as they are in the tree, in order, using few processes.

        Raises:
            RegistryError: as for :meth:`committed`.
        """
        if self.repo is None:
            return (self.committed(path) for path in paths)
        oids = [oid for path in paths if (oid := self._files.get(path)) is not None]
        if len(oids) < len(paths):
            missing = next(path for path in paths if self._files.get(path) is None)
            raise RegistryError(f"{missing}: not in commit {(self.commit or '')[:12]}")
        return self.repo.objects(oids)

    def entries(self, unreadable: Callable[[str, InputError], None] | None = None) -> Iterator[StoredEntry]:
        """Yield every entry of which anything is or was in force, sorted by path.

        Args:
            unreadable: called with path and error of each entry that cannot be read.

        Raises:
            RegistryError: an entry cannot be read, and nobody takes the error.
        """
        return self._stored(sorted(self.paths), unreadable)

    def proposals(self) -> Iterator[StoredEntry]:
        """Yield everything that is only proposed, sorted by name; otherwise like :meth:`entries`."""
        return self._stored(sorted(self.proposed))

    def rows(
        self,
        names: Iterable[str],
        *,
        unreadable: Callable[[RegistryError], None],
    ) -> Iterator[tuple[str, Row]]:
        """Yield the fields of the entries of some names, in order.

        Args:
            names: of what is in force, or proposed.
            unreadable: called with the error of each entry that cannot be read.
        """
        for name, entry in self.parsed(sorted(names)):
            if isinstance(entry, InputError):
                unreadable(RegistryError(str(entry)))
            else:
                yield name, entry_row(entry)

    def stored(self, names: Sequence[str]) -> tuple[StoredEntry, ...]:
        """Return the entries of some names, in order.

        Raises:
            RegistryError: an entry does not exist, or cannot be read.
        """
        return tuple(self._stored(names))

    def _stored(
        self, names: Sequence[str], unreadable: Callable[[str, InputError], None] | None = None
    ) -> Iterator[StoredEntry]:
        for name, entry in self.parsed(names):
            if isinstance(entry, Entry):
                yield self._as_stored(entry, name)
            elif unreadable is None:
                raise RegistryError(str(entry))
            else:
                unreadable(name, entry)

    def parsed(self, names: Sequence[str]) -> Iterator[tuple[str, Entry | InputError]]:
        """Yield the entries of some names, in order; the error if one cannot be read."""
        standings = self.standings(map(file_path, names))
        own = {name for name in names if not is_proposal(name) and standings[name].is_used}
        tolerated = TooLargeError if self.repo is not None else RegistryError
        rest = self._filed([file_path(name) for name in names if name not in own], tolerated)
        for name in names:
            standing = standings[file_path(name)]
            if name not in own:
                yield name, next(rest)[1]
            elif standing.problem is not None:
                yield name, InputError(standing.problem)
            else:
                yield name, standing.entries[0]

    def _as_stored(self, entry: Entry, name: str) -> StoredEntry:
        path = file_path(name)
        base, standing = self._files.get(path), self.standing(path)
        is_own = standing.is_here or entry.status is Status.DRAFT or self.repo is None
        return StoredEntry(
            entry=entry,
            path=path,
            oid=base if is_own else blob_id(entry_yaml(entry)),
            commit=self.commit,
            base=base,
            standing=standing,
        )

    def at(self, name: str) -> StoredEntry | None:
        """Return the entry of a name; None if there is none.

        Raises:
            RegistryError: the entry cannot be read.
        """
        path = file_path(name)
        if path not in self._files and path not in self.cameras:
            return None
        standing = self.standing(path)
        is_there = standing.is_proposed if is_proposal(name) else standing.is_used
        return self._as_stored(self.entry(name), name) if is_there else None

    def get(self, key: str) -> StoredEntry:
        """Return the entry that a KEY names; what is proposed, if nothing of it is in force.

        Args:
            key: see :func:`calibrary.registry.paths.find_path`; ``KEY@proposed`` names what is proposed.

        Raises:
            UnknownCameraError: the camera does not exist.
            RegistryError: several entries match, or the entry cannot be read, or is of another camera than its path.
        """
        name = self.find(key)
        return require_own_path(self._as_stored(self.entry(name), name))

    def filed(self, key: str) -> StoredEntry:
        """Return what the file of an entry says, if that is not in force, for somebody to approve; else the entry.

        Raises:
            UnknownCameraError: the camera does not exist.
            RegistryError: several entries match, or the file cannot be read.
        """
        path = file_path(self.find(file_path(key)))
        standing = self.standing(path)
        is_over = not standing.entries or not standing.entries[0].is_usable
        if path not in self._files or not (is_over or standing.is_proposed):
            return self.get(key)
        return self._as_stored(self._parsed(path, self.committed(path)), proposed_name(path))

    def file(self, path: str) -> Entry | None:
        """Return what the file of an entry says; None if there is none, or it cannot be read."""
        with suppress(RegistryError):
            return self._parsed(path, self.committed(path)) if path in self._files else None
        return None

    def approved(self, path: str) -> Entry | None:
        """Return the entry that is in force whatever the day, as it was approved; None if none is."""
        here, stored = self.file(path), self.at(path)
        content = self.book.in_force(subject_of(path), here).on()
        if content is None or stored is None:
            return None
        entry, now = entry_in(content.entry, path), stored.entry
        notes = replace(entry.calibration, notes=now.notes)
        return replace(entry, calibration=notes, label=now.label, tags=now.tags)

    def find(self, key: str) -> str:
        """Return the name of the entry that a KEY names; errors as for :meth:`get`."""
        found = self.matching(key)
        # If nothing matches, the error message lists similar names.
        return single_match(found, found or self.cameras, key)

    def matching(self, key: str) -> list[str]:
        """Return the names of all entries that a KEY may mean; what is proposed, if nothing of them is in force.

        Args:
            key: as for :func:`calibrary.registry.paths.find_paths`, or a unit's label, its serial number or the
                beginning of its hash, optionally followed by a slash and the beginning of the variant.
        """
        word = file_path(key)
        standings = self.standings(
            find_paths(self.cameras, word) or self.of_unit(self.cameras, word) or self._new_of_unit(word)
        )
        used = [] if is_proposal(key) else [path for path, one in standings.items() if one.is_used]
        return used or [proposed_name(path) for path, one in standings.items() if one.is_proposed]

    def of_unit(self, paths: Collection[str], key: str) -> list[str]:
        """Return those of some paths that a KEY by a unit's label or serial number may name."""
        return unit_paths(paths, key, labels=lambda: self._called(key), makes=self._makes)

    def _new_of_unit(self, key: str) -> list[str]:
        """Return those with nothing in force that the label in their file, which nobody has stated, may name."""
        found = unit_paths(self.cameras, key, labels=lambda: self.labels, makes=dict)
        return [path for path, one in self.standings(found).items() if not one.is_used]

    def _called(self, key: str) -> Mapping[str, str]:
        """Return the labels that a KEY may mean, by path: where statements say what a unit is called, only those."""
        if not self.book.rules.approvals.count:
            return self.labels
        named = match_key(key.removeprefix(ROOT).strip("/").partition("/")[0])
        asked = {label_subject(path) for path, label in self.labels.items() if match_key(label) == named}
        if self.repo is not None:
            asked |= {subject for _, _, word, subject in self.contents.mentions(NAMED) if word == named}
        called = {subject: label for subject in asked if (label := self.book.label(subject)) is not None}
        every = self.cameras if called else ()
        return {path: called[subject] for path in every if (subject := label_subject(path)) in called}

    @cached_property
    def labels(self) -> Mapping[str, str]:
        """Labels in the files of all entries that have one, by path."""
        if self.repo is not None:
            return {path: label for path, _, _, label in sorted(self.contents.mentions(LABEL))}
        read = ((path, self._committed(path, RegistryError)) for path in self.files)
        said = ((path, label_in(data)) for path, data in read if isinstance(data, bytes))
        return {path: label for path, label in said if label is not None}

    def label_of(self, unit: str | None) -> str | None:
        """Return the label of a unit, by its folder in ``cameras/``."""
        if unit is None:
            return None
        if (
            said := self.book.label(label_subject(f"{unit}x"))
        ) is not None or self.book.rules.approvals.count:
            return said
        return next((label for path, label in sorted(self.labels.items()) if path.startswith(unit)), None)

    def _makes(self) -> dict[str, str]:
        """Return the makes of units as written in their entries, by folder name."""
        found: dict[str, str] = {}
        for path in self.cameras:
            folder = path.split("/")[1]
            if folder not in found and unit_folder(path) is not None:
                with suppress(RegistryError):
                    found[folder] = self.entry(path).calibration.camera.make or ""
        return found

    def index(self) -> RegistryIndex:
        """Return an index of all entries, for resolving many cameras.

        Raises:
            RegistryError: the registry cannot be listed.
        """
        return self._index_of(self.cameras)

    def _index_of(self, paths: Iterable[str]) -> RegistryIndex:
        aliases = None if self.repo is None else lambda: self.contents.aliases
        return RegistryIndex(
            paths,
            self.choices,
            aliases=aliases,
            prepare=self.standings,
            unapproved=lambda path: str(self.only_proposed(path)),
        )

    def choices(self, path: str) -> Iterator[Entry]:
        """Yield what is in force of an entry on any day, then what is proposed, if that can be read.

        Raises:
            RegistryError: nobody can say what is in force.
        """
        standing = self.standing(path)
        if standing.problem is not None:
            raise RegistryError(standing.problem)
        yield from standing.entries
        if standing.is_proposed:
            # What cannot be read matches nothing; reporting its errors is the task of the check.
            with suppress(RegistryError):
                yield self.entry(proposed_name(path))

    def index_for(self, key: CameraKey) -> RegistryIndex:
        """Return an index of the entries that may match one camera, by listing only their folders.

        The state never changes, so the entries of a camera that was asked for stay in memory.

        Raises:
            RegistryError: as for :meth:`index`.
        """
        if self.repo is None or self.commit is None or not key.make or not key.model:
            return self.index()
        aliases = self.contents.aliases
        others = aliases.get((match_key(key.make), match_key(key.model)), frozenset())
        folders = tuple(sorted({folder_of(key.make, key.model), *others}))
        if folders not in self._indices:
            listed = [path for path in self.repo.listing(self.commit, *folders) if is_entry(path)]
            if len(self._indices) >= MOST_INDICES:
                self._indices.clear()
            self._indices[folders] = self._index_of([*listed, *self._unfiled(*folders)])
        return self._indices[folders]

    @cached_property
    def _indices(self) -> dict[tuple[str, ...], RegistryIndex]:
        return {}

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


class StoredEntry(Struct, frozen=True, kw_only=True):
    """An entry as stored at one state of a registry.

    Attributes:
        entry: what is in force, or proposed.
        path: path of its file.
        oid: blob id of the content; None in a plain folder.
        base: blob id of the file in the tree, the base for a change; it differs where something else is in force.
        commit: commit it was read from, 40 hexadecimal digits; None in a plain folder.
        standing: what the statements say of it; None of a former revision.
    """

    entry: Entry
    path: str
    oid: str | None
    commit: str | None
    base: str | None = None
    standing: Standing | None = None

    @property
    def id(self) -> str:
        """Longest KEY of the entry."""
        return id_of(self.path)

    @property
    def is_pending(self) -> bool:
        """Whether it needs approval."""
        return self.entry.status is Status.DRAFT

    @property
    def proposal(self) -> str | None:
        """KEY of what is proposed to replace it; None if nothing is."""
        waits = self.standing is not None and self.standing.is_proposed and not self.is_pending
        return f"{self.id}{PROPOSED}" if waits else None

    @property
    def members(self) -> dict[str, Any]:
        """Members of a listed entry, by name."""
        stated = {name: getattr(self.entry, name) for name in EntryFields.__struct_fields__}
        place = {"id": self.id, "path": self.path, "commit": self.commit, "blob": self.oid}
        return {**place, "proposal": self.proposal, **stated}


class ListedEntry(EntryFields):
    """An entry as stored at a commit, with its calibration in the common printed form.

    Attributes:
        id: longest KEY of the entry.
        path: path of its file.
        commit: commit it was read from; None in a plain folder.
        blob: git's id of the file, which an approval refers to; None in a plain folder.
        proposal: KEY of what is proposed to replace it; None if nothing is.
    """

    id: str
    path: Annotated[str, Meta(pattern="^cameras/.+[.]yaml$")]
    commit: ObjectId | None
    blob: ObjectId | None
    proposal: str | None = None

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        """Put the identification first, since a calibration is long."""
        return {name: document.pop(name) for name in ListedEntry.__annotations__} | document


class ListedEntries(Record, tag_field="schema", tag="calibrary/entry-listing-1"):
    """Output of ``calibrary registry list --json``.

    Attributes:
        entries: entries, by path.
    """

    entries: tuple[ListedEntry, ...]

    @classmethod
    def of(cls, stored: Iterable[StoredEntry]) -> ListedEntries:
        """Make the listing of stored entries."""
        return cls(entries=tuple(ListedEntry(**one.members) for one in stored))


def require_own_path(stored: StoredEntry) -> StoredEntry:
    """Return the entry, if its path is that of its camera.

    Raises:
        RegistryError: the file is at the path of another camera.
    """
    if stored.entry.path != stored.path:
        raise RegistryError(
            f"{stored.path}: its camera belongs at {stored.entry.path}, so this is not the K of {stored.id}; "
            f"'calibrary registry log {stored.id}' shows who wrote it"
        )
    return stored
