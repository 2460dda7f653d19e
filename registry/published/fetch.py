"""One file over HTTP: bounded in size and time, not yet verified, and never from another scheme."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache
from http.client import HTTPException, HTTPResponse
from importlib.metadata import version
from typing import IO, TYPE_CHECKING, Any, Final
from urllib.error import HTTPError, URLError
from urllib.parse import urlsplit

from calibrary.errors import RegistryError
from calibrary.registry.published.address import is_loopback, reason_against

if TYPE_CHECKING:
    from http.client import HTTPMessage
    from urllib.request import OpenerDirector, Request

__all__ = ["FetchError", "Fetched", "fetch"]

TIMEOUT_S: Final = 10.0
"""For the connection, and for each time that nothing arrives."""
LONGEST_S: Final = 60.0
"""For a whole file."""
CHUNK: Final = 1 << 16
TEMPORARY: Final = frozenset({408, 425, 429, 500, 502, 503, 504})


class FetchError(RegistryError):
    """A file did not arrive.

    Attributes:
        is_temporary: whether the server may be reached another time, so that a cache may stand in for it.
        status: that the server answered; None where it did not.
    """

    def __init__(self, message: str, *, is_temporary: bool, status: int | None = None) -> None:
        super().__init__(message)
        self.is_temporary = is_temporary
        self.status = status


@dataclass(frozen=True, slots=True, kw_only=True)
class Fetched:
    """What a server answered.

    Attributes:
        data: the file; None where it is the one that the caller has.
        etag: by which the server knows this content.
    """

    data: bytes | None
    etag: str | None = None


def fetch(url: str, *, most: int, etag: str | None = None, fresh: bool = False) -> Fetched:
    """A file.

    Args:
        url: its address.
        most: bytes that it may have.
        etag: of the content that the caller has.
        fresh: ask caches on the way to look for themselves.

    Raises:
        FetchError: it did not arrive, or not whole.
    """
    from urllib.request import Request  # noqa: PLC0415  takes 20 ms to load, and most registries are folders

    headers = {
        "User-Agent": f"calibrary/{version('calibrary')}",
        "Accept": "application/json, */*;q=0.1",
        # A length that is announced is then the length of what is read.
        "Accept-Encoding": "identity",
    }
    if etag is not None:
        headers["If-None-Match"] = etag
    if fresh:
        headers["Cache-Control"] = "no-cache"
    request = Request(url, headers=headers)  # noqa: S310  the opener knows no other scheme
    try:
        opener = _opener(is_direct=is_loopback(urlsplit(url).hostname or ""))
        with opener.open(request, timeout=TIMEOUT_S) as answer:
            return Fetched(data=_body(answer, url, most), etag=answer.headers.get("ETag"))
    except HTTPError as error:
        with error:
            if error.code == 304:
                return Fetched(data=None, etag=etag)
            raise FetchError(
                f"{url}: the server answers {error.code} {error.reason}".rstrip(),
                is_temporary=error.code in TEMPORARY,
                status=error.code,
            ) from None
    except (URLError, HTTPException, OSError, ValueError) as error:
        raise FetchError(f"{url}: cannot be reached: {_worded(error)}", is_temporary=True) from None


def _body(answer: HTTPResponse, url: str, most: int) -> bytes:
    """The whole body.

    Raises:
        FetchError: it is longer than ``most``, takes too long, or ends before its announced end.
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
    reason = error.reason if isinstance(error, URLError) else error
    if isinstance(reason, TimeoutError):
        return f"no answer within {TIMEOUT_S:g} s"
    if isinstance(reason, OSError) and reason.strerror:
        return reason.strerror
    return str(reason) or type(reason).__name__


@cache
def _opener(*, is_direct: bool) -> OpenerDirector:
    """What opens http and https alone, through the proxy that the environment names; files and FTP it does not know."""
    from urllib import request as urllib  # noqa: PLC0415  as in fetch

    class SameScheme(urllib.HTTPRedirectHandler):
        """Follows few redirects, none of them to another scheme or to a plain connection elsewhere."""

        max_redirections = 5

        def redirect_request(
            self, req: Request, fp: IO[bytes], code: int, msg: str, headers: HTTPMessage, newurl: str
        ) -> Any:
            before, after = urlsplit(req.full_url).scheme, urlsplit(newurl).scheme
            reason = f"from {before}: to {after}:" if after != before else reason_against(newurl)
            if reason is not None:
                raise FetchError(
                    f"{req.full_url}: redirects to {newurl:.200}, which is not followed: {reason}",
                    is_temporary=False,
                )
            return super().redirect_request(req, fp, code, msg, headers, newurl)

    opener = urllib.OpenerDirector()
    for handler in (
        urllib.ProxyHandler({} if is_direct else None),
        urllib.HTTPHandler(),
        urllib.HTTPSHandler(),
        SameScheme(),
        urllib.HTTPErrorProcessor(),
        urllib.HTTPDefaultErrorHandler(),
    ):
        opener.add_handler(handler)
    return opener
