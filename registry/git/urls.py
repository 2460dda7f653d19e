"""Where a registry may be fetched from and pushed to.

git takes much more for an address than addresses: ``ext::sh -c …`` runs a command, ``--upload-pack=…`` is an option,
``ssh://-oProxyCommand=…`` was one. Only https, ssh and files are spoken, and nothing that begins like an option.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from urllib.parse import urlsplit

from calibrary.errors import RegistryError

__all__ = ["check_url", "without_secret"]

SCP_LIKE = re.compile(r"(?:(?P<user>[\w.+-]+)@)?(?P<host>[\w.-]+|\[[0-9A-Fa-f:.]+\]):(?P<path>[^:].*)\Z")
DRIVE = re.compile(r"[A-Za-z]:[\\/]")
HOST = re.compile(r"[A-Za-z0-9_]")
LONGEST = 2000


def check_url(url: str) -> str:
    """The address itself, if it is one; a folder's as an absolute path.

    Raises:
        RegistryError: it is none that is spoken to.
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
            raise _refused(url, "a part of it looks like an option")
        return url
    return os.path.abspath(Path(url).expanduser())  # noqa: PTH100  links are the remote's own affair


def _with_scheme(url: str, scheme: str) -> str:
    if scheme not in {"https", "ssh", "file"}:
        raise _refused(url, f"{scheme} is not spoken")
    try:
        parts = urlsplit(url)
        host, user = parts.hostname or "", parts.username or ""
        _ = parts.port
    except ValueError:
        raise _refused(url, "it cannot be read") from None
    if scheme == "file":
        if host not in {"", "localhost"}:
            raise _refused(url, "a file address names no machine: file:///path")
        return url
    if (
        (HOST.match(host) is None and ":" not in host)
        or user.startswith("-")
        or "%2d" in parts.netloc.lower()
    ):
        raise _refused(url, "it names no machine")
    return url


def _refused(url: str, why: str) -> RegistryError:
    return RegistryError(
        f"{without_secret(url)!r} is no address of a registry ({why}): wanted https://, ssh://, user@host:path or "
        "a folder"
    )


def without_secret(text: str) -> str:
    """The same without the password that an address may hold."""
    return re.sub(r"(://[^/@\s:]*):[^/@\s]*@", r"\1:…@", text)
