"""A registry with its entries: found by KEY at any revision, written as one commit each with its reason."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from calibrary.errors import InputError, RegistryError, UnknownCameraError
from calibrary.keep.names import find_path, id_of
from calibrary.registry.charter import CHARTER, Charter, parse_charter
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from calibrary.registry.firmware import compare
from calibrary.registry.fleet import Note, Registry
from calibrary.registry.git.fast_import import Person
from calibrary.registry.git.history import Revision, newest_where
from calibrary.registry.git.revisions import Firmware, parse_rev
from calibrary.registry.git.writing import Change, Written
from calibrary.registry.resolution import RegistryIndex, is_keyed

__all__ = ["Held", "Keeper", "note_of", "refuse_broken"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Held:
    """An entry as it stands at a commit.

    Attributes:
        entry: what the file says.
        path: of the file.
        oid: the content's id, from which a change of it starts.
        commit: where it was read, 40 hexadecimal digits.
    """

    entry: Entry
    path: str
    oid: str
    commit: str

    @property
    def id(self) -> str:
        """The entry's longest KEY."""
        return id_of(self.path)


class Keeper:
    """A registry in git, and what its entries mean.

    Attributes:
        registry: the files and their history.
        charter: what it says of itself, and the policy its entries are held to.
    """

    def __init__(self, registry: Registry, charter: Charter | None = None) -> None:
        self.registry: Final = registry
        self.charter: Final = charter or Charter()

    @classmethod
    def open(cls, place: Path) -> Keeper:
        """The registry in a folder, bare or checked out.

        Raises:
            RegistryError: there is none, or it is of a newer layout than is read.
        """
        registry = Registry.open(place, check=refuse_broken)
        return cls(registry, _charter_of(registry))

    @classmethod
    def begin(cls, place: Path, files: Mapping[str, bytes], *, bare: bool = False) -> Keeper:
        """A new registry with its first commit.

        Args:
            place: a folder without a repository.
            files: what stands in it from the start, by path.
            bare: without a work tree.

        Raises:
            RegistryError: there is a repository already, or a file stands in the way.
        """
        registry, _ = Registry.init(place, files, bare=bare, check=refuse_broken)
        return cls(registry, _charter_of(registry))

    def get(self, key: str) -> Held:
        """The entry that ``KEY`` or ``KEY@REV`` means.

        Args:
            key: see :func:`calibrary.keep.names.find_path`, and :mod:`calibrary.registry.git.revisions` for REV.

        Raises:
            UnknownCameraError: no such camera, or not at that revision.
            RegistryError: several, or the entry cannot be read, or is of another camera than its path says.
        """
        name, at, rev = key.partition("@")
        if at and isinstance(meant := parse_rev(rev), Firmware):
            return self._of_firmware(name, meant.version)
        snapshot = self.registry.snapshot(rev if at else None)
        path = find_path(snapshot.paths, name)
        return _in_its_place(self._held(path, snapshot.paths[path], snapshot.commit))

    def entries(
        self, rev: str | None = None, *, unreadable: Callable[[RegistryError], None] | None = None
    ) -> Iterator[Held]:
        """Every entry at a revision, in the order of their paths.

        Args:
            rev: the newest commit where it is None.
            unreadable: is told of each entry that cannot be read, which then does not end the others.

        Raises:
            RegistryError: there is no such revision, or an entry cannot be read and nobody asked to be told.
        """
        snapshot = self.registry.snapshot(rev)
        for path, data in self.registry.read_all(snapshot):
            try:
                entry = _parsed(data, path)
            except RegistryError as error:
                if unreadable is None:
                    raise
                unreadable(error)
                continue
            yield Held(entry=entry, path=path, oid=snapshot.paths[path], commit=snapshot.commit)

    def files(self, rev: str | None = None) -> dict[str, bytes]:
        """The bytes of every entry at a revision, by path."""
        return dict(self.registry.read_all(self.registry.snapshot(rev)))

    def index(self, rev: str | None = None) -> RegistryIndex:
        """What :meth:`~calibrary.registry.resolution.RegistryIndex.resolve` answers from, at a revision."""
        snapshot = self.registry.snapshot(rev)
        return RegistryIndex(snapshot.paths, lambda path: self.registry.repo.blob(snapshot.paths[path]))

    def at(self, path: str) -> Held | None:
        """What stands at a path now; None where nothing does."""
        snapshot = self.registry.snapshot()
        oid = snapshot.paths.get(path)
        return self._held(path, oid, snapshot.commit) if oid is not None else None

    def revisions(self, path: str) -> Iterator[tuple[Revision, Entry | None]]:
        """What became of an entry, newest first; None where a commit removed it, or what it wrote is none.

        Raises:
            RegistryError: there is no history to read.
        """
        for revision in self.registry.history(path):
            entry = None
            if revision.oid is not None:
                try:
                    entry = parse_entry(self.registry.repo.blob(revision.oid), revision.path)
                except InputError:
                    entry = None
            yield revision, entry

    def save(
        self,
        entries: Sequence[tuple[Entry, str | None]],
        note: Note,
        *,
        author: Person | None = None,
        branch: str | None = None,
    ) -> Written:
        """Write entries as one commit.

        Args:
            entries: each with the id of the content it started from, None for a new one.
            note: what the history says of it.
            author: None for git's own user.
            branch: None for the one that is checked out.

        Raises:
            FileConflictError: somebody has changed one since; nothing was written.
            RegistryError: one cannot be written.
        """
        changes = [Change(path=entry.path, data=entry_yaml(entry), base=base) for entry, base in entries]
        return self.registry.put_many(changes, note, author=author, branch=branch)

    def _of_firmware(self, name: str, version: str) -> Held:
        snapshot = self.registry.snapshot()
        path = find_path(snapshot.paths, name)
        repo = self.registry.repo
        found = newest_where(repo, path, snapshot.commit, partial(_is_of_firmware, path, version))
        if found is None:
            raise UnknownCameraError(
                f"{id_of(path)}: no revision of it was made for firmware {version}; "
                f"'calibrary registry log {id_of(path)}' lists what there is"
            )
        revision, blob = found
        entry = _parsed(blob.data, revision.path)
        return _in_its_place(Held(entry=entry, path=revision.path, oid=blob.oid, commit=revision.commit))

    def _held(self, path: str, oid: str, commit: str) -> Held:
        entry = _parsed(self.registry.repo.blob(oid), path)
        return Held(entry=entry, path=path, oid=oid, commit=commit)


def note_of(subject: str, entries: Sequence[Entry], reason: str | None = None) -> Note:
    """What the history says of a change of entries, with a trailer for each thing a machine looks for."""
    calibrations = [entry.calibration for entry in entries]
    grades = {calibration.grade.value for calibration in calibrations}
    firmware = {calibration.provenance.firmware for calibration in calibrations}
    sources = [calibration.provenance.sha256 for calibration in calibrations]
    return Note(
        subject=subject,
        reason=reason,
        cameras=[entry.id for entry in entries],
        firmware=firmware.pop() if len(firmware) == 1 else None,
        grade=grades.pop() if len(grades) == 1 else None,
        sources=[source for source in dict.fromkeys(sources) if source is not None],
    )


def _parsed(data: bytes, path: str) -> Entry:
    try:
        return parse_entry(data, path)
    except InputError as error:
        raise RegistryError(str(error)) from None


def _in_its_place(held: Held) -> Held:
    """The same, unless somebody has put one camera's file where another's belongs."""
    if held.entry.path != held.path and is_keyed(held.path):
        raise RegistryError(
            f"{held.path}: the camera in it belongs at {held.entry.path}, so this is not the K of {held.id}; "
            f"'calibrary registry log {held.id}' tells who put it there"
        )
    return held


def _charter_of(registry: Registry) -> Charter:
    """What a registry says of itself; one that was begun by hand, by its entries alone, keeps the common rules."""
    repo = registry.repo
    tip = repo.tip()
    if tip is None:
        return Charter()
    blob = repo.read(tip, CHARTER)
    if blob is None:
        if registry.snapshot().paths:
            return Charter()
        raise RegistryError(
            f"{repo.path}: a git repository, but no registry: it has neither {CHARTER} nor entries in cameras/; "
            "'calibrary registry init FOLDER' makes one of its own"
        )
    try:
        return parse_charter(blob.data)
    except InputError as error:
        raise RegistryError(f"{repo.path}: {error}") from None


def refuse_broken(path: str, data: bytes) -> None:
    """What is asked of an entry before it is written."""
    entry = _parsed(data, path)
    if entry.path != path:
        raise RegistryError(f"{path}: the camera in it belongs at {entry.path}")


def _is_of_firmware(path: str, version: str, data: bytes) -> bool:
    try:
        entry = parse_entry(data, path)
    except InputError:
        return False
    made_with = entry.calibration.provenance.firmware
    if made_with == version:
        return True
    if made_with is not None:
        # What is no version number, such as an editor's name, leaves it to the range.
        with suppress(InputError):
            if compare(made_with, version) == 0:
                return True
    try:
        return entry.firmware is not None and entry.firmware.holds(version)
    except InputError:
        return False
