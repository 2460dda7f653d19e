"""Addresses of published registries; separate from the reader, so that this module loads fast."""

from __future__ import annotations

import ipaddress
import os
from typing import Final
from urllib.parse import urlsplit, urlunsplit

from calibrary.errors import RegistryError

__all__ = ["ALLOW_HTTP", "is_loopback", "normalised", "reason_against"]

ALLOW_HTTP: Final = "CALIBRARY_ALLOW_HTTP"
"""Environment variable that, set to 1, allows http:// addresses of other machines."""


def normalised(address: str) -> str:
    """Return the address of a published registry's folder, with a trailing slash.

    Raises:
        RegistryError: it is not an address, contains a password, or is an http:// address of another machine.
    """
    try:
        parts = urlsplit(address)
        has_host = bool(parts.hostname) and parts.port != 0
    except ValueError:
        has_host = False
    if not has_host or parts.query or parts.fragment:
        raise RegistryError(
            f"{address}: is not the address of a published registry, expected https://HOST/FOLDER/"
        )
    if parts.username is not None or parts.password is not None:
        raise RegistryError(
            f"{parts.hostname}: a password in an address ends in logs and caches; expected one without"
        )
    path = parts.path.removesuffix("calibrary.json").rstrip("/") + "/"
    found = urlunsplit((parts.scheme.lower(), parts.netloc.lower(), path, "", ""))
    if (reason := reason_against(found)) is not None:
        raise RegistryError(f"{address}: {reason}")
    return found


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
