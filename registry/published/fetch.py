"""Download of one file over HTTP: limited in size and time, not verified, without a change to another scheme.

urllib3, which python-tuf brings, keeps connections open and goes through the proxy given by the environment.
"""

from __future__ import annotations

import os
import time
from base64 import b64encode
from collections.abc import Callable
from functools import cache, partial
from netrc import NetrcParseError, netrc
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Final, Protocol, TypeAlias
from urllib.parse import unquote, urljoin, urlsplit, urlunsplit
from urllib.request import getproxies, proxy_bypass

from urllib3 import BaseHTTPResponse, PoolManager, ProxyManager, Retry
from urllib3.exceptions import HTTPError
from urllib3.exceptions import TimeoutError as NoAnswerError
from urllib3.util import make_headers

from calibrary.errors import RegistryError
from calibrary.registry.published.address import disk_path, is_loopback, reason_against
from calibrary.version import __version__

TOKEN: Final = "CALIBRARY_TOKEN"  # noqa: S105  its name
"""Environment variable with a bearer token for the server of a published registry: HOST=TOKEN."""
TIMEOUT_S: Final = 10.0
"""Seconds, for the connection and for each read."""
LONGEST_S: Final = 60.0
"""Seconds, for a whole file and all that leads to it."""
CHUNK: Final = 1 << 16
MOST_IDLE: Final = 8
"""Number of connections kept open per server."""
SUCCESS: Final = range(200, 300)
REDIRECTS: Final = frozenset({301, 302, 303, 307, 308})
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
    if url.startswith("file:"):
        return _from_disk(url, most)
    headers = {
        "User-Agent": f"calibrary/{__version__}",
        "Accept": "application/json, */*;q=0.1",
        # Without compression, Content-Length is the size of the data.
        "Accept-Encoding": "identity",
    }
    if fresh:
        headers["Cache-Control"] = "no-cache"
    at, deadline = url, time.monotonic() + LONGEST_S
    try:
        for _ in range(MOST_REDIRECTS + 1):
            pool, secret = (
                _pool(os.getpid(), _proxy(at)),
                _authorization(at, is_first=_origin(at) == _origin(url)),
            )
            get = partial(pool.request, "GET", at, redirect=False, preload_content=False, timeout=TIMEOUT_S)
            answer = _head(partial(get, headers=headers | secret), url, deadline)
            try:
                if answer.status in SUCCESS:
                    return _body(answer, url, most, deadline)
                if answer.status not in REDIRECTS:
                    raise _refused(url, answer)
                at = _followed(at, answer)
            finally:
                answer.close()
    except (HTTPError, OSError, ValueError) as error:
        raise FetchError(f"{url}: cannot be reached: {_worded(error)}", is_temporary=True) from None
    raise FetchError(
        f"{url}: redirects ({answer.status}) more than {MOST_REDIRECTS} times", is_temporary=False
    )


@cache
def _pool(process: int, proxy: str | None) -> PoolManager:  # noqa: ARG001  a fork has connections of its own
    """Return the open connections, through a proxy if there is one."""
    # A connection that the server closed while it was idle is opened again.
    retries = Retry(1, connect=0, read=1, status=0, redirect=0, other=0)
    if proxy is None:
        return PoolManager(maxsize=MOST_IDLE, retries=retries)
    parts = urlsplit(proxy)
    name = unquote(f"{parts.username}:{parts.password or ''}") if parts.username is not None else None
    plain = urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2]))
    secret = make_headers(proxy_basic_auth=name)
    return ProxyManager(plain, proxy_headers=secret, maxsize=MOST_IDLE, retries=retries)


def _proxy(url: str) -> str | None:
    """Return the proxy for an address from the environment or system settings; None if there is none."""
    parts = urlsplit(url)
    host = parts.hostname or ""
    named = None if is_loopback(host) else getproxies().get(parts.scheme)
    if not named or proxy_bypass(host):
        return None
    return named if "//" in named else f"http://{named}"


def _refused(url: str, answer: BaseHTTPResponse) -> FetchError:
    reason = "".join(filter(str.isprintable, answer.reason or ""))
    needs = (
        f" (a name and password in netrc, or HOST=TOKEN in ${TOKEN}, are sent)"
        if answer.status in DENIED
        else ""
    )
    return FetchError(
        f"{url}: the server answers {answer.status} {reason}".rstrip() + needs,
        is_temporary=answer.status in TEMPORARY,
        status=answer.status,
    )


def _from_disk(url: str, most: int) -> bytes:
    try:
        with disk_path(url).open("rb") as opened:
            data = opened.read(most + 1)
    except OSError as error:
        is_absent = isinstance(error, FileNotFoundError | NotADirectoryError)
        raise FetchError(
            f"{url}: cannot be read: {error.strerror or error}",
            is_temporary=False,
            status=404 if is_absent else None,
        ) from None
    if len(data) > most:
        raise FetchError(f"{url}: is longer than {most >> 10} KiB", is_temporary=False)
    return data


def _origin(url: str) -> tuple[str, str]:
    parts = urlsplit(url)
    return parts.scheme, parts.netloc


def _authorization(url: str, *, is_first: bool) -> dict[str, str]:
    """Return the header with the user's secret for a server: from netrc, or a token for the first one alone."""
    host = urlsplit(url).hostname or ""
    name, _, token = os.environ.get(TOKEN, "").partition("=")
    if (
        token
        and is_first
        and name.lower() == host
        and url.startswith(("https:", "http://127.", "http://localhost"))
    ):
        return {"Authorization": f"Bearer {token}"}
    try:
        found = _netrc().authenticators(host)
    except (OSError, NetrcParseError):
        return {}
    if found is None or found == _netrc().hosts.get("default"):
        return {}
    return {"Authorization": f"Basic {b64encode(f'{found[0]}:{found[2]}'.encode()).decode()}"}


@cache
def _netrc() -> netrc:
    return netrc(os.environ.get("NETRC"))


def _followed(url: str, answer: BaseHTTPResponse) -> str:
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


_Head: TypeAlias = "BaseHTTPResponse | Exception"
_Asked: TypeAlias = "SimpleQueue[tuple[Callable[[], BaseHTTPResponse], SimpleQueue[_Head]] | None]"


@cache
def _idle(process: int) -> list[_Asked]:  # noqa: ARG001  a fork has threads of its own
    """Return threads that wait for work; to start one for each file would take as long as a file itself."""
    return []


def _head(ask: Callable[[], BaseHTTPResponse], url: str, deadline: float) -> BaseHTTPResponse:
    """Wait for the head of an answer, which a server may send byte by byte, each in time.

    Raises:
        FetchError: it takes too long.
    """
    idle, answer = _idle(os.getpid()), SimpleQueue[_Head]()
    try:
        asked = idle.pop()
    except IndexError:
        asked = SimpleQueue()
        Thread(target=_answer, args=(asked,), daemon=True).start()
    asked.put((ask, answer))
    try:
        found = answer.get(timeout=max(0.0, deadline - time.monotonic()))
    except Empty:
        asked.put(None)
        raise FetchError(f"{url}: takes longer than {LONGEST_S:g} s", is_temporary=True) from None
    idle.append(asked)
    if isinstance(found, Exception):
        raise found
    return found


def _answer(asked: _Asked) -> None:
    while (one := asked.get()) is not None:
        try:
            one[1].put(one[0]())
        except Exception as error:  # noqa: BLE001  it is raised where the answer is waited for
            one[1].put(error)


def _body(answer: BaseHTTPResponse, url: str, most: int, deadline: float) -> bytes:
    """Read the whole body.

    Raises:
        FetchError: it is longer than ``most``, takes too long, or is incomplete.
    """
    parts, length = list[bytes](), 0
    while part := answer.read1(CHUNK):
        parts.append(part)
        length += len(part)
        if length > most:
            raise FetchError(f"{url}: is longer than {most >> 10} KiB", is_temporary=False)
        if time.monotonic() > deadline:
            raise FetchError(f"{url}: takes longer than {LONGEST_S:g} s", is_temporary=True)
    return b"".join(parts)


def _worded(error: BaseException) -> str:
    """Return the reason below the wrappers of urllib3: what the system says of the connection, if anything."""
    chain = [getattr(error, "reason", None) or error]
    while (below := getattr(chain[-1], "original_error", None) or chain[-1].__cause__) is not None:
        chain.append(below)
    said = next((one.strerror for one in chain if isinstance(one, OSError) and one.strerror), None)
    if said is None and isinstance(chain[0], NoAnswerError):
        return f"no answer within {TIMEOUT_S:g} s"
    return said or str(chain[-1]) or type(chain[-1]).__name__
