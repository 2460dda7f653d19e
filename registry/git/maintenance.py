"""Keeping a repository quick: loose objects into packs, and an index of which commit touched which path.

With the changed paths in the commit-graph the log of one entry among ten thousand commits takes a seventh of the
time. Nothing here changes what the registry holds.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from calibrary.registry.git.repository import Repository

__all__ = ["index_paths", "is_due", "maintain"]

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
