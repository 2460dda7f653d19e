"""Beginning a registry: in a folder of its own, in a repository that is still empty, or as a copy of another."""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from calibrary.errors import CalibraryError, RegistryError
from calibrary.keep.keeper import Keeper, refuse_broken
from calibrary.keep.welcome import DRIVER, DRIVER_COMMAND, welcome_files
from calibrary.registry.charter import CHARTER
from calibrary.registry.fleet import Note, Registry
from calibrary.registry.git import maintenance
from calibrary.registry.git.remotes import clone
from calibrary.registry.git.urls import check_url, without_secret
from calibrary.registry.git.writing import Change
from calibrary.registry.layout import check_path

__all__ = ["Begun", "begin", "begin_from", "folder_for", "has_driver", "install_driver"]

BEGUN: Final = Note(subject="Begin a registry of camera calibrations")
LAST_NAME: Final = re.compile(r"([\w.-]+?)(?:\.git)?/*\Z")


@dataclass(frozen=True, slots=True, kw_only=True)
class Begun:
    """A registry that is there now.

    Attributes:
        keeper: of it.
        cloned_from: the address it is a copy of, without a password.
        files: that were written; none where it was copied whole.
        outer: the repository around it, if there is one, which should not take it in.
    """

    keeper: Keeper
    cloned_from: str | None
    files: tuple[str, ...]
    outer: Path | None


def begin(place: Path, *, bare: bool = False) -> Begun:
    """Make a registry.

    A repository without a commit, such as a clone of one that was just made at a host, is begun in. One with
    commits is somebody's: a registry is a repository of its own, so that its history is that of its cameras.

    Args:
        place: a folder, made if it is not there.
        bare: without a work tree, to be pushed to.

    Raises:
        RegistryError: there is a registry already, or something else in the way; nothing was changed.
    """
    files = welcome_files()
    standing = [name for name in files if not bare and (place / name).exists()]
    if (place / ".git").exists() or (place / "HEAD").exists():
        return _begun(_in_empty_repository(place, files, standing), files)
    if standing:
        if CHARTER not in standing:
            raise RegistryError(
                f"{place}: {', '.join(standing)} stands here already, which a registry has of its own; nothing was "
                "changed: name another folder"
            )
        raise RegistryError(
            f"{place}: a registry's files, but no git repository; nothing was changed: git init, git add and git "
            "commit take them in, or name another folder"
        )
    return _begun(Keeper.begin(place, files, bare=bare), files)


def begin_from(url: str, place: Path, *, bare: bool = False) -> Begun:
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
        registry, files = Registry(repo, check=refuse_broken), {}
        if repo.tip() is None:
            files = welcome_files()
            registry.put_many([Change(path=name, data=data) for name, data in files.items()], BEGUN)
        maintenance.index_paths(repo)
        keeper = Keeper.open(place)
    except CalibraryError:
        for made in place.iterdir() if existed else [place]:
            shutil.rmtree(made, ignore_errors=True)
        raise
    return Begun(keeper=keeper, cloned_from=shown, files=tuple(files), outer=_around(repo.path))


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


def has_driver(keeper: Keeper) -> bool:
    """Whether git knows how to show this registry's entries."""
    return keeper.registry.repo.setting(DRIVER) is not None


def install_driver(keeper: Keeper) -> None:
    """Tell this repository's git to show entries by their fields.

    Raises:
        RegistryError: its configuration cannot be written.
    """
    keeper.registry.repo.run("config", "--local", "--replace-all", DRIVER, DRIVER_COMMAND)


def _in_empty_repository(place: Path, files: dict[str, bytes], standing: list[str]) -> Keeper:
    repo = Registry.open(place).repo
    if repo.tip() is not None:
        keeper = Keeper.open(place) if _is_registry(place) else None
        if keeper is not None:
            raise RegistryError(
                f"{place}: there is a registry already; nothing was changed. 'calibrary registry list' shows what is "
                "in it"
            )
        raise RegistryError(
            f"{place}: a git repository of something else, and a registry is one of its own; nothing was changed: "
            f"name a folder beside it, or in it: calibrary registry init {place / 'cameras-registry'}"
        )
    if standing:
        raise RegistryError(f"{place}: {', '.join(standing)} stands here already; nothing was changed")
    registry = Registry(repo, check=refuse_broken)
    registry.put_many([Change(path=name, data=data) for name, data in files.items()], BEGUN)
    maintenance.index_paths(repo)
    return Keeper.open(place)


def _is_registry(place: Path) -> bool:
    registry = Registry.open(place)
    tip = registry.repo.tip()
    return tip is not None and (
        registry.repo.read(tip, CHARTER) is not None or bool(registry.snapshot().paths)
    )


def _begun(keeper: Keeper, files: dict[str, bytes]) -> Begun:
    return Begun(
        keeper=keeper, cloned_from=None, files=tuple(files), outer=_around(keeper.registry.repo.path)
    )


def _around(place: Path) -> Path | None:
    return next((folder for folder in place.parents if (folder / ".git").exists()), None)
