"""Creation of a repository that is independent of the machine's git configuration, and its maintenance.

With changed paths in the commit-graph, the log of one entry among ten thousand commits takes a seventh of the time.
Maintenance does not change the content of the registry.
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
"""Objects in one of 256 folders, as ``git gc --auto`` estimates; about 500 writes of an entry make this many."""


def is_due(repo: Repository) -> bool:
    """Return whether about 500 writes have accumulated since the last maintenance."""
    with suppress(OSError):
        return sum(1 for _ in (repo.common_dir / "objects" / SAMPLE).iterdir()) >= DUE_IN_SAMPLE
    return False


def maintain(repo: Repository, *, in_background: bool = False) -> None:
    """Pack loose objects and write the commit-graph; optionally in the background, as git does after its own commits.

    Raises:
        RegistryError: git failed.
    """
    if in_background:
        repo.run("-c", "gc.auto=1", "-c", "gc.autoDetach=true", "gc", "--auto", "--quiet")
        return
    if not is_locked(repo):
        repo.run("gc", "--quiet")
    index_paths(repo)


def index_paths(repo: Repository) -> None:
    """Store the paths changed by each commit in the commit-graph; gc keeps this up to date from then on."""
    repo.run("commit-graph", "write", "--reachable", "--changed-paths", "--no-progress")


def is_locked(repo: Repository) -> bool:
    """Return whether a gc is running."""
    return Path(repo.common_dir, "gc.pid").exists()


FORMATS = (("object", "sha1", (2, 29)), ("ref", "files", (2, 45)))
"""Set where git knows the option: GitPython cannot read git's future defaults."""


def create(
    path: Path,
    *,
    bare: bool = False,
    branch: str = "main",
    durable: bool = True,
    check_path: Callable[[str], str] = check_path,
) -> Repository:
    """Create a repository without a commit, and without the hooks of git's templates.

    Raises:
        RegistryError: there already is one, or the folder cannot be created.
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
    # Set the variables explicitly, since those of an enclosing hook would override the folder.
    where = PEACE | {"GIT_DIR": str(place), "GIT_OBJECT_DIRECTORY": str(place / "objects")}
    where |= {} if bare else {"GIT_WORK_TREE": str(path)}
    shape = ("--bare",) if bare else ()
    made = run_git(("init", "--quiet", "--template=", *formats, *shape), folder=path, environment=where)
    if made.code:
        raise RegistryError(f"{path}: cannot create a repository: {made.errors.strip()}")
    (place / "HEAD").write_text(f"ref: refs/heads/{check_branch(branch)}\n", encoding="utf-8")
    if not bare:
        # git init stores the path of the work tree; with it the folder could not be moved.
        forget = ("config", "--unset-all", "core.worktree")
        run_git(forget, folder=path, environment=PEACE | {"GIT_DIR": str(place)})
    return Repository.open(path, durable=durable, check_path=check_path)
