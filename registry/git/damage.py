"""Diagnosis of a repository that git does not open, or of a branch that git does not find.

For git, a branch with an empty file or a lost commit looks like one without commits, and a folder without HEAD is not
a repository. Neither must be mistaken for an empty registry, or for a plain folder.
"""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path
from typing import Final

from calibrary.errors import RegistryError
from calibrary.registry.git.errors import explain
from calibrary.registry.git.objects import HEX

__all__ = ["REF", "damaged", "lost_ref", "refusal"]

REF: Final = re.compile(r"refs/(?!.*\.\.)[^\0-\040\\:?*\[~^]+\Z")
PACKED: Final = re.compile(r"(#.*|\^[0-9a-f]{40}|[0-9a-f]{40} \S+)?\Z")
DEEPEST: Final = 5


def damaged(place: Path, what: str, remedy: str = "") -> RegistryError:
    """Return the error for a damaged repository, with the commands that diagnose or repair it."""
    return RegistryError(
        f"{place}: the repository is damaged: {what}. {remedy}'git -C {place} fsck --full' lists what is missing or "
        "broken; what is pushed is whole in a new clone: calibrary registry init FOLDER --remote URL"
    )


def lost_ref(git_dir: Path, common_dir: Path, ref: str, depth: int = DEEPEST) -> str | None:
    """Return what is wrong with a ref that git does not resolve to a commit; None if it does not exist.

    Args:
        git_dir: git folder of the work tree.
        common_dir: git folder of the repository.
        ref: ``HEAD`` or the full name.
        depth: allowed number of symbolic refs.
    """
    if ref != "HEAD" and (REF.match(ref) is None or not depth):
        return f"HEAD points to {ref[:60]!r}, expected a branch such as refs/heads/main"
    file = git_dir / ref if ref == "HEAD" else common_dir / ref
    try:
        content = file.read_bytes()[:200].decode("utf-8", "replace").strip()
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        return _lost_packed(common_dir / "packed-refs", ref)
    except OSError as error:
        return f"{file} cannot be read: {error.strerror}"
    if content.startswith("ref: "):
        return lost_ref(git_dir, common_dir, content.removeprefix("ref: ").strip(), depth - 1)
    if HEX.match(content) is not None:
        return f"{ref} is at commit {content[:12]}, which is missing or is not a commit"
    return (
        f"{file} is empty"
        if not content.strip("\0")
        else f"{file} contains {content[:40]!r}, expected a commit"
    )


def _lost_packed(file: Path, ref: str) -> str | None:
    try:
        lines = file.read_bytes().decode("utf-8", "replace").splitlines()
    except FileNotFoundError:
        return None
    except OSError as error:
        return f"{file} cannot be read: {error.strerror}"
    for number, line in enumerate(lines, start=1):
        if PACKED.match(line) is None:
            return f"line {number} of {file} is {line[:40]!r}, expected a commit and the name of a branch"
        if line[40:] == f" {ref}":
            return f"{ref} is at commit {line[:12]}, which is missing or is not a commit"
    return None


def refusal(path: Path, content: str) -> RegistryError:
    """Return the error for a folder that git does not open as a repository, with a remedy.

    Args:
        path: the folder.
        content: message of git.
    """
    git_dir = path / ".git" if os.path.lexists(path / ".git") else path
    if "dubious ownership" in content:
        return _of_another_user(path)
    if "not a git repository" not in content:
        return RegistryError(f"{path}: cannot be opened: {explain(content)}")
    if git_dir != path or any(os.path.lexists(path / name) for name in ("objects", "refs")):
        return _broken(path, git_dir)
    around = next((folder for folder in path.parents if os.path.lexists(folder / ".git")), None)
    if around is not None:
        inside = path.relative_to(around).as_posix()
        return RegistryError(
            f"{path}: not a git repository, but a folder of the one in {around}; expected a registry that is a "
            "repository of its own, with its own history and approvals. To make it one, with its history: git -C "
            f"{around} subtree split --prefix={inside} -b registry, then calibrary registry init FOLDER --remote URL "
            "of what you push it to"
        )
    return RegistryError(
        f"{path}: not a git repository; expected a registry: calibrary registry init makes one"
    )


def _of_another_user(path: Path) -> RegistryError:
    return RegistryError(
        f"{path}: it belongs to another user, and git reads it only if you say that you trust it. For one command, "
        "without writing anything: GIT_CONFIG_COUNT=1 GIT_CONFIG_KEY_0=safe.directory GIT_CONFIG_VALUE_0="
        f"{path} calibrary …; for good: git config --global --add safe.directory {path}"
    )


def _broken(path: Path, git_dir: Path) -> RegistryError:
    """Return the error that names the missing part of a git folder."""
    try:
        if stat.S_ISREG(git_dir.stat().st_mode):
            points = git_dir.read_text("utf-8", "replace").strip()[:200]
            return damaged(path, f"{git_dir} says {points!r}, and no repository is there")
        next(git_dir.iterdir(), None)
        head = (git_dir / "HEAD").read_bytes()[:60]
    except FileNotFoundError as error:
        return damaged(path, f"{error.filename} is missing", _head_remedy(git_dir))
    except OSError as error:
        return RegistryError(
            f"{path}: {error.filename} cannot be read: {error.strerror}; expected read access for this user: "
            f"ls -ld {error.filename}"
        )
    missing = [name for name in ("objects", "refs") if not (git_dir / name).is_dir()]
    if missing:
        return damaged(path, f"{git_dir} has no {' and no '.join(missing)}")
    return damaged(
        path, f"{git_dir / 'HEAD'} contains {head!r}, expected 'ref: refs/heads/main'", _head_remedy(git_dir)
    )


def _head_remedy(git_dir: Path) -> str:
    return f"Put it back: echo 'ref: refs/heads/main' > {git_dir / 'HEAD'} (or the name of your branch). "
