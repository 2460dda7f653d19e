"""The address of a published registry: which ones there are, without what reads them."""

from __future__ import annotations

import ipaddress
import os
from typing import Final
from urllib.parse import urlsplit, urlunsplit

from calibrary.errors import RegistryError

__all__ = ["ALLOW_HTTP", "is_address", "is_loopback", "normalised", "reason_against"]

ALLOW_HTTP: Final = "CALIBRARY_ALLOW_HTTP"
"""The variable that, set to 1, lets http:// addresses of other machines be read."""


def is_address(text: str) -> bool:
    """Whether a registry is named by an address on the web, not by a folder."""
    return text.lower().startswith(("http://", "https://"))


def normalised(address: str) -> str:
    """The address of a published registry's folder, with a slash at its end.

    Raises:
        RegistryError: it is not one, contains a password, or is of a plain connection to another machine.
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
    """Why an address is not read; None where it is."""
    parts = urlsplit(url)
    if parts.scheme == "https":
        return None
    if parts.scheme != "http":
        return f"a {parts.scheme}: address is not read, expected https:"
    if is_loopback(parts.hostname or "") or os.environ.get(ALLOW_HTTP) == "1":
        return None
    return f"http: lets anyone on the way change what is read; expected https: (or set {ALLOW_HTTP}=1)"


def is_loopback(host: str) -> bool:
    """Whether a host is this machine."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
