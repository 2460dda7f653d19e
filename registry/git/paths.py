"""Which names may reach git, as paths, branches and remotes.

git itself takes ``../x`` and ``.git/config`` as paths in a fast-import stream, and lets a file take a folder's
name. What is let through here holds on disks that ignore case and on Windows too.
"""

from __future__ import annotations

import re

from calibrary.errors import RegistryError

__all__ = ["LONGEST_NAME", "check_branch", "check_path", "check_remote_name", "is_safe_name"]

LONGEST_NAME = 120
NAME = re.compile(r"[A-Za-z0-9_.][A-Za-z0-9._~+-]*\Z")
DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9]|conin\$|conout\$)(\.|\Z)", re.IGNORECASE)
BRANCH = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._+-]*(/[A-Za-z0-9_][A-Za-z0-9._+-]*)*\Z")
REMOTE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,60}\Z")


def check_path(path: str) -> str:
    """The path itself, if every system takes it for a file below the repository's root.

    Raises:
        RegistryError: it does not.
    """
    if not all(is_safe_name(name) for name in path.split("/")):
        raise RegistryError(
            f"{path!r} is not a path in a repository: wanted names of letters, digits, . _ ~ + -"
        )
    return path


def is_safe_name(name: str) -> bool:
    """Whether a part of a path means the same to every file system and nothing special to git."""
    return (
        len(name) <= LONGEST_NAME
        and NAME.match(name) is not None
        and DEVICE.match(name) is None
        and not name.endswith((".", ".lock"))
        and ".." not in name
        and name.casefold() not in {".git", "git~1"}
    )


def check_branch(name: str) -> str:
    """The branch's name itself, if git takes it on every system and it looks like no option.

    Raises:
        RegistryError: it does not.
    """
    parts = name.split("/")
    if (
        BRANCH.match(name) is None
        or len(name) > LONGEST_NAME
        or name == "HEAD"
        or any(".." in part or part.endswith((".", ".lock")) for part in parts)
    ):
        raise RegistryError(f"{name!r} is no name for a branch: wanted letters, digits and . _ + - /")
    return name


def check_remote_name(name: str) -> str:
    """The remote's name itself, if it is a plain word.

    Raises:
        RegistryError: it is not.
    """
    if REMOTE.match(name) is None or ".." in name or name.endswith((".", ".lock")):
        raise RegistryError(f"{name!r} is no name for a remote: wanted a word such as origin")
    return name
