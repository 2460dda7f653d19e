"""Which paths a registry may write, and no others.

git itself takes ``../x`` and ``.git/config`` as paths in a fast-import stream, and lets a file take a folder's
name. What may stand in a registry is therefore said here, once, and holds on disks that ignore case and on
Windows too.
"""

from __future__ import annotations

import re

from calibrary.errors import RegistryError

__all__ = ["CAMERAS", "LARGEST_FILE", "check_branch", "check_path", "check_remote_name"]

CAMERAS = "cameras"
LARGEST_FILE = 1 << 20
"""Bytes of one file; an entry with a full covariance takes some four thousand."""

LONGEST_NAME = 120
DEEPEST = 8
SINGLE_FILES = frozenset({".gitattributes", "README.md", "registry.yaml"})
WORKFLOW = re.compile(r"\.github/workflows/[a-z0-9][a-z0-9._-]*\.yml\Z")
SCHEMA = re.compile(r"schema/[a-z0-9][a-z0-9._-]*\.json\Z")
NAME = re.compile(r"[a-z0-9_][a-z0-9._~+-]*\Z")
DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9]|conin\$|conout\$)(\.|\Z)")
BRANCH = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._+-]*(/[A-Za-z0-9_][A-Za-z0-9._+-]*)*\Z")
REMOTE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,60}\Z")


def check_path(path: str) -> str:
    """The path itself, if a registry may hold a file there.

    Raises:
        RegistryError: it is no ``cameras/**.yaml`` and none of the few files beside it.
    """
    if path in SINGLE_FILES or WORKFLOW.match(path) or SCHEMA.match(path):
        return path
    root, *names = path.split("/")
    if (
        root != CAMERAS
        or not 1 <= len(names) <= DEEPEST
        or not names[-1].endswith(".yaml")
        or any(name.endswith(".yaml") for name in names[:-1])
        or not all(_is_safe(name) for name in names)
    ):
        raise RegistryError(
            f"{path!r} is no place in a registry: wanted cameras/<make>/<model>/<variant>.yaml in lower-case "
            f"letters, digits and . _ ~ + -, or one of {', '.join(sorted(SINGLE_FILES))}, schema/*.json, "
            ".github/workflows/*.yml"
        )
    return path


def _is_safe(name: str) -> bool:
    return (
        len(name) <= LONGEST_NAME
        and NAME.match(name) is not None
        and DEVICE.match(name) is None
        and not name.endswith((".", ".lock"))
        and ".." not in name
        and name != "git~1"
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
