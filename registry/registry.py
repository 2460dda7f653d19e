"""A fleet's registry in git: reading, and changes with a reason."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Final, Self

from calibrary.errors import InputError, RegistryError, UnknownCameraError
from calibrary.records import replace
from calibrary.registry import history as entry_history
from calibrary.registry.configuration import Configuration, configuration_at, parse_configuration
from calibrary.registry.entry import Status
from calibrary.registry.entry_yaml import parse_entry, parsed
from calibrary.registry.git.errors import TooLargeError
from calibrary.registry.git.history import ChangedFile, Firmware, changed, commit_at, newest_where, parse_rev
from calibrary.registry.git.program import check_branch
from calibrary.registry.git.repository import Repository, require_branch
from calibrary.registry.history import EntryRevision
from calibrary.registry.paths import CAMERAS, PROPOSED, ROOT, check_path, file_path, id_of, is_entry
from calibrary.registry.places import CONFIGURATION_FILE, FOLDER, plain_folder
from calibrary.registry.snapshot import Snapshot, StoredEntry, read_entry_file, require_own_path
from calibrary.registry.statements import content_of, subject_of

KEPT_SNAPSHOTS: Final = 4
PATCHED_FROM: Final = 1000
"""Number of entries above which a new state is derived from the last one instead of being listed."""


class Registry:
    """A fleet's registry in git: its states, and changes that are proposed, checked, and written as one commit.

    Safe to share between threads and to carry over a fork.

    Attributes:
        repo: the repository.
        configuration: content of ``registry.yaml``, with the policy for entries.
    """

    def __init__(self, repo: Repository) -> None:
        """Open the registry in a repository.

        Raises:
            RegistryError: the repository contains other files, or a registry with another layout.
        """
        self.repo: Final = repo
        self.configuration: Final = _configuration_of(repo)
        self._snapshots: dict[str, Snapshot] = {}

    @classmethod
    def open(cls, place: Path, *, durable: bool = True) -> Self:
        """Open the registry in a folder, bare or checked out.

        Raises:
            RegistryError: there is none, or its kind or layout is not supported.
        """
        if plain_folder(place) is not None:
            raise RegistryError(
                f"{place}: a plain folder, without history, approvals or revisions; expected a registry in git for this"
            )
        if (place / ROOT).is_dir() and not any(
            os.path.lexists(folder / ".git") for folder in (place, *place.parents)
        ):
            raise RegistryError(
                f"{place}: files of a registry without git: nothing says who approved them, and whether they are "
                f"complete. {FOLDER}{place} reads them as they are; calibrary registry init FOLDER makes a registry"
            )
        return cls(Repository.open(place, durable=durable, check_path=check_path))

    def commit(self, rev: str | None = None) -> str:
        """Return the commit of a revision; by default the newest.

        Raises:
            RegistryError: there is no such revision.
        """
        return commit_at(self.repo, parse_rev(rev)) if rev is not None else self.repo.newest()

    def snapshot(self, rev: str | None = None) -> Snapshot:
        """Return the entries at a revision; a state that was read before is reused.

        Raises:
            RegistryError: there is no such revision.
        """
        commit = self.commit(rev)
        known = self._snapshots.get(commit)
        if known is None:
            known = Snapshot(
                place=self.repo.path,
                configuration=self.configuration,
                repo=self.repo,
                commit=commit,
            )
            kept = [*self._snapshots.items()][1 - KEPT_SNAPSHOTS :]
            self._snapshots = {**dict(kept), commit: known}
        return known

    def get(self, key: str) -> StoredEntry:
        """Return the entry that ``KEY`` or ``KEY@REV`` names.

        Args:
            key: see :func:`calibrary.registry.paths.find_path`, and :mod:`calibrary.registry.git.history` for REV.

        Raises:
            UnknownCameraError: the camera does not exist, or not at that revision.
            RegistryError: several entries match, or the entry cannot be read, or is of another camera than its path.
        """
        if key.endswith(PROPOSED):
            return self.snapshot().get(key)
        name, at, rev = key.partition("@")
        if at and isinstance(meant := parse_rev(rev), Firmware):
            return self._of_firmware(name, meant.version)
        return self.snapshot(rev if at else None).get(name)

    def _of_firmware(self, name: str, version: str) -> StoredEntry:
        snapshot = self.snapshot()
        path = file_path(snapshot.find(name))
        found = newest_where(self.repo, path, self.commit(), partial(_is_of_firmware, path, version))
        if found is None:
            there = dict.fromkeys(one.firmware for one in self.revisions(path) if one.firmware is not None)
            known = f"there is {', '.join(there)}" if there else "none states a firmware"
            raise UnknownCameraError(
                f"{id_of(path)}: no revision of it was made for firmware {version}; {known}"
            )
        revision, blob = found
        entry = parsed(blob.data, revision.path)
        approved = snapshot.book.in_force(subject_of(path)).approved.values()
        if content_of(entry) in {one.says for one in approved}:
            entry = replace(entry, status=Status.APPROVED)
        return require_own_path(
            StoredEntry(entry=entry, path=revision.path, oid=blob.oid, commit=revision.commit)
        )

    def history(self, key: str | None = None, *, most: int | None = None) -> tuple[EntryRevision, ...]:
        """Return all revisions of an entry, or of the whole registry, newest first.

        Raises:
            UnknownCameraError: the entry does not exist and never did.
        """
        return entry_history.history(self.snapshot(), key, most=most)

    def revisions(self, path: str) -> Iterator[EntryRevision]:
        """Yield all revisions of the file at a path, newest first."""
        return iter(entry_history.of_path(self.repo, self.commit(), path))

    def changed(self, before: str | None, after: str | None = None) -> tuple[ChangedFile, ...]:
        """Return the files of entries that differ between two revisions; without ``before``, all of them."""
        start, end = self.commit(before) if before is not None else None, self.commit(after)
        return changed(self.repo, start, end, CAMERAS)

    def branch(self, name: str | None) -> Snapshot:
        """Return the state of a branch; if there is no such branch yet, that of the current one."""
        is_there = name is not None and self.repo.tip(f"refs/heads/{check_branch(name)}") is not None
        return self.snapshot(f"refs/heads/{name}" if is_there else None)


def uncommitted(repo: Repository) -> tuple[str, ...]:
    """Return the entries with uncommitted changes in the work tree; they are in no snapshot."""
    if repo.work_tree is None:
        return ()
    options = ("--porcelain", "-z", "--no-renames", "--untracked-files=all")
    listed = repo.run("status", *options, "--", ROOT).out
    return tuple(filter(is_entry, (os.fsdecode(line[3:]) for line in listed.split(b"\0") if line)))


def open_snapshot(place: Path, rev: str | None = None) -> Snapshot:
    """Return the entries of the registry in a folder.

    Args:
        place: a bare repository or a checkout; ``folder:PATH`` reads the files in a folder as they are.
        rev: revision of a git registry; by default the one that is checked out.

    Raises:
        RegistryError: there is no registry or no such revision, or a revision was given for a folder without git.
    """
    folder = plain_folder(place)
    if folder is None:
        return Registry.open(place).snapshot(rev)
    if rev is not None:
        raise RegistryError(
            f"{place}: a plain folder has no revisions; expected a registry in git for {rev!r}"
        )
    if not (folder / ROOT).is_dir():
        raise RegistryError(
            f"{folder}: no registry here: expected a folder 'cameras' with one YAML file a camera"
        )
    return Snapshot(place=folder, configuration=_configuration_in(folder))


def _configuration_in(place: Path) -> Configuration:
    if not (place / CONFIGURATION_FILE).is_file():
        return Configuration()
    try:
        return parse_configuration(read_entry_file(place, CONFIGURATION_FILE))
    except (InputError, TooLargeError) as error:
        return Configuration(damage=str(error))


def _configuration_of(repo: Repository) -> Configuration:
    """Return the registry's configuration; the default if it has none."""
    tip = repo.tip()
    if tip is None:
        require_branch(repo)
        return Configuration()
    found = configuration_at(repo, tip)
    if found is None and not repo.listing(tip, CAMERAS):
        raise RegistryError(
            f"{repo.path}: a git repository, but not a registry: it has neither {CONFIGURATION_FILE} nor entries in "
            "cameras/; 'calibrary registry init FOLDER' makes one of its own"
        )
    return found or Configuration()


def _is_of_firmware(path: str, version: str, data: bytes) -> bool:
    try:
        return parse_entry(data, path).is_of_firmware(version)
    except InputError:
        return False
