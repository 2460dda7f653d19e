"""Where the repository of a folder is."""

from __future__ import annotations

import os
from pathlib import Path

from calibrary.registry.git.damage import refusal
from calibrary.registry.git.foreign import PEACE
from calibrary.registry.git.program import run_git

__all__ = ["discover"]


def discover(path: Path) -> tuple[Path, Path, bool]:
    """The git folder, the one it shares with linked work trees, and whether it is bare."""
    environment = PEACE | {"GIT_CEILING_DIRECTORIES": str(path.parent)}
    if "GIT_DIR" in os.environ:
        place = path / ".git"
        environment["GIT_DIR"] = str(place if place.exists() else path)
    if "GIT_OBJECT_DIRECTORY" in os.environ:
        # It only has to be a folder here; which one it is follows from what is found.
        environment["GIT_OBJECT_DIRECTORY"] = str(path)
    # A person may have git overlook bare repositories it comes by (git-config(1)); this one was named.
    command = ("-c", "safe.bareRepository=all", "rev-parse")
    found = run_git(
        (*command, "--is-bare-repository", "--absolute-git-dir", "--git-common-dir"),
        folder=path,
        environment=environment,
    )
    lines = os.fsdecode(found.out).splitlines()
    if found.code or len(lines) != 3:
        raise refusal(path, found.errors)
    git_dir = Path(os.path.realpath(lines[1]))
    common_dir = Path(os.path.realpath(path / lines[2]))
    is_bare = lines[0] == "true" or not (path / ".git").exists()
    return git_dir, common_dir, is_bare
