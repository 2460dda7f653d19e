"""Download of one file over HTTP: limited in size and time, not verified, without a change to another scheme."""

from __future__ import annotations

import atexit
import time
from functools import cache
from typing import TYPE_CHECKING, Final, Protocol
from urllib.parse import urljoin, urlsplit

from msgspec import Struct

from calibrary.errors import RegistryError
from calibrary.registry.published.address import is_loopback, reason_against
from calibrary.version import __version__

if TYPE_CHECKING:
    from http.client import HTTPResponse

    from calibrary.registry.published.connections import Connections

__all__ = ["Fetch", "FetchError", "Fetched", "fetch"]

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
    # Loading takes 20 ms, and most registries are folders.
    from http.client import HTTPException  # noqa: PLC0415  the reason above

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
    from calibrary.registry.published.connections import Connections  # noqa: PLC0415  loads http.client

    found = Connections()
    atexit.register(found.close)
    return found
