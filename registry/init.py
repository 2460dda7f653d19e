"""Making a registry: in a folder of its own, in a repository that is still empty, or as a copy of another."""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from calibrary.errors import CalibraryError, RegistryError
from calibrary.records import replace
from calibrary.registry.charter import CHARTER
from calibrary.registry.git import maintenance
from calibrary.registry.git.creating import create
from calibrary.registry.git.remotes import clone
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.urls import check_url, without_secret
from calibrary.registry.git.writing import Change
from calibrary.registry.layout import CAMERAS, check_path
from calibrary.registry.registry import Registry
from calibrary.registry.scaffold import DRIVER, DRIVER_COMMAND, scaffold
from calibrary.registry.writing import Note, write_changes

__all__ = ["Initialised", "folder_for", "init", "init_from", "install_driver"]

FIRST: Final = Note(subject="Begin a registry of camera calibrations")
LAST_NAME: Final = re.compile(r"([\w.-]+?)(?:\.git)?/*\Z")


@dataclass(frozen=True, slots=True, kw_only=True)
class Initialised:
    """A registry that was made.

    Attributes:
        registry: the registry.
        cloned_from: the address it is a copy of, without a password.
        files: that were written; none where it was copied whole.
        outer: the repository around it, if there is one, which should not take it in.
    """

    registry: Registry
    cloned_from: str | None
    files: tuple[str, ...]
    outer: Path | None


def init(place: Path, *, bare: bool = False) -> Initialised:
    """Make a registry.

    A repository without a commit, such as a clone of one that was just made at a host, is begun in. One with
    commits is somebody's: a registry is a repository of its own, so that its history is that of its cameras.

    Args:
        place: a folder, made if it is not there.
        bare: without a work tree, to be pushed to.

    Raises:
        RegistryError: there is a registry already, or something else in the way; nothing was changed.
    """
    files = scaffold()
    in_the_way = [name for name in files if not bare and (place / name).exists()]
    if (place / ".git").exists() or (place / "HEAD").exists():
        repo = _empty_repository(place, in_the_way)
    elif CHARTER in in_the_way:
        raise RegistryError(
            f"{place}: a registry's files, but no git repository; nothing was changed: git init, git add and git "
            "commit take them in, or name another folder"
        )
    elif in_the_way:
        raise RegistryError(
            f"{place}: {', '.join(in_the_way)} exists already, which a registry has of its own; nothing was "
            "changed: name another folder"
        )
    else:
        repo = create(place, bare=bare, check_path=check_path)
    return _initialised(repo, files)


def init_from(url: str, place: Path, *, bare: bool = False) -> Initialised:
    """A copy of another registry; where the other is empty still, it is begun here, to be pushed.

    Args:
        url: https://, ssh://, user@host:path or a folder.
        place: a new or empty folder.
        bare: without a work tree.

    Raises:
        RegistryError: it cannot be reached or is no registry; nothing stays behind.
    """
    shown, existed = without_secret(check_url(url)), place.exists()
    repo = clone(url, place, bare=bare, check_path=check_path)
    try:
        made = _initialised(repo, scaffold() if repo.tip() is None else {})
    except CalibraryError:
        for leftover in place.iterdir() if existed else [place]:
            shutil.rmtree(leftover, ignore_errors=True)
        raise
    return replace(made, cloned_from=shown)


def folder_for(url: str) -> Path:
    """The folder that git would clone to: the address's last name, here.

    Raises:
        RegistryError: the address has none.
    """
    found = LAST_NAME.search(url.replace("\\", "/").rstrip("/"))
    if found is None or set(found[1]) <= {"."}:
        raise RegistryError(
            f"{without_secret(url)}: says no name for the folder; name one: init PATH --remote URL"
        )
    return Path(found[1])


def install_driver(repo: Repository) -> None:
    """Tell this repository's git to show entries by their fields.

    Raises:
        RegistryError: its configuration cannot be written.
    """
    repo.run("config", "--local", "--replace-all", DRIVER, DRIVER_COMMAND)


def _empty_repository(place: Path, in_the_way: list[str]) -> Repository:
    repo = Repository.open(place, check_path=check_path)
    if repo.tip() is not None:
        if _is_registry(repo):
            raise RegistryError(
                f"{place}: there is a registry already; nothing was changed. 'calibrary registry list' shows what is "
                "in it"
            )
        raise RegistryError(
            f"{place}: a git repository of something else, and a registry is one of its own; nothing was changed: "
            f"name a folder beside it, or in it: calibrary registry init {place / 'cameras-registry'}"
        )
    if in_the_way:
        raise RegistryError(f"{place}: {', '.join(in_the_way)} exists already; nothing was changed")
    return repo


def _is_registry(repo: Repository) -> bool:
    tip = repo.tip()
    return tip is not None and (repo.read(tip, CHARTER) is not None or bool(repo.listing(tip, CAMERAS)))


def _initialised(repo: Repository, files: dict[str, bytes]) -> Initialised:
    """With its first commit, where there are files to write."""
    if files:
        write_changes(repo, [Change(path=name, data=data) for name, data in files.items()], FIRST)
    maintenance.index_paths(repo)
    return Initialised(
        registry=Registry(repo), cloned_from=None, files=tuple(files), outer=_around(repo.path)
    )


def _around(place: Path) -> Path | None:
    return next((folder for folder in place.parents if (folder / ".git").exists()), None)
