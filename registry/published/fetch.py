"""Download of one file over HTTP: limited in size and time, not verified, without a change to another scheme."""

from __future__ import annotations

import os
from base64 import b64encode
from functools import cache
from http.client import HTTPException, HTTPMessage
from netrc import NetrcParseError, netrc
from queue import Empty, SimpleQueue
from threading import Thread
from typing import IO, Final, Protocol
from urllib.error import HTTPError, URLError
from urllib.parse import urlsplit
from urllib.request import HTTPRedirectHandler, ProxyHandler, Request, build_opener

from calibrary.errors import RegistryError
from calibrary.registry.published.address import disk_path, is_loopback, reason_against
from calibrary.version import __version__

TOKEN: Final = "CALIBRARY_TOKEN"  # noqa: S105  its name
"""Environment variable with a bearer token for the server of a published registry: HOST=TOKEN."""
TIMEOUT_S: Final = 10.0
"""Seconds, for the connection and for each read."""
LONGEST_S: Final = 60.0
"""Seconds, for a whole file and all that leads to it."""
MOST_REDIRECTS: Final = 5
DENIED: Final = frozenset({401, 403})
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


class Fetch(Protocol):
    """Signature of :func:`fetch`."""

    def __call__(self, url: str, *, most: int, fresh: bool = False) -> bytes:
        """Download a file, as :func:`fetch` does."""
        ...


def fetch(url: str, *, most: int, fresh: bool = False) -> bytes:
    """Download a file, or read it from a ``file:`` address.

    Args:
        url: address of the file.
        most: largest accepted size in bytes.
        fresh: ask intermediate caches to revalidate.

    Raises:
        FetchError: the file could not be downloaded completely.
    """
    found = _from_disk(url, most) if url.startswith("file:") else _in_time(url, most, fresh=fresh)
    if len(found) > most:
        raise FetchError(f"{url}: is longer than {most >> 10} KiB", is_temporary=False)
    return found


def _from_disk(url: str, most: int) -> bytes:
    try:
        with disk_path(url).open("rb") as opened:
            return opened.read(most + 1)
    except OSError as error:
        status = 404 if isinstance(error, FileNotFoundError | NotADirectoryError) else None
        said = f"{url}: cannot be read: {error.strerror or error}"
        raise FetchError(said, is_temporary=False, status=status) from None


def _in_time(url: str, most: int, *, fresh: bool) -> bytes:
    """Download a file in a thread, as a server may send it byte by byte, each in time."""
    answer = SimpleQueue[bytes | Exception]()

    def work() -> None:
        try:
            answer.put(_downloaded(url, most, fresh=fresh))
        except Exception as error:  # noqa: BLE001  it is raised where the answer is waited for
            answer.put(error)

    Thread(target=work, daemon=True).start()
    try:
        found = answer.get(timeout=LONGEST_S)
    except Empty:
        raise FetchError(f"{url}: takes longer than {LONGEST_S:g} s", is_temporary=True) from None
    if isinstance(found, Exception):
        raise found
    return found


def _downloaded(url: str, most: int, *, fresh: bool) -> bytes:
    headers = {
        "User-Agent": f"calibrary/{__version__}",
        "Accept": "application/json, */*;q=0.1",
        "Accept-Encoding": "identity",
    } | ({"Cache-Control": "no-cache"} if fresh else {})
    request = _authorized(Request(url, headers=headers), url)  # noqa: S310  its scheme was checked
    proxies = [ProxyHandler({})] if is_loopback(request.host.rpartition(":")[0] or request.host) else []
    try:
        with build_opener(_Redirects, *proxies).open(request, timeout=TIMEOUT_S) as answer:
            data: bytes = answer.read(most + 1)
            return data
    except HTTPError as error:
        error.close()
        reason = "".join(filter(str.isprintable, error.reason or ""))
        needs = " (a name and password in netrc, or HOST=TOKEN in $CALIBRARY_TOKEN, are sent)"
        said = f"{url}: the server answers {error.code} {reason}".rstrip()
        raise FetchError(
            said + (needs if error.code in DENIED else ""),
            is_temporary=error.code in TEMPORARY,
            status=error.code,
        ) from None
    except (HTTPException, OSError, ValueError) as error:
        raise FetchError(f"{url}: cannot be reached: {_worded(error)}", is_temporary=True) from None


class _Redirects(HTTPRedirectHandler):
    """Follows a redirect that stays with its scheme."""

    max_redirections = max_repeats = MOST_REDIRECTS

    def redirect_request(
        self, req: Request, fp: IO[bytes], code: int, msg: str, headers: HTTPMessage, newurl: str
    ) -> Request | None:
        """Return the next request.

        Raises:
            FetchError: it has another scheme, or is an http:// address of another machine.
        """
        fp.close()  # else all of its body would be read
        before, after = req.type, urlsplit(newurl).scheme
        reason = f"from {before}: to {after}:" if after != before else reason_against(newurl)
        if reason is not None:
            raise FetchError(
                f"{req.full_url}: redirects to {newurl:.200}, which is not followed: {reason}",
                is_temporary=False,
            )
        found = super().redirect_request(req, fp, code, msg, headers, newurl)
        return _authorized(found, req.origin_req_host) if found is not None else None


def _authorized(request: Request, first: str) -> Request:
    """Add the user's secret for a server: from netrc, or a token for the first one alone; it follows no redirect."""
    host = urlsplit(request.full_url).hostname or ""
    is_first = host == (urlsplit(first).hostname or first)
    name, _, token = os.environ.get(TOKEN, "").partition("=")
    if token and is_first and name.lower() == host and (request.type == "https" or is_loopback(host)):
        request.add_unredirected_header("Authorization", f"Bearer {token}")
        return request
    try:
        found = _netrc().authenticators(host)
    except (OSError, NetrcParseError):
        return request
    if found is not None and found != _netrc().hosts.get("default"):
        pair = b64encode(f"{found[0]}:{found[2]}".encode()).decode()
        request.add_unredirected_header("Authorization", f"Basic {pair}")
    return request


@cache
def _netrc() -> netrc:
    return netrc(os.environ.get("NETRC"))


def _worded(error: BaseException) -> str:
    """Return what the system says of a connection."""
    reason = error.reason if isinstance(error, URLError) else error
    if isinstance(reason, TimeoutError):
        return f"no answer within {TIMEOUT_S:g} s"
    return getattr(reason, "strerror", None) or str(reason) or type(reason).__name__
