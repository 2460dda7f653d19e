"""Validation of names passed to git: paths, branches, remotes and their addresses.

git itself accepts ``../x`` and ``.git/config`` as paths in a fast-import stream, and lets a file replace a folder. The
names accepted here are also valid on file systems that ignore case and on Windows. Addresses must use a transport that
runs no other program, and a password never appears in a message.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from urllib.parse import urlsplit

from calibrary.errors import RegistryError

__all__ = [
    "LONGEST_NAME",
    "check_branch",
    "check_path",
    "check_remote_name",
    "check_url",
    "is_safe_name",
    "without_secret",
]

LONGEST_NAME = 120
NAME = re.compile(r"[A-Za-z0-9_.][A-Za-z0-9._~+-]*\Z")
DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9]|conin\$|conout\$)(\.|\Z)", re.IGNORECASE)
BRANCH = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._+-]*(/[A-Za-z0-9_][A-Za-z0-9._+-]*)*\Z")
REMOTE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,60}\Z")


def check_path(path: str) -> str:
    """Return the path, if it is a file below the repository's root on every system.

    Raises:
        RegistryError: the path is not allowed.
    """
    if not all(is_safe_name(name) for name in path.split("/")):
        raise RegistryError(
            f"{path!r} is not a path in a repository: expected names of letters, digits, . _ ~ + -"
        )
    return path


def is_safe_name(name: str) -> bool:
    """Return whether a part of a path is valid on every file system and has no special meaning for git."""
    return (
        len(name) <= LONGEST_NAME
        and NAME.match(name) is not None
        and DEVICE.match(name) is None
        and not name.endswith((".", ".lock"))
        and ".." not in name
        and name.casefold() not in {".git", "git~1"}
    )


def check_branch(name: str) -> str:
    """Return the branch name, if git accepts it on every system and it does not look like an option.

    Raises:
        RegistryError: the name is not allowed.
    """
    parts = name.split("/")
    if (
        BRANCH.match(name) is None
        or len(name) > LONGEST_NAME
        or name == "HEAD"
        or any(".." in part or part.endswith((".", ".lock")) for part in parts)
    ):
        raise RegistryError(f"{name!r} is not a branch name: expected letters, digits and . _ + - /")
    return name


def check_remote_name(name: str) -> str:
    """Return the remote's name, if it is a plain word.

    Raises:
        RegistryError: the name is not allowed.
    """
    if REMOTE.match(name) is None or ".." in name or name.endswith((".", ".lock")):
        raise RegistryError(f"{name!r} is not a remote name: expected a word such as origin")
    return name


SCP_LIKE = re.compile(r"(?:(?P<user>[\w.+-]+)@)?(?P<host>[\w.-]+|\[[0-9A-Fa-f:.]+\]):(?P<path>[^:].*)\Z")
DRIVE = re.compile(r"[A-Za-z]:[\\/]")
HOST = re.compile(r"[A-Za-z0-9_]")
LONGEST = 2000


def check_url(url: str) -> str:
    """Return the address, if it is valid; that of a folder as an absolute path.

    Raises:
        RegistryError: the address is not supported.
    """
    if not url or len(url) > LONGEST or any(ord(letter) < 33 for letter in url.replace(" ", "")):
        raise _refused(url, "empty, too long or with control characters")
    if url.startswith("-"):
        raise _refused(url, "it looks like an option")
    if "::" in url.partition("[")[0].partition("/")[0]:
        raise _refused(url, "it names a helper program")
    scheme, separator, _ = url.partition("://")
    if separator:
        return _with_scheme(url, scheme.lower())
    scp = None if DRIVE.match(url) else SCP_LIKE.match(url)
    if scp is not None and "/" not in url.partition(":")[0]:
        if scp["host"].startswith("-") or (scp["user"] or "").startswith("-") or scp["path"].startswith("-"):
            raise _refused(url, "part of it looks like an option")
        return url
    return os.path.abspath(Path(url).expanduser())  # noqa: PTH100  links are the remote's own affair


def _with_scheme(url: str, scheme: str) -> str:
    if scheme not in {"https", "ssh", "file"}:
        raise _refused(url, f"{scheme} is not supported")
    try:
        parts = urlsplit(url)
        host, user = parts.hostname or "", parts.username or ""
        _ = parts.port
    except ValueError:
        raise _refused(url, "it cannot be read") from None
    if scheme == "file":
        if host not in {"", "localhost"}:
            raise _refused(url, "a file address names no host: file:///path")
        return url
    if (
        (HOST.match(host) is None and ":" not in host)
        or user.startswith("-")
        or "%2d" in parts.netloc.lower()
    ):
        raise _refused(url, "it names no host")
    return url


def _refused(url: str, why: str) -> RegistryError:
    return RegistryError(
        f"{without_secret(url)!r} is not an address of a registry ({why}): expected https://, ssh://, user@host:path "
        "or a folder"
    )


def without_secret(text: str) -> str:
    """Return the text without a password in an address."""
    return re.sub(r"(://[^/@\s:]*):[^/@\s]*@", r"\1:…@", text)
