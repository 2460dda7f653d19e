"""Running git: the only module that starts it, either to its end or with its pipes held by the caller."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, cast

from msgspec import Struct

from calibrary.errors import RegistryError

if TYPE_CHECKING:
    from git import Git

__all__ = ["Output", "git_in", "git_version", "run_git", "started"]

OLDEST_GIT = (2, 24)


class Output(Struct, frozen=True):
    """Result of a git command."""

    code: int
    out: bytes
    errors: str


def run_git(
    arguments: Sequence[str],
    *,
    folder: Path,
    environment: Mapping[str, str],
    stdin: bytes | None = None,
    timeout_s: float | None = None,
) -> Output:
    """Run git to its end and return its output, whatever the exit code.

    Raises:
        RegistryError: git is not installed or too old, or took longer than ``timeout_s``.
    """
    git = git_in(folder)
    process = started(git, arguments, environment)
    try:
        out, errors = process.communicate(stdin if stdin is not None else b"", timeout=timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        raise RegistryError(
            f"git {arguments[-1]}: did not finish within {timeout_s:g} s; try again later"
        ) from None
    return Output(process.returncode, out, errors.decode("utf-8", "replace"))


def started(git: Git, arguments: Sequence[str], environment: Mapping[str, str]) -> subprocess.Popen[bytes]:
    """Start a git process; the caller holds its pipes."""
    command = [git.GIT_PYTHON_GIT_EXECUTABLE, *arguments]
    process = git.execute(command, istream=subprocess.PIPE, as_process=True, env=environment)
    return cast("subprocess.Popen[bytes]", process)


def git_in(folder: Path) -> Git:
    """Return GitPython's git for a folder.

    Raises:
        RegistryError: git is not installed or too old.
    """
    if shutil.which(os.environ.get("GIT_PYTHON_GIT_EXECUTABLE", "git")) is None:
        raise RegistryError("git is not installed, and a registry needs it: https://git-scm.com/downloads")
    from git import Git

    git = Git(folder)
    version = _version(git.GIT_PYTHON_GIT_EXECUTABLE)
    if version < OLDEST_GIT:
        found, oldest = (".".join(map(str, numbers)) for numbers in (version, OLDEST_GIT))
        raise RegistryError(f"found git {found}, expected {oldest} or newer")
    return git


def git_version(folder: Path) -> tuple[int, ...]:
    """Return the version of git as two numbers.

    Raises:
        RegistryError: git is not installed or too old.
    """
    return _version(git_in(folder).GIT_PYTHON_GIT_EXECUTABLE)


@lru_cache(maxsize=4)
def _version(executable: str) -> tuple[int, ...]:
    printed = subprocess.run([executable, "version"], capture_output=True, check=False).stdout  # noqa: S603
    found = re.search(rb"(\d+)\.(\d+)", printed)
    if found is None:
        raise RegistryError(f"{executable}: printed {printed!r}, expected git's version")
    return int(found[1]), int(found[2])
