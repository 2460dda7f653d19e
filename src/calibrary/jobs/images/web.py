"""Images behind http:// and https://, read with range requests over persistent connections."""

from __future__ import annotations

import http.client
import re
import ssl
import threading
import weakref
from base64 import b64encode
from collections.abc import Iterator, Sequence
from functools import cache
from http import HTTPStatus
from typing import Final
from urllib.parse import unquote, urljoin, urlsplit
from urllib.request import getproxies, proxy_bypass

from calibrary.jobs.images.ranged import First, StoreError

TIMEOUT_S: Final = 30.0
KEPT: Final = 64
"""Most connections that stay open for further requests."""
MOST_WHOLE: Final = 8 * 1024 * 1024
"""Largest file in bytes that is fetched as a whole from a server without range requests."""
REDIRECTS: Final = 5
_RANGE = re.compile(r"bytes (\d+)-(\d+)/(\d+)")
_MEANINGS = {
    401: "the server wants other credentials",
    403: "access is denied",
    404: "is not there",
    410: "is not there any more",
    412: "was changed while it was read",
    416: "is empty, or was cut while it was read",
    429: "the server wants fewer requests",
}


class WebServer:
    """One scheme, host and port; a key is the rest of the URL, including the query."""

    def __init__(self, scheme: str, netloc: str) -> None:
        self._scheme = scheme
        credentials, _, self._host = netloc.rpartition("@")
        self._headers = {"User-Agent": "calibrary", "Accept-Encoding": "identity"}
        if credentials:
            self._headers["Authorization"] = f"Basic {b64encode(unquote(credentials).encode()).decode()}"
        self._idle: list[http.client.HTTPConnection] = []
        # With the server, or at the end of the program: an open socket that is collected then is warned of.
        weakref.finalize(self, _close, self._idle)
        self._lock = threading.Lock()

    def first(self, key: str, size: int) -> First:
        """The first ``size`` bytes of a file, with its total size and version."""
        status, headers, data = self._get(key, {"Range": f"bytes=0-{size - 1}"})
        if status == HTTPStatus.OK:
            # The response contains the whole file, which is used if it is small enough.
            return First(data, len(data), headers.get("ETag"))
        found = _RANGE.fullmatch(headers.get("Content-Range", ""))
        if found is None or int(found[1]) != 0:
            raise StoreError("the server sent another range than it was asked for")
        total = int(found[3])
        if len(data) != min(size, total):
            raise StoreError(f"the server sent {len(data)} of {min(size, total)} bytes", passing=True)
        return First(data, total, headers.get("ETag"))

    def part(self, key: str, start: int, end: int, version: str | None) -> bytes:
        """The bytes from ``start`` up to, not including, ``end``; fails if the version differs."""
        strong = version is not None and not version.startswith("W/")
        wanted = {"Range": f"bytes={start}-{end - 1}"} | ({"If-Match": version or ""} if strong else {})
        status, headers, data = self._get(key, wanted)
        if version is not None and headers.get("ETag", version) != version:
            raise StoreError(_MEANINGS[412])
        return data[start:end] if status == HTTPStatus.OK else data

    def listed(self, prefix: str) -> Iterator[str]:
        """The URL itself: web servers provide no listing, so a URL is one file."""
        yield prefix

    def _get(
        self, key: str, headers: dict[str, str], redirects: int = REDIRECTS
    ) -> tuple[int, http.client.HTTPMessage, bytes]:
        """Status, headers and body of the response, after redirects."""
        connection = self._connection()
        try:
            connection.request("GET", self._target(key), headers=self._headers | headers)
            answer = connection.getresponse()
            if answer.status == HTTPStatus.OK and (answer.length or MOST_WHOLE + 1) > MOST_WHOLE:
                raise StoreError("the server sends no ranges, and the file is too long to take it whole")
            data = answer.read()
        except (OSError, http.client.HTTPException) as error:
            connection.close()
            raise StoreError(f"the server cannot be read: {_reason(error)}", passing=True) from None
        except StoreError:
            connection.close()
            raise
        if answer.will_close:
            connection.close()
        else:
            self._keep(connection)
        location = answer.headers.get("Location")
        if answer.status in {301, 302, 303, 307, 308} and location and redirects:
            target = urlsplit(urljoin(f"{self._scheme}://{self._host}/{key}", location))
            if target.scheme not in {"http", "https"}:
                raise StoreError("the server sends elsewhere than to a web server")
            server = web_server(target.scheme, target.netloc.rpartition("@")[2])
            below = target.path.lstrip("/") + (f"?{target.query}" if target.query else "")
            return server._get(below, headers, redirects - 1)
        if answer.status not in {HTTPStatus.OK, HTTPStatus.PARTIAL_CONTENT}:
            message = _MEANINGS.get(
                answer.status, "the server cannot answer" if answer.status >= 500 else "is refused"
            )
            passing = answer.status >= 500 or answer.status in {408, 429}
            raise StoreError(f"{message} (HTTP {answer.status})", passing=passing)
        return answer.status, answer.headers, data

    def _connection(self) -> http.client.HTTPConnection:
        with self._lock:
            if self._idle:
                return self._idle.pop()
        proxy = urlsplit(self._proxy()).netloc.rpartition("@")[2]
        host = proxy or self._host
        if self._scheme == "http":
            return http.client.HTTPConnection(host, timeout=TIMEOUT_S)
        connection = http.client.HTTPSConnection(host, timeout=TIMEOUT_S, context=_tls())
        if proxy:
            connection.set_tunnel(self._host)
        return connection

    def _proxy(self) -> str:
        """The proxy that the environment states for this host, "" if none."""
        host = self._host.rpartition(":")[0] or self._host
        return "" if proxy_bypass(host) else getproxies().get(self._scheme, "")

    def _target(self, key: str) -> str:
        if self._scheme == "http" and self._proxy():
            return f"http://{self._host}/{key}"
        return f"/{key}"

    def _keep(self, connection: http.client.HTTPConnection) -> None:
        with self._lock:
            if len(self._idle) < KEPT:
                self._idle.append(connection)
                return
        connection.close()


def _close(connections: Sequence[http.client.HTTPConnection]) -> None:
    for one in connections:
        one.close()


@cache
def web_server(scheme: str, netloc: str) -> WebServer:
    """The server of a URL, with its open connections."""
    return WebServer(scheme, netloc)


@cache
def _tls() -> ssl.SSLContext:
    return ssl.create_default_context()


def _reason(error: Exception) -> str:
    """Reason of an error, without the URL, which may contain a key."""
    if isinstance(error, TimeoutError):
        return "it does not answer"
    if isinstance(error, http.client.IncompleteRead):
        return "it broke off"
    return (error.strerror if isinstance(error, OSError) else None) or type(error).__name__
