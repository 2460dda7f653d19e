"""Where a registry's entries are read from: the commit that git stands at, or a plain folder of files.

A git repository that holds a registry is read at its commits, never in its work tree: a run rests on what was
committed, and can say which commit that was. A folder without git, or whose git knows nothing of the registry
in it, is read as the files that lie there.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from calibrary.calibration import CameraKey
from calibrary.errors import RegistryError
from calibrary.keep.alias_cache import names_at, names_kept
from calibrary.keep.keeper import Keeper
from calibrary.registry.charter import CHARTER
from calibrary.registry.entry import ROOT, folder_of
from calibrary.registry.fleet import Registry
from calibrary.registry.folder import entry_paths, open_folder, read_entry_file
from calibrary.registry.git.repository import Repository
from calibrary.registry.resolution import AliasMap, RegistryIndex
from calibrary.registry.slug import match_key

__all__ = ["Shelf", "open_shelf"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Shelf:
    """A registry's entries at one state.

    Attributes:
        place: the registry's folder.
        keeper: of a git registry, None of a plain folder.
        commit: which state of it, 40 hexadecimal digits.
    """

    place: Path
    keeper: Keeper | None = None
    commit: str | None = None

    def index(self) -> RegistryIndex:
        """All entries, for those who ask for many cameras.

        Raises:
            RegistryError: there is no registry in the folder, or it cannot be listed.
        """
        if self.keeper is None or self.commit is None:
            return open_folder(self.place)
        repo, snapshot = self.keeper.registry.repo, self.keeper.registry.snapshot(self.commit)
        return RegistryIndex(
            snapshot.paths,
            lambda path: repo.blob(snapshot.paths[path]),
            aliases=partial(_aliases_at, repo, self.commit),
        )

    def index_for(self, key: CameraKey) -> RegistryIndex:
        """The entries that one camera may meet, without listing all others where an earlier run has left a note.

        Raises:
            RegistryError: as of :meth:`index`.
        """
        if self.keeper is None or self.commit is None or not key.make or not key.model:
            return self.index()
        repo = self.keeper.registry.repo
        names = names_kept(repo, self.commit)
        if names is None:
            return self.index()
        aliases = names.alias_map
        others = aliases.get((match_key(key.make), match_key(key.model)), frozenset())
        paths = list(names.irregular)
        for folder in sorted({folder_of(key.make, key.model), *others}):
            paths += repo.listing(self.commit, folder)
        return RegistryIndex(paths, partial(_file_at, repo, self.commit), aliases=lambda: aliases)

    def uncommitted(self) -> tuple[str, ...]:
        """Entries that somebody changed in the work tree and did not commit; what is read does not hold them."""
        if self.keeper is None or self.keeper.registry.repo.work_tree is None:
            return ()
        told = self.keeper.registry.repo.run(
            "status", "--porcelain", "-z", "--no-renames", "--untracked-files=all", "--", ROOT
        ).out
        return tuple(os.fsdecode(line[3:]) for line in told.split(b"\0") if line)

    def read(self, path: str) -> bytes:
        """One entry's bytes.

        Raises:
            RegistryError: it is not there, or cannot be read.
        """
        if self.keeper is None or self.commit is None:
            return read_entry_file(self.place, path)
        return _file_at(self.keeper.registry.repo, self.commit, path)

    def files(self) -> Mapping[str, bytes]:
        """Every entry's bytes, by path.

        Raises:
            RegistryError: one cannot be read.
        """
        if self.keeper is None:
            return {path: read_entry_file(self.place, path) for path in entry_paths(self.place)}
        return self.keeper.files(self.commit)


def open_shelf(place: Path, rev: str | None = None) -> Shelf:
    """The registry in a folder.

    Args:
        place: a bare repository, a checkout, or a folder of files.
        rev: which state of a git registry; the one that is checked out when left out.

    Raises:
        RegistryError: there is none, no such revision, or a revision was asked of a folder without git.
    """
    keeper = _kept_by_git(place)
    if keeper is not None:
        return Shelf(place=place, keeper=keeper, commit=keeper.registry.commit(rev))
    if rev is not None:
        raise RegistryError(f"{place}: a plain folder has no revisions; wanted a registry in git for {rev!r}")
    if not (place / ROOT).is_dir():
        raise RegistryError(
            f"{place}: no registry here: wanted one in git (calibrary registry init makes it), or a folder "
            "'cameras' with one YAML file a camera"
        )
    return Shelf(place=place)


def _kept_by_git(place: Path) -> Keeper | None:
    """The registry that a repository holds; None where there is no repository, or one of something else."""
    is_checkout = (place / ".git").exists()
    is_bare = not is_checkout and (place / "HEAD").is_file() and (place / "objects").is_dir()
    if not (is_checkout or is_bare):
        return None
    if is_checkout:
        # A folder of entries in somebody's repository of scripts is no registry of git's.
        repo = Registry.open(place).repo
        tip = repo.tip()
        if tip is None or repo.read(tip, CHARTER) is None:
            return None
    return Keeper.open(place)


def _aliases_at(repo: Repository, commit: str) -> AliasMap:
    return names_at(repo, commit).alias_map


def _file_at(repo: Repository, commit: str, path: str) -> bytes:
    blob = repo.read(commit, path)
    if blob is None:
        raise RegistryError(f"{path}: not at {commit[:12]}")
    return blob.data
