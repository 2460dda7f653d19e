"""Persistent connections to web servers, through the proxy given by the environment."""

from __future__ import annotations

import os
import sys
import threading
from base64 import b64encode
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from http.client import BadStatusLine, HTTPConnection, HTTPResponse, HTTPSConnection
from typing import TYPE_CHECKING, Final
from urllib.parse import SplitResult, unquote, urlsplit

if TYPE_CHECKING:
    from ssl import SSLContext

__all__ = ["Connections"]

MOST_IDLE: Final = 8
"""Number of idle connections kept open per server."""
CLOSED_MEANWHILE: Final = (BadStatusLine, OSError)
"""Errors that can occur if the server has closed an idle connection."""
_Server = tuple[int, str, str]


class Connections:
    """Open connections by server; each is used by one thread at a time, only in the process that opened it."""

    def __init__(self) -> None:
        """Start without connections."""
        self._idle: dict[_Server, list[HTTPConnection]] = defaultdict(list)
        self._lock = threading.Lock()

    @contextmanager
    def answer(
        self, url: str, headers: Mapping[str, str], *, direct: bool, timeout_s: float
    ) -> Iterator[HTTPResponse]:
        """Send a GET request and provide the response, with the body not yet read. Redirects are not followed.

        Args:
            url: address of the file.
            headers: headers of the request.
            direct: bypass the proxy.
            timeout_s: timeout in s for the connection and for each read.

        Raises:
            HTTPException: the response is not HTTP.
            OSError: there is no response.
        """
        parts = urlsplit(url)
        at = (os.getpid(), parts.scheme, parts.netloc)
        proxy = None if direct else _proxy(parts)
        connection, answer = self._asked(at, parts, dict(headers), proxy, timeout_s)
        is_read = False
        try:
            yield answer
            # A response with a known length does not close itself after it has been read.
            is_read = answer.isclosed() or answer.length == 0
        finally:
            answer.close()
            if is_read and not answer.will_close:
                self._keep(at, connection)
            else:
                connection.close()

    def _asked(
        self,
        at: _Server,
        parts: SplitResult,
        headers: dict[str, str],
        proxy: SplitResult | None,
        timeout_s: float,
    ) -> tuple[HTTPConnection, HTTPResponse]:
        target = f"{parts.path or '/'}?{parts.query}" if parts.query else parts.path or "/"
        if proxy is not None and parts.scheme == "http":
            target = f"http://{parts.netloc}{target}"
            headers |= _credentials(proxy)
        while (connection := self._taken(at)) is not None:
            try:
                return connection, _sent(connection, target, headers)
            except CLOSED_MEANWHILE:
                connection.close()
        connection = _made(parts, proxy, timeout_s)
        try:
            return connection, _sent(connection, target, headers)
        except BaseException:
            connection.close()
            raise

    def _taken(self, at: _Server) -> HTTPConnection | None:
        with self._lock:
            idle = self._idle[at]
            return idle.pop() if idle else None

    def _keep(self, at: _Server, connection: HTTPConnection) -> None:
        with self._lock:
            if len(self._idle[at]) < MOST_IDLE:
                self._idle[at].append(connection)
                return
        connection.close()

    def close(self) -> None:
        """Close all connections."""
        with self._lock:
            for connection in (one for idle in self._idle.values() for one in idle):
                connection.close()
            self._idle.clear()


def _sent(connection: HTTPConnection, target: str, headers: Mapping[str, str]) -> HTTPResponse:
    connection.request("GET", target, headers=headers)
    return connection.getresponse()


def _made(parts: SplitResult, proxy: SplitResult | None, timeout_s: float) -> HTTPConnection:
    """Open a new connection, through the proxy if there is one."""
    host, port = (proxy or parts).hostname or "", (proxy or parts).port
    if parts.scheme == "http":
        return HTTPConnection(host, port, timeout=timeout_s)
    connection = HTTPSConnection(host, port, timeout=timeout_s, context=_tls())
    if proxy is not None:
        connection.set_tunnel(parts.hostname or "", parts.port or 443, headers=_credentials(proxy))
    return connection


@cache
def _tls() -> SSLContext:
    """Return the TLS context, created once: reading the system's certificates takes longer than a connection."""
    import ssl  # noqa: PLC0415  most registries are folders

    return ssl.create_default_context()


def _proxy(parts: SplitResult) -> SplitResult | None:
    """Return the proxy for a server from the environment or system settings; None if there is none."""
    if sys.platform not in {"darwin", "win32"} and not any(
        name.lower().endswith("_proxy") for name in os.environ
    ):
        return None
    from urllib import request  # noqa: PLC0415  takes 20 ms to load

    named = request.getproxies().get(parts.scheme)
    if not named or request.proxy_bypass(parts.hostname or ""):
        return None
    return urlsplit(named if "//" in named else f"//{named}")


def _credentials(proxy: SplitResult) -> dict[str, str]:
    if proxy.username is None:
        return {}
    pair = f"{unquote(proxy.username)}:{unquote(proxy.password or '')}"
    return {"Proxy-Authorization": f"Basic {b64encode(pair.encode()).decode()}"}
