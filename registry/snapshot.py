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
from calibrary.records import Json, Meta, Record, replace
from calibrary.registry.configuration import STATED, Configuration
from calibrary.registry.contents import LABEL, NAMED, Contents, label_in, parsed_or_error
from calibrary.registry.entry import USABLE, Entry, EntryFields, Status
from calibrary.registry.entry_yaml import LARGEST_ENTRY, parse_entry, parsed
from calibrary.registry.fields import Row, Value, entry_row
from calibrary.registry.git.errors import TooLargeError
from calibrary.registry.git.history import history
from calibrary.registry.git.objects import ObjectId, blob_id
from calibrary.registry.git.repository import Repository
from calibrary.registry.paths import (
    PROPOSED,
    ROOT,
    STATEMENTS,
    SUFFIX,
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
from calibrary.registry.resolution import OnlyProposed, RegistryIndex, Resolution
from calibrary.registry.standing import Book, Standing, label_subject, standing_of
from calibrary.registry.statements import RULES, content_of, subject_in, subject_of

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


def paths_below(root: Path) -> list[str]:
    """Return the sorted paths of all files in ``cameras/`` and ``proposals/``; links to folders are not followed.

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
    for top in (ROOT, PROPOSED):
        for folder, _, names in os.walk(root / top, onerror=refuse) if (root / top).is_dir() else ():
            below = folder[start:].replace(os.sep, "/")
            found += [f"{below}/{name}" for name in names]
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
        raise TooLargeError(f"{path}: is larger than {LARGEST_ENTRY >> 10} KiB, expected one camera's entry")
    return data


class Snapshot(Struct, frozen=True, kw_only=True, eq=False, dict=True):
    """A registry's entries at one immutable state; files are read on demand.

    Attributes:
        place: folder of the registry.
        configuration: configuration of the registry, with the policy for entries.
        repo: the repository; None for a plain folder.
        commit: 40 hexadecimal digits; None for a plain folder.
    """

    place: Path
    configuration: Configuration
    repo: Repository | None = None
    commit: str | None = None

    @cached_property
    def paths(self) -> Mapping[str, str | None]:
        """Blob id of every entry in use, by path; None in a plain folder, and for an approved file in ``proposals/``.

        Raises:
            RegistryError: there is no registry in the folder, or it cannot be listed.
        """
        return MappingProxyType({**_entries_in(self._files, ROOT), **self._unfiled()})

    @cached_property
    def proposed(self) -> Mapping[str, str | None]:
        """Blob id of every entry in ``proposals/``, by path; None in a plain folder.

        Raises:
            RegistryError: the folder cannot be listed.
        """
        return MappingProxyType(_entries_in(self._files, PROPOSED))

    def _unfiled(self, *folders: str) -> dict[str, str | None]:
        """Return the paths in use without a file: an approval holds its content, so that nobody has to move one."""
        if not self.is_stated:
            return {}
        repo, commit = self.require_git("has no statements")
        said = repo.listing(commit, *(f"{STATEMENTS}{folder}" for folder in folders or (ROOT,)))
        paths = {f"{subject_in(path)}{SUFFIX}" for path in said}
        new = sorted(path for path in paths - self._files.keys() if path.startswith(ROOT) and is_entry(path))
        standings = self.standings(new).items()
        return {path: None for path, one in standings if one.data is not None or one.problem is not None}

    @cached_property
    def strays(self) -> tuple[str, ...]:
        """Paths of all other files in ``cameras/`` and ``proposals/``, which nothing reads."""
        return tuple(path for path in self._files if not is_entry(path))

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

    def waiting(self, paths: Iterable[str]) -> str | None:
        """Return a sentence about entries in ``paths`` with another K waiting for approval; None if there are none."""
        used = [path for path in paths if not is_proposal(path)]
        ids = [id_of(path) for path in used if proposal_path(path) in self.proposed]
        said = []
        if ids:
            show = "('calibrary registry show proposals/…')"
            said.append(f"another K is proposed and not approved, so not used: {first_of(ids)} {show}")
        said += [more] if (more := self.unapproved(used)) is not None else []
        return "; ".join(said) or None

    def only_proposed(self, path: str) -> OnlyProposed:
        """Return what is to say of an entry, or a proposal, that is not approved.

        Raises:
            RegistryError: its file, or the statements, cannot be read.
        """
        key, rules = id_of(path), self.configuration.rules
        if self.repo is None or self.commit is None:
            return OnlyProposed(key=key, asked=rules.approvals.count)
        [newest, *_] = history(self.repo, path, self.commit, most=1) or [None]
        by, digest = newest.author.name if newest is not None else None, (self._oid(path) or "")[:12]
        if not self.is_stated:
            return OnlyProposed(key=key, by=by, asked=rules.approvals.count, digest=digest)
        says = content_of(self._parsed(path, self.committed(path)))
        found, people = self.book.in_force(subject_of(in_use_path(path))), self.book.rulebook.people
        same = (found.approvals[name] for name, one in found.waiting.items() if one.says == says)
        have = max((len(people.counted(approvals)) for approvals in same), default=0)
        return OnlyProposed(key=key, by=by, have=have, asked=people.rules.approvals.count, digest=digest)

    def all_proposed(self, paths: Iterable[str] | None = None) -> str:
        """Return the sentences on the first few of some proposals, by default of all; empty if there are none."""
        every = sorted(self.proposed if paths is None else paths)
        more = f"; {len(every) - MOST_TOLD} more are proposed" if len(every) > MOST_TOLD else ""
        return "; ".join(str(self.only_proposed(path)) for path in every[:MOST_TOLD]) + more

    def unapproved(self, paths: Iterable[str]) -> str | None:
        """Return a sentence about entries in ``paths`` with files that no statement approves; None if all are."""
        return unapproved([path for path, one in self.standings(paths).items() if one.remark is not None])

    @cached_property
    def is_stated(self) -> bool:
        """Whether statements say what is approved here; in older registries, what their files say is used.

        Raises:
            RegistryError: there were statements before, and they are gone.
        """
        if self.repo is None or self.commit is None:
            return False
        if self.repo.listing(self.commit, f"{STATEMENTS}{RULES}"):
            return True
        if self._is_tip and (self.configuration.layout >= STATED or self._founded_as is not None):
            raise RegistryError(
                f"{self.place}: the statements are gone ({STATEMENTS}{RULES}/): nobody can say what is approved; "
                "'git log -- statements' shows who removed them, and git revert undoes it"
            )
        return False

    @cached_property
    def _is_tip(self) -> bool:
        return self.repo is not None and self.repo.tip() == self.commit

    @property
    def _ref(self) -> str:
        return (self.repo.head_ref if self.repo is not None else None) or "HEAD"

    @cached_property
    def _founded_as(self) -> str | None:
        """The foundation that was seen before on this branch."""
        return next(iter(self._seen().get(RULES, ())), None)

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
        repo, commit = self.require_git("has no statements")
        found = Book(repo, commit, known=self._founded_as, followed=self._seen().get(FOLLOWED, ()))
        self._remember({RULES: [found.rulebook.foundation], FOLLOWED: [*found.rulebook.chain]})
        return found

    @cached_property
    def _standings(self) -> dict[str, Standing]:
        return {}

    def standings(self, paths: Iterable[str]) -> dict[str, Standing]:
        """Return what is in force of entries in ``cameras/``; empty if no statements say so."""
        if not self.is_stated:
            return {}
        wanted = [path for path in paths if path.startswith(ROOT)]
        if missing := [path for path in wanted if path not in self._standings]:
            self._standings.update(self.contents.standings(missing, self._stand, self._seen))
        return {path: self._standings[path] for path in wanted}

    def standing(self, path: str) -> Standing | None:
        """Return what is in force of one entry; None for a proposal, and if no statements say so."""
        return self.standings([path]).get(path)

    def _stand(self, paths: Sequence[str]) -> dict[str, Standing]:
        book, subjects = self.book, [subject_of(path) for path in paths]
        if len(paths) > MANY:
            book.read_all()
        known = self._seen()
        there = [path for path in paths if path in self._files]
        there += [beside for path in paths if (beside := proposal_path(path)) in self._files]
        stated = dict(self.contents.parsed(self._each(there, RegistryError)))
        found, seen = {}, {}
        for path, subject in zip(paths, subjects, strict=True):
            files = (stated.get(path), stated.get(proposal_path(path)))
            entry, proposed = (one if isinstance(one, Entry) else None for one in files)
            statements = book.statements(subject)
            in_force = book.in_force(subject, statements, expected=known.get(subject, ()))
            found[path] = standing_of(book, path, entry, in_force, proposed, has_file=path in self._files)
            if in_force.problem is None:
                seen[subject] = [one.id for one in statements]
        self._remember(seen)
        return found

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
                yield self._oid(path) or "", path, data

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

    def read(self, path: str) -> bytes:
        """Return the content of an entry that is in force, or of a proposal.

        Raises:
            RegistryError: it does not exist, cannot be read, or nobody can say what is in force of it.
        """
        standing = self.standing(path)
        if standing is not None and standing.problem is not None:
            raise RegistryError(standing.problem)
        return standing.data if standing is not None and standing.data is not None else self.committed(path)

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

    def read_many(self, paths: Sequence[str]) -> Iterator[bytes]:
        """Yield the contents of many entries that are in force, or of proposals, in order, using few processes.

        Raises:
            RegistryError: as for :meth:`read`.
        """
        standings = self.standings(paths)
        if problem := next((one.problem for one in standings.values() if one.problem is not None), None):
            raise RegistryError(problem)
        replaced = {path: one.data for path, one in standings.items() if one.data is not None}
        rest = self.committed_many([path for path in paths if path not in replaced])
        return (replaced[path] if path in replaced else next(rest) for path in paths)

    def committed_many(self, paths: Sequence[str]) -> Iterator[bytes]:
        """Yield the contents of many files as they are in the tree; otherwise like :meth:`read_many`."""
        if self.repo is None:
            return (self.committed(path) for path in paths)
        oids = [oid for path in paths if (oid := self._oid(path)) is not None]
        if len(oids) < len(paths):
            missing = next(path for path in paths if self._oid(path) is None)
            raise RegistryError(f"{missing}: not in commit {(self.commit or '')[:12]}")
        return self.repo.objects(oids)

    def _oid(self, path: str) -> str | None:
        return self._files.get(path)

    def files(self) -> Iterator[tuple[str, bytes]]:
        """Yield path and content of every entry in ``cameras/``, sorted by path.

        Raises:
            RegistryError: an entry cannot be read.
        """
        paths = sorted(self.paths)
        return zip(paths, self.read_many(paths), strict=True)

    def entries(self, unreadable: Callable[[str, InputError], None] | None = None) -> Iterator[StoredEntry]:
        """Yield every entry in ``cameras/``, sorted by path.

        Args:
            unreadable: called with path and error of each entry that cannot be read.

        Raises:
            RegistryError: an entry cannot be read, and nobody takes the error.
        """
        return self._stored(sorted(self.paths), unreadable)

    def proposals(self) -> Iterator[StoredEntry]:
        """Yield every proposal, sorted by path; otherwise like :meth:`entries`."""
        return self._stored(sorted(self.proposed))

    def rows(
        self,
        paths: Iterable[str],
        *,
        unreadable: Callable[[RegistryError], None],
    ) -> Iterator[tuple[str, Row]]:
        """Yield the fields of the entries at some paths, in order.

        Args:
            paths: paths in ``cameras/`` and ``proposals/``.
            unreadable: called with the error of each entry that cannot be read.
        """
        wanted, new = sorted(paths), dict[str, dict[str, Value]]()
        standings = self.standings(wanted)
        own = {path: blob_id(one.data) for path, one in standings.items() if one.data is not None}
        said = {path: own.get(path) or self._oid(path) for path in wanted}
        refused = {path for path, one in standings.items() if one.problem is not None}
        oids = {path: oid for path, oid in said.items() if oid is not None and path not in refused}
        kept = self.contents.rows([*oids.values()]) if oids else {}
        rest = self.parsed([path for path in wanted if oids.get(path) not in kept])
        for path in wanted:
            row = kept.get(oids.get(path, ""))
            if row is None:
                _, entry = next(rest)
                if isinstance(entry, InputError):
                    unreadable(RegistryError(str(entry)))
                    continue
                row = entry_row(entry)
                if path in oids:
                    new[oids[path]] = row
            remark = self.remark(path)
            yield path, row | ({"remark": remark} if remark is not None else {})
        if new:
            self.contents.keep_rows(new)

    def stored(self, paths: Sequence[str]) -> tuple[StoredEntry, ...]:
        """Return the entries at some paths, in order.

        Raises:
            RegistryError: an entry does not exist, or cannot be read.
        """
        return tuple(self._stored(paths))

    def _stored(
        self, paths: Sequence[str], unreadable: Callable[[str, InputError], None] | None = None
    ) -> Iterator[StoredEntry]:
        for path, entry in self.parsed(paths):
            if isinstance(entry, Entry):
                yield self._as_stored(entry, path)
            elif unreadable is None:
                raise RegistryError(str(entry))
            else:
                unreadable(path, entry)

    def parsed(self, paths: Sequence[str]) -> Iterator[tuple[str, Entry | InputError]]:
        """Yield the entries that are in force at some paths, in order; the error if one cannot be read."""
        if self.repo is None:
            for _, path, data in self._each(paths):
                if isinstance(data, bytes):
                    yield path, parsed_or_error(path, data, require_digest=False)
                else:
                    yield path, data
            return
        standings = self.standings(paths)
        own = {path for path, one in standings.items() if one.data is not None or one.problem is not None}
        plain = [path for path in paths if path not in own]
        rest = self.contents.parsed(self._each(plain))
        for path in paths:
            one = standings.get(path)
            if one is not None and one.problem is not None:
                yield path, InputError(one.problem)
            elif one is not None and one.data is not None:
                yield path, parsed_or_error(path, one.data)
            else:
                yield next(rest)

    def _as_stored(self, entry: Entry, path: str) -> StoredEntry:
        base, standing = self._oid(path), self.standing(path)
        is_own = standing is None or standing.data is None
        return StoredEntry(
            entry=entry,
            path=path,
            oid=base if is_own or standing is None else blob_id(standing.data or b""),
            commit=self.commit,
            proposal=self.proposal_for(path),
            base=base,
            standing=standing,
        )

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
        """Return the proposal that a KEY names; else what its file in ``cameras/`` says, if nothing approves that.

        Raises:
            UnknownCameraError: there is neither a proposal nor an entry of that name.
            RegistryError: the KEY matches several.
        """
        name = in_use_path(key)
        waiting = f"{PROPOSED}{name.removeprefix(ROOT)}"
        if self.matching(waiting):
            return self.get(waiting)
        path = self.find(key)
        standing = self.standing(path)
        if standing is None or standing.remark is None:
            return self.get(key)
        entry = replace(self._parsed(path, self.committed(path)), status=Status.DRAFT, reason=None)
        base = self._oid(path)
        return StoredEntry(entry=entry, path=path, oid=base, commit=self.commit, base=base, standing=standing)

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
        proposed = {in_use_path(path): path for path in self.proposed}
        name = in_use_path(key)
        if not proposed:
            return []
        return [proposed[path] for path in find_paths(proposed, name) or self.of_unit(proposed, name)]

    def in_use(self, key: str) -> list[str]:
        """Return the paths in ``cameras/`` of all entries that a KEY may name."""
        return find_paths(self.paths, key) or self.of_unit(self.paths, key)

    def of_unit(self, paths: Collection[str], key: str) -> list[str]:
        """Return those of some paths that a KEY by a unit's label or serial number may name."""
        return unit_paths(paths, key, labels=lambda: self._called(key), makes=self._makes)

    def _called(self, key: str) -> Mapping[str, str]:
        """Return the labels that a KEY may mean, by path: where statements say what a unit is called, only those."""
        if not self.is_stated:
            return self.labels
        named = match_key(key.removeprefix(ROOT).strip("/").partition("/")[0])
        asked = {label_subject(path) for path, label in self.labels.items() if match_key(label) == named}
        asked |= {subject for _, _, word, subject in self.contents.mentions(NAMED) if word == named}
        called = {subject: label for subject in asked if (label := self.book.label(subject)) is not None}
        every = (*self.paths, *map(in_use_path, self.proposed)) if called else ()
        return {path: called[subject] for path in every if (subject := label_subject(path)) in called}

    @cached_property
    def labels(self) -> Mapping[str, str]:
        """Labels of all entries and proposals that have one, by path in ``cameras/``."""
        if self.repo is not None:
            said = sorted(self.contents.mentions(LABEL), key=lambda one: not is_proposal(one[0]))
            return {in_use_path(path): label for path, _, _, label in said}
        proposed = sorted(self.proposed)
        waiting = zip(map(in_use_path, proposed), self.read_many(proposed), strict=True)
        found = {path: label for path, data in waiting if (label := label_in(data)) is not None}
        return found | {path: label for path, data in self.files() if (label := label_in(data)) is not None}

    def label_of(self, unit: str | None) -> str | None:
        """Return the label of a unit, by its folder in ``cameras/``."""
        if unit is None:
            return None
        if self.is_stated:
            return self.book.label(label_subject(f"{unit}x"))
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
        if self.repo is None or self.commit is None:
            # In a folder, an entry written by hand needs no digest; an existing one must match.
            return RegistryIndex(
                self.paths,
                self.read,
                proposed=self.proposed,
                require_digest=False,
            )
        return RegistryIndex(
            self.paths,
            self.read,
            proposed=self.proposed,
            aliases=lambda: self.contents.aliases,
            earlier=self.earlier,
            prepare=self.standings,
            remark=self.remark,
        )

    def earlier(self, path: str) -> Iterator[tuple[str, Entry]]:
        """Yield (commit, entry) for an entry's earlier revisions that may be used, newest first."""
        repo, commit = self.require_git("has no history")
        return used_before(repo, commit, path, self.standing(path))

    def remark(self, path: str, status: Status = Status.APPROVED) -> str | None:
        """Return what to say of an entry: of a proposal what it lacks, else what of its file is not in force."""
        if status is Status.DRAFT:
            return str(self.only_proposed(path))
        standing = self.standing(path)
        return standing.remark if standing is not None else None

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
        if folders in self._indices:
            return self._indices[folders]
        every = self.repo.listing(self.commit, *folders, *map(proposal_path, folders))
        listed = [path for path in every if is_entry(path)]
        proposed = [*filter(is_proposal, listed)]
        if len(self._indices) >= MOST_INDICES:
            self._indices.clear()
        self._indices[folders] = RegistryIndex(
            [*(path for path in listed if not is_proposal(path)), *self._unfiled(*folders)],
            self.read,
            proposed=proposed,
            aliases=lambda: aliases,
            earlier=self.earlier,
            prepare=self.standings,
            remark=self.remark,
        )
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


def _entries_in(files: Mapping[str, str | None], top: str) -> dict[str, str | None]:
    return {path: oid for path, oid in files.items() if path.startswith(top) and is_entry(path)}


def used_before(
    repo: Repository, at: str, path: str, standing: Standing | None
) -> Iterator[tuple[str, Entry]]:
    """Yield (commit, entry) for an entry's earlier revisions that may be used, newest first.

    Args:
        repo: repository of the registry.
        at: commit up to which the history is read.
        path: path of the entry.
        standing: what the statements say of it; without, those that their files call usable are.
    """
    for revision in history(repo, path, at):
        if revision.oid is None or is_proposal(revision.path):
            continue
        with suppress(InputError):
            entry = parse_entry(repo.blob(revision.oid), revision.path)
            found = (entry if entry.is_usable else None) if standing is None else standing.was_approved(entry)
            if found is not None and found.is_usable:
                yield revision.commit, found


def unapproved(paths: Sequence[str]) -> str | None:
    """Return a sentence about entries with files that no statement approves; None if there are none."""
    return (
        "their files say what nothing that counts approves, so that is not used: "
        f"{first_of([*map(id_of, paths)])} ('calibrary registry check' says more)"
        if paths
        else None
    )


class StoredEntry(Struct, frozen=True, kw_only=True):
    """An entry as stored at one state of a registry.

    Attributes:
        entry: content of the file.
        path: path of the file.
        oid: blob id of the content; None in a plain folder.
        base: blob id of the file in the tree, the base for a change; it differs where something else is in force.
        commit: commit it was read from, 40 hexadecimal digits; None in a plain folder.
        proposal: path of the proposal to replace it; None if there is none, or it was not looked up.
        standing: what the statements say of it; None for a proposal, and in a registry without statements.
    """

    entry: Entry
    path: str
    oid: str | None
    commit: str | None
    proposal: str | None = None
    base: str | None = None
    standing: Standing | None = None

    @property
    def id(self) -> str:
        """Longest KEY of the entry."""
        return id_of(self.path)

    @property
    def is_pending(self) -> bool:
        """Whether it needs approval: a proposal or, in older registries, a draft."""
        return is_proposal(self.path) or self.entry.status is Status.DRAFT

    @property
    def members(self) -> dict[str, Any]:
        """Members of a listed entry, by name."""
        stated = {name: getattr(self.entry, name) for name in EntryFields.__struct_fields__}
        place = {"id": self.id, "path": self.path, "commit": self.commit, "blob": self.oid}
        remark = self.standing.remark if self.standing is not None else None
        return {**place, "proposal": self.proposal, "remark": remark, **stated}


class ListedEntry(EntryFields):
    """An entry as stored at a commit, with its calibration in the common printed form.

    Attributes:
        id: longest KEY of the entry.
        path: path of its file.
        commit: commit it was read from; None in a plain folder.
        blob: git's id of the file, which an approval refers to; None in a plain folder.
        proposal: path of the proposal to replace it; None if there is none.
        remark: what its file says that is not in force; None if nothing.
    """

    id: str
    path: Annotated[str, Meta(pattern="^(cameras|proposals)/.+[.]yaml$")]
    commit: ObjectId | None
    blob: ObjectId | None
    proposal: str | None = None
    remark: str | None = None

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
    if stored.entry.path != in_use_path(stored.path):
        raise RegistryError(
            f"{stored.path}: its camera belongs at {stored.entry.path}, so this is not the K of {stored.id}; "
            f"'calibrary registry log {stored.id}' shows who wrote it"
        )
    return stored
