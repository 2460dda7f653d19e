"""Download of one file over HTTP: limited in size and time, not verified, without a change to another scheme.

Connections to a server are kept open, and go through the proxy given by the environment. The reader of published
registries is loaded only for an address, since ``http.client`` takes 20 ms.
"""

from __future__ import annotations

import atexit
import os
import sys
import threading
import time
from base64 import b64encode
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from http.client import BadStatusLine, HTTPConnection, HTTPException, HTTPResponse, HTTPSConnection
from typing import TYPE_CHECKING, Final, Protocol
from urllib.parse import SplitResult, unquote, urljoin, urlsplit

from msgspec import Struct

from calibrary.errors import RegistryError
from calibrary.registry.published.address import is_loopback, reason_against
from calibrary.version import __version__

if TYPE_CHECKING:
    from ssl import SSLContext

__all__ = ["Connections", "Fetch", "FetchError", "Fetched", "fetch"]

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
        connection, answer = self._response(at, parts, dict(headers), proxy, timeout_s)
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

    def _response(
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
        connection = _new_connection(parts, proxy, timeout_s)
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


def _new_connection(parts: SplitResult, proxy: SplitResult | None, timeout_s: float) -> HTTPConnection:
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


TIMEOUT_S: Final = 10.0
"""Seconds, for the connection and for each read."""
LONGEST_S: Final = 60.0
"""Seconds, for a whole file."""
CHUNK: Final = 1 << 16
SUCCESS: Final = range(200, 300)
NOT_MODIFIED: Final = 304
REDIRECTS: Final = frozenset({301, 302, 303, 307, 308})
MOST_REDIRECTS: Final = 5
TEMPORARY: Final = frozenset({408, 425, 429, 500, 502, 503, 504})


class FetchError(RegistryError):
    """A file could not be downloaded.

    Attributes:
        is_temporary: whether a later attempt may succeed, so that the cache may be used instead.
        status: HTTP status; None if there was no response.
    """

    def __init__(self, message: str, *, is_temporary: bool, status: int | None = None) -> None:
        super().__init__(message)
        self.is_temporary = is_temporary
        self.status = status


class Fetched(Struct, frozen=True, kw_only=True):
    """Response of a server.

    Attributes:
        data: content of the file; None if the caller already has it.
        etag: ETag of this content.
    """

    data: bytes | None
    etag: str | None = None


class Fetch(Protocol):
    """Signature of :func:`fetch`."""

    def __call__(self, url: str, *, most: int, etag: str | None = None, fresh: bool = False) -> Fetched:
        """Download a file, as :func:`fetch` does."""
        ...


def fetch(url: str, *, most: int, etag: str | None = None, fresh: bool = False) -> Fetched:
    """Download a file.

    Args:
        url: address of the file.
        most: largest accepted size in bytes.
        etag: ETag of the content that the caller already has.
        fresh: ask intermediate caches to revalidate.

    Raises:
        FetchError: the file could not be downloaded completely.
    """
    headers = {
        "User-Agent": _agent(),
        "Accept": "application/json, */*;q=0.1",
        # Without compression, Content-Length is the size of the data.
        "Accept-Encoding": "identity",
    }
    if etag is not None:
        headers["If-None-Match"] = etag
    if fresh:
        headers["Cache-Control"] = "no-cache"
    at = url
    try:
        for _ in range(MOST_REDIRECTS + 1):
            direct = is_loopback(urlsplit(at).hostname or "")
            with _connections().answer(at, headers, direct=direct, timeout_s=TIMEOUT_S) as answer:
                if answer.status not in REDIRECTS:
                    return _fetched(url, answer, most, etag)
                at = _followed(at, answer)
    except (HTTPException, OSError, ValueError) as error:
        raise FetchError(f"{url}: cannot be reached: {_worded(error)}", is_temporary=True) from None
    raise FetchError(
        f"{url}: redirects ({answer.status}) more than {MOST_REDIRECTS} times", is_temporary=False
    )


def _fetched(url: str, answer: HTTPResponse, most: int, etag: str | None) -> Fetched:
    if answer.status in SUCCESS:
        return Fetched(data=_body(answer, url, most), etag=answer.headers.get("ETag"))
    if answer.status == NOT_MODIFIED and etag is not None:
        return Fetched(data=None, etag=etag)
    raise FetchError(
        f"{url}: the server answers {answer.status} {answer.reason}".rstrip(),
        is_temporary=answer.status in TEMPORARY,
        status=answer.status,
    )


def _followed(url: str, answer: HTTPResponse) -> str:
    """Return the target of a redirect.

    Raises:
        FetchError: it has another scheme, or is an http:// address of another machine.
    """
    target = urljoin(url, answer.headers.get("Location", ""))
    before, after = urlsplit(url).scheme, urlsplit(target).scheme
    reason = f"from {before}: to {after}:" if after != before else reason_against(target)
    if reason is not None:
        raise FetchError(
            f"{url}: redirects to {target:.200}, which is not followed: {reason}", is_temporary=False
        )
    return target


def _body(answer: HTTPResponse, url: str, most: int) -> bytes:
    """Read the whole body.

    Raises:
        FetchError: it is longer than ``most``, takes too long, or is incomplete.
    """
    announced, deadline = answer.headers.get("Content-Length", ""), time.monotonic() + LONGEST_S
    parts, length = [], 0
    while part := answer.read1(CHUNK):
        parts.append(part)
        length += len(part)
        if length > most:
            raise FetchError(f"{url}: is longer than {most >> 10} KiB", is_temporary=False)
        if time.monotonic() > deadline:
            raise FetchError(f"{url}: takes longer than {LONGEST_S:g} s", is_temporary=True)
    if announced.isdecimal() and length != int(announced):
        raise FetchError(f"{url}: ends after {length} of {announced} bytes", is_temporary=True)
    return b"".join(parts)


def _worded(error: Exception) -> str:
    if isinstance(error, TimeoutError):
        return f"no answer within {TIMEOUT_S:g} s"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error) or type(error).__name__


@cache
def _agent() -> str:
    return f"calibrary/{__version__}"


@cache
def _connections() -> Connections:
    found = Connections()
    atexit.register(found.close)
    return found
