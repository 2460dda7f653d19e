"""Making the repository of a registry: of a kind that is read here, and free of the machine's own taste."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from calibrary.errors import RegistryError
from calibrary.registry.git.foreign import PEACE
from calibrary.registry.git.paths import check_branch, check_path
from calibrary.registry.git.repository import Repository, git_version, run_git

__all__ = ["create"]

FORMATS = (("object", "sha1", (2, 29)), ("ref", "files", (2, 45)))
"""Said where git knows the option: its coming defaults are of kinds that GitPython does not read."""


def create(
    path: Path,
    *,
    bare: bool = False,
    branch: str = "main",
    durable: bool = True,
    check_path: Callable[[str], str] = check_path,
) -> Repository:
    """A new repository without a commit, and without the hooks that templates would bring.

    Raises:
        RegistryError: there is one already, or the folder cannot be made.
    """
    if (path / ".git").exists() or (path / "HEAD").exists():
        raise RegistryError(f"{path}: there is a git repository already; wanted a folder without one")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RegistryError(f"{path}: cannot be made: {error.strerror}") from None
    path = path.resolve()
    place = path if bare else path / ".git"
    version = git_version(path)
    formats = [f"--{name}-format={kind}" for name, kind, since in FORMATS if version >= since]
    # The variables say where, for those of a hook around us would win over the folder.
    where = PEACE | {"GIT_DIR": str(place), "GIT_OBJECT_DIRECTORY": str(place / "objects")}
    where |= {} if bare else {"GIT_WORK_TREE": str(path)}
    shape = ("--bare",) if bare else ()
    made = run_git(("init", "--quiet", "--template=", *formats, *shape), folder=path, environment=where)
    if made.code:
        raise RegistryError(f"{path}: no repository can be made there: {made.told.strip()}")
    (place / "HEAD").write_text(f"ref: refs/heads/{check_branch(branch)}\n", encoding="utf-8")
    if not bare:
        # Noted of the place by init; with it the folder could not be moved.
        forget = ("config", "--unset-all", "core.worktree")
        run_git(forget, folder=path, environment=PEACE | {"GIT_DIR": str(place)})
    return Repository.open(path, durable=durable, check_path=check_path)
