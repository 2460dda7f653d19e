"""Creating a repository that is independent of the machine's git configuration, and keeping it fast.

With the changed paths in the commit-graph the log of one entry among ten thousand commits takes a seventh of the
time. Maintenance changes nothing of what the registry holds.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from calibrary.errors import RegistryError
from calibrary.registry.git.foreign import PEACE
from calibrary.registry.git.names import check_branch, check_path
from calibrary.registry.git.program import git_version, run_git
from calibrary.registry.git.repository import Repository

__all__ = [
    "create",
    "index_paths",
    "is_due",
    "maintain",
]

SAMPLE = "17"
DUE_IN_SAMPLE = 10
"""Objects in one of 256 folders, as ``git gc --auto`` estimates; some 500 writes of an entry make that many."""


def is_due(repo: Repository) -> bool:
    """Whether some five hundred writes have gathered since the last time."""
    with suppress(OSError):
        return sum(1 for _ in (repo.common_dir / "objects" / SAMPLE).iterdir()) >= DUE_IN_SAMPLE
    return False


def maintain(repo: Repository, *, in_background: bool = False) -> None:
    """Pack what is loose and write the commit-graph; in the background as git itself does after its own commits.

    Raises:
        RegistryError: git could not.
    """
    if in_background:
        repo.run("-c", "gc.auto=1", "-c", "gc.autoDetach=true", "gc", "--auto", "--quiet")
        return
    if not is_locked(repo):
        repo.run("gc", "--quiet")
    index_paths(repo)


def index_paths(repo: Repository) -> None:
    """Note which commit touched which path; from then on gc keeps that up by itself."""
    repo.run("commit-graph", "write", "--reachable", "--changed-paths", "--no-progress")


def is_locked(repo: Repository) -> bool:
    """Whether a gc is at work already."""
    return Path(repo.common_dir, "gc.pid").exists()


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
        raise RegistryError(f"{path}: there is a git repository already; expected a folder without one")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RegistryError(f"{path}: cannot be created: {error.strerror}") from None
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
        raise RegistryError(f"{path}: cannot create a repository: {made.errors.strip()}")
    (place / "HEAD").write_text(f"ref: refs/heads/{check_branch(branch)}\n", encoding="utf-8")
    if not bare:
        # Noted of the place by init; with it the folder could not be moved.
        forget = ("config", "--unset-all", "core.worktree")
        run_git(forget, folder=path, environment=PEACE | {"GIT_DIR": str(place)})
    return Repository.open(path, durable=durable, check_path=check_path)
