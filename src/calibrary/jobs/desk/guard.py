"""The desk's server, and its guard: for one person, on this machine, and for no page but its own.

Any page in the browser may send requests to this machine, another port of it too, and a name of anybody's may lead here
(DNS rebinding). So a request must name this very host and port, carry the cookie that only the address with the token
gives, and, if it changes anything, come from a page of this server and carry the proof that the page's form has.
"""

from __future__ import annotations

import asyncio
import hmac
import logging
import os
import secrets
import shutil
import socket
import tempfile
import threading
from collections import defaultdict
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

import uvicorn
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from uvicorn.protocols.http.h11_impl import H11Protocol

from calibrary.errors import InputError, UsageError

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK: Final = "127.0.0.1"
LOCAL: Final = "localhost"
ANY: Final = "0.0.0.0"  # noqa: S104  what a person has asked for
USUAL_PORT: Final = 80
MOST_BYTES: Final = 64 << 20
"""Of one request."""
SHORTEST_PASSWORD: Final = 12
GUESS_S: Final = 1.0
"""Time that a password takes, right or wrong: who need not wait for the answer could try the next at once."""
ASKING_S: Final = 10.0
"""Time for the head of a request, and for a password: who takes longer keeps one of few connections."""
ENDING_S: Final = 2
CHANGED: Final = "x-desk-token"
"""Header by which the page's script proves what a form proves by its field."""
HEADERS: Final = {
    "x-content-type-options": "nosniff",
    # With no-referrer, forms would be sent with "Origin: null".
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "x-frame-options": "DENY",
    "cache-control": "no-store",
}
STRICTEST: Final = "default-src 'none'; frame-ancestors 'none'; sandbox"
START_POLICY: Final = "default-src 'none'; form-action 'self'; frame-ancestors 'none'; base-uri 'none'"
# A page and no redirect: after a redirect from another site's link, the browser would not send the cookie.
STARTED: Final = (
    '<!doctype html><html lang="en"><meta charset="utf-8"><meta http-equiv="refresh" content="0; url=/">'
    '<title>calibrary desk</title><p><a href="/">Open the desk</a>'
)
ASKED: Final = (
    '<!doctype html><html lang="en"><meta charset="utf-8"><title>calibrary desk</title>'
    '<form method="post" action="/start"><p><label>Password <input type="password" name="password" autofocus></label>'
    " <button>Open the desk</button></form>"
)


class Keys:
    """What proves that a request may be made: the token of the first address, the cookie, the token of forms.

    Attributes:
        once: the token of the address that a browser is started with, which others of this machine can read in the list
            of processes; it opens the desk once.
    """

    def __init__(self) -> None:
        self.first, self.session = secrets.token_urlsafe(24), secrets.token_urlsafe(24)
        self.once: str | None = secrets.token_urlsafe(24)
        self.form = hmac.new(self.session.encode(), b"form", "sha256").hexdigest()

    def opens(self, given: str | None) -> bool:
        """Whether a token opens the desk."""
        if self.once is not None and self.fits(given, self.once):
            self.once = None
            return True
        return self.fits(given, self.first)

    @staticmethod
    def fits(given: str | None, wanted: str) -> bool:
        """Whether a secret is the wanted one; takes as long for one that is nearly right."""
        return given is not None and hmac.compare_digest(given.encode(), wanted.encode())


class Guarded(Protocol):
    """What answers the requests that are let in."""

    @property
    def app(self) -> ASGIApp:
        """The application."""

    def warm(self) -> None:
        """Load what is not needed before a page is asked for; in a thread of its own, while the browser starts."""

    def close(self) -> None:
        """End what still runs."""


class _TooMuchError(Exception):
    """More bytes came than one request may have."""


class _Prompt(H11Protocol):
    """HTTP of those who say in time what they want; uvicorn itself waits for a head as long as it takes."""

    _late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._wait()

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        self._wait()

    def _wait(self) -> None:
        is_waiting = getattr(self.cycle, "response_complete", True)
        if is_waiting and self._late is None:
            self._late = self.loop.call_later(ASKING_S, self.transport.close)
        elif not is_waiting and self._late is not None:
            self._late.cancel()
            self._late = None


class Desk:
    """A server that has its port and its pages once it is made.

    Args:
        load: gives the pages, for these keys and a folder that is removed at the end.
        port: 0 for any free one.
        host: address to listen at; None for this machine alone.
        is_agreed: whether others may act as the person whose desk it is.
        password_file: what these others type.

    Attributes:
        address: the first address to open, with its token.
    """

    def __init__(
        self,
        load: Callable[[Keys, Path], Guarded],
        *,
        port: int,
        host: str | None,
        is_agreed: bool,
        password_file: str | Path | None,
    ) -> None:
        if len({host is not None, is_agreed, password_file is not None}) > 1:
            raise UsageError(
                "--host goes with --let-others-act-as-me and --password-file FILE: whoever has the password reads "
                "images of this machine by their path and approves with your key, and nothing is encrypted on the way"
            )
        self._keys = Keys()
        self._password = _password(Path(password_file)) if password_file is not None else None
        self._turns = defaultdict[str, asyncio.Lock](asyncio.Lock)
        self._socket = _listening(host or LOOPBACK, port)
        named, self.port = self._socket.getsockname()[:2]
        # Of all addresses of this machine, others use one, or its name.
        own = _names() if named == ANY else [host or named]
        self._names, self._port = {one.lower() for one in (*own, named, LOCAL)}, f":{self.port}"
        start = f"http://{own[0]}{self._port}/start"
        has_token = self._password is None
        self.address: Final = f"{start}?token={self._keys.first}" if has_token else start
        self._launch: Final = f"{start}?token={self._keys.once}" if has_token else start
        self._cookie = f"calibrary-desk-{self.port}"  # cookies do not tell ports apart
        self._scratch = _scratch()
        try:
            self._pages = load(self._keys, self._scratch)
        except BaseException:
            self._socket.close()
            shutil.rmtree(self._scratch, ignore_errors=True)
            raise
        self._server = uvicorn.Server(
            uvicorn.Config(
                self,
                http=_Prompt,
                log_config=None,
                access_log=False,
                server_header=False,
                ws="none",
                lifespan="off",
                limit_concurrency=100,
                timeout_graceful_shutdown=ENDING_S,
            )
        )

    def run(self, opened: Callable[[str], object] | None = None) -> None:
        """Answer until the process is interrupted, or :meth:`stop` is called.

        Args:
            opened: called with an address that works once, as soon as it is answered, such as to open a browser.
        """
        # What goes wrong with one client is no message for the terminal.
        logging.getLogger("uvicorn").setLevel(logging.CRITICAL)
        threading.Thread(target=self._pages.warm, daemon=True).start()
        if opened is not None:
            threading.Thread(target=opened, args=(self._launch,), daemon=True).start()
        try:
            self._server.run(sockets=[self._socket])
        finally:
            self.close()

    def stop(self) -> None:
        """End :meth:`run` from another thread."""
        self._server.should_exit = True

    def close(self) -> None:
        """End what runs, and remove what was kept."""
        self._socket.close()
        self._pages.close()
        shutil.rmtree(self._scratch, ignore_errors=True)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request, or refuse it."""
        left, has_begun = MOST_BYTES, False

        async def bounded() -> Message:
            nonlocal left
            message = await receive()
            left -= len(message.get("body", b""))
            if left < 0:
                raise _TooMuchError
            return message

        async def headed(message: Message) -> None:
            nonlocal has_begun
            if message["type"] == "http.response.start":
                has_begun = True
                there = {name for name, _ in message["headers"]}
                more = {name.encode(): value.encode() for name, value in HEADERS.items()}
                more[b"content-security-policy"] = STRICTEST.encode()
                message["headers"] += [item for item in more.items() if item[0] not in there]
            await send(message)

        request = Request(scope, bounded)
        try:
            answer = await self._answering(request)
            await answer(scope, bounded, headed)
        except _TooMuchError:
            if not has_begun:
                await _refused(413, f"more than {MOST_BYTES >> 20} MB at once; name a path instead")(
                    scope, receive, headed
                )
        except Exception as error:
            if os.environ.get("CALIBRARY_DEBUG"):
                raise
            if not has_begun:
                said = f"this is a bug: {type(error).__name__}: {error}; nothing was half written"
                await _refused(500, said)(scope, receive, headed)

    async def _answering(self, request: Request) -> ASGIApp:
        refused = self._refusal(request) or await self._start(request) or self._foreign(request)
        return refused if refused is not None else self._pages.app

    def _refusal(self, request: Request) -> Response | None:
        """Refuse a request to another host, or one that is too long."""
        hosts = request.headers.getlist("host")
        if len(hosts) != 1 or not self._is_here(hosts[0], request):
            return _refused(421, "this is not the host that the desk is at")
        length = request.headers.get("content-length", "0")
        if not length.isdecimal() or int(length) > MOST_BYTES:
            return _refused(413, f"more than {MOST_BYTES >> 20} MB at once; name a path instead")
        return None

    async def _start(self, request: Request) -> Response | None:
        """Let in who has the token or the password."""
        if request.url.path != "/start":
            return None
        is_right = False
        if self._password is None:
            is_right = self._keys.opens(request.query_params.get("token"))
        elif request.method == "POST" and self._is_own(request):
            turn = self._turns[request.client.host if request.client is not None else ""]
            if turn.locked():
                return _refused(429, "one password at a time")
            async with turn:
                await asyncio.sleep(GUESS_S)
                try:
                    async with asyncio.timeout(ASKING_S), request.form(max_files=0, max_fields=1) as form:
                        is_right = self._keys.fits(str(form.get("password", "")), self._password)
                except TimeoutError:
                    return _refused(408, "the password did not come in time")
        if is_right:
            answer = HTMLResponse(STARTED, headers={"content-security-policy": START_POLICY})
            answer.set_cookie(self._cookie, self._keys.session, httponly=True, samesite="strict")
            return answer
        if self._password is not None:
            return HTMLResponse(ASKED, headers={"content-security-policy": START_POLICY})
        return _refused(403, "this address is of an earlier desk; open the one that is printed now")

    def _foreign(self, request: Request) -> Response | None:
        """Refuse who was not let in, and what another page sends."""
        if not self._keys.fits(request.cookies.get(self._cookie), self._keys.session):
            return _refused(403, "open the address that the desk printed when it started")
        if request.method in {"GET", "HEAD"}:
            return None
        if not self._is_own(request):
            return _refused(403, "this was sent by another page")
        kind = request.headers.get("content-type", "").partition(";")[0]
        # Other pages can send forms, whose token is checked where they are read, but no such header.
        is_form = kind in {"multipart/form-data", "application/x-www-form-urlencoded"}
        if CHANGED in request.headers or not is_form:
            if not self._keys.fits(request.headers.get(CHANGED), self._keys.form):
                return _refused(403, "this page is of an earlier desk; reload it")
            request.scope["desk_token"] = True
        return None

    def _is_here(self, host: str, request: Request) -> bool:
        """Whether a host is this one: a name that is known to be, or the very address that the request came to.

        An address cannot be made to lead elsewhere, as a name of anybody's can.
        """
        name = host.strip().lower().removesuffix(self._port)
        came_to, _ = request.scope["server"] or ("", 0)
        # Browsers leave out the usual port.
        return (name != host.strip().lower() or self.port == USUAL_PORT) and name in {*self._names, came_to}

    def _is_own(self, request: Request) -> bool:
        host = request.headers["host"].strip()
        return (
            request.headers.get("origin", "").lower() == f"http://{host}".lower()
            and request.headers.get("sec-fetch-site", "same-origin") == "same-origin"
        )


def _refused(code: int, text: str) -> Response:
    return PlainTextResponse(f"{code} {HTTPStatus(code).phrase}: {text}\n", code)


def _password(file: Path) -> str:
    """The first line of a file.

    Raises:
        InputError: it cannot be read, or is too short.
    """
    try:
        found = file.read_text(encoding="utf-8").partition("\n")[0].strip()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read: {error}", source=str(file), place="--password-file") from None
    if len(found) < SHORTEST_PASSWORD:
        raise InputError(
            f"has {len(found)} characters in its first line, expected {SHORTEST_PASSWORD} or more",
            source=str(file),
            place="--password-file",
        )
    return found


def _names() -> list[str]:
    """The names of this machine, the one that others most probably know first."""
    whole, own = socket.getfqdn(), socket.gethostname()
    known = [whole] if "." in whole and not whole.startswith(LOCAL) else []
    return [*known, own, f"{own}.local"]


def _listening(host: str, port: int) -> socket.socket:
    found = socket.socket()
    try:
        if os.name != "nt":
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((host, port))
        found.listen(100)
    except (OSError, OverflowError) as error:
        found.close()
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(
            f"cannot be listened on: {reason}; name another, or leave it out for any that is free",
            source=f"port {port}" if host == LOOPBACK else f"{host}, port {port}",
        ) from None
    return found


def _scratch() -> Path:
    """A new folder for what is dropped; those of desks that were killed are removed."""
    stem, parent = "calibrary-desk-", Path(tempfile.gettempdir())
    if os.name != "nt":
        for earlier in parent.glob(f"{stem}*"):
            number = earlier.name.removeprefix(stem).partition("-")[0]
            try:
                os.kill(int(number), 0)
            except ProcessLookupError:
                shutil.rmtree(earlier, ignore_errors=True)
            except (ValueError, OSError, OverflowError):
                continue
    return Path(tempfile.mkdtemp(prefix=f"{stem}{os.getpid()}-"))
