"""Addresses of published registries; separate from the reader, so that this module loads fast."""

from __future__ import annotations

import ipaddress
import os
import re
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit, urlunsplit

from calibrary.errors import RegistryError
from calibrary.registry.places import FOLDER

ALLOW_HTTP: Final = "CALIBRARY_ALLOW_HTTP"
"""Environment variable that, set to 1, allows http:// addresses of other machines."""


def normalised(address: str) -> str:
    """Return the address of a published registry's folder, with a trailing slash; ``file:`` for a folder on a disk.

    Raises:
        RegistryError: it is not an address, contains a password, or is an http:// address of another machine.
    """
    if "://" not in address:
        return f"{Path(address.removeprefix(FOLDER)).absolute().as_uri()}/"
    if address.lower().startswith("file:"):
        return f"{disk_path(address).absolute().as_uri()}/"
    try:
        parts = urlsplit(address)
        has_host = bool(parts.hostname) and parts.port != 0
    except ValueError:
        has_host = False
    if not has_host or parts.query or parts.fragment:
        # What follows a question mark, or stands before an at sign, may be a secret.
        shown = re.sub(r"//[^/]*@", "//…@", address.partition("?")[0].partition("#")[0])
        raise RegistryError(
            f"{shown}: is not the address of a published registry, expected https://HOST/FOLDER/ without a query"
        )
    if parts.username is not None or parts.password is not None:
        raise RegistryError(
            f"{parts.hostname}: a password in an address ends in logs and caches; expected one without"
        )
    path = parts.path.rstrip("/") + "/"
    found = urlunsplit((parts.scheme.lower(), parts.netloc.lower(), path, "", ""))
    if (reason := reason_against(found)) is not None:
        raise RegistryError(f"{address}: {reason}")
    return found


def disk_path(url: str) -> Path:
    """Return the path of a ``file:`` address."""
    path = unquote(urlsplit(url).path)
    return Path(path[1:] if os.name == "nt" else path)


def reason_against(url: str) -> str | None:
    """Return why an address is not allowed; None if it is."""
    parts = urlsplit(url)
    if parts.scheme == "https":
        return None
    if parts.scheme != "http":
        return f"a {parts.scheme}: address is not read, expected https:"
    if is_loopback(parts.hostname or "") or os.environ.get(ALLOW_HTTP) == "1":
        return None
    return f"http: lets anyone on the way change what is read; expected https: (or set {ALLOW_HTTP}=1)"


def is_loopback(host: str) -> bool:
    """Return whether a host is this machine."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
