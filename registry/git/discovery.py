"""Finding the repository of a folder."""

from __future__ import annotations

import os
from pathlib import Path

from calibrary.registry.git.damage import refusal
from calibrary.registry.git.foreign import PEACE
from calibrary.registry.git.program import run_git

__all__ = ["discover"]


def discover(path: Path) -> tuple[Path, Path, bool]:
    """Return the git folder, the one shared with linked work trees, and whether the repository is bare."""
    environment = PEACE | {"GIT_CEILING_DIRECTORIES": str(path.parent)}
    if "GIT_DIR" in os.environ:
        place = path / ".git"
        environment["GIT_DIR"] = str(place if place.exists() else path)
    if "GIT_OBJECT_DIRECTORY" in os.environ:
        # Any existing folder; git only requires one here.
        environment["GIT_OBJECT_DIRECTORY"] = str(path)
    # git can be configured to ignore bare repositories that it finds (git-config(1)); this one was given explicitly.
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
