"""Local web server for a site, which is rebuilt when the registry changes.

It listens on 127.0.0.1. A web page could still make a browser send requests there under another host name (DNS
rebinding), so a request must state the host and port of this server. Requests change nothing and can read
only the files of the site.
"""

from __future__ import annotations

import posixpath
import shutil
import socketserver
import tempfile
import threading
from collections.abc import Callable
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import TracebackType
from typing import Final
from urllib.parse import unquote, urlsplit

from calibrary.errors import CalibraryError, InputError
from calibrary.jobs.site.building import Progress, Site, build_into
from calibrary.jobs.site.folder import INDEX
from calibrary.registry.registry import Registry

__all__ = ["LOOPBACK", "Server"]

LOOPBACK: Final = "127.0.0.1"
LOOK_EVERY_S: Final = 2.0
PATIENCE_S: Final = 10.0
"""Time limit in s for a client's request."""

TYPES: Final = {".html": "text/html; charset=utf-8"}
HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Frame-Options": "DENY",
    "Cache-Control": "no-store",
}
PAGE_POLICY: Final = "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
FILE_POLICY: Final = "default-src 'none'; frame-ancestors 'none'; sandbox"


class Server:
    """Serves a registry's site until it is closed.

    Attributes:
        url: address of the site.
    """

    def __init__(
        self,
        registry: Path,
        *,
        port: int = 0,
        workers: int | None = None,
        progress: Progress | None = None,
        told: Callable[[str], None] | None = None,
    ) -> None:
        """Build the site and open the port.

        Args:
            registry: folder of the registry.
            port: 0 for any free port.
            workers: processes that build the site.
            progress: called during the first build with the number of entries done and the total.
            told: called with later events: a rebuild, or the reason for its failure.

        Raises:
            InputError: the port is in use.
            RegistryError: the registry cannot be read.
        """
        self._registry = registry
        self._workers = workers
        self._told = told or (lambda _: None)
        self._ended = threading.Event()
        self._scratch = Path(tempfile.mkdtemp(prefix="calibrary-site-"))
        try:
            # The port first, because it fails faster.
            self._http = _open(port, self._file)
            self._site = self._built(None, progress)
        except BaseException:
            shutil.rmtree(self._scratch, ignore_errors=True)
            raise
        self.url: Final = f"http://{LOOPBACK}:{self._http.server_port}/"
        self._watcher = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Server:
        self._watcher.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._http.server_close()
        if self._watcher.is_alive():
            self._watcher.join()
        shutil.rmtree(self._scratch, ignore_errors=True)

    def run(self) -> None:
        """Answer requests until :meth:`stop` is called or the process is interrupted."""
        self._http.serve_forever(poll_interval=0.2)

    def stop(self) -> None:
        """End :meth:`run` from another thread."""
        self._http.shutdown()

    def look(self) -> bool:
        """Rebuild the site if the registry has changed; returns whether it has.

        Raises:
            RegistryError: the registry cannot be read; the site stays unchanged.
        """
        earlier = self._site
        if Registry.open(self._registry).commit() == earlier.commit:
            return False
        self._site = self._built(earlier, None)
        # A request in progress has its file open; the next request gets the new site.
        shutil.rmtree(earlier.root, ignore_errors=True)
        return True

    def _built(self, earlier: Site | None, progress: Progress | None) -> Site:
        folder = Path(tempfile.mkdtemp(dir=self._scratch))
        try:
            return build_into(
                folder, self._registry, earlier=earlier, workers=self._workers, progress=progress
            )
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise

    def _watch(self) -> None:
        said = ""
        while not self._ended.wait(LOOK_EVERY_S):
            try:
                if self.look():
                    said = ""
                    self._told(f"rebuilt at {self._site.commit[:12]}")
            except CalibraryError as error:
                if str(error) != said:
                    said = str(error)
                    self._told(f"not rebuilt: {said}")

    def _file(self, address: str) -> Path | None:
        """The site's file at an address; None if there is none, or it would be outside the site."""
        try:
            path = unquote(urlsplit(address).path, errors="strict")
        except (UnicodeDecodeError, ValueError):
            return None
        if not path.startswith("/") or "\\" in path or not path.isprintable():
            return None
        names = path[1:].split("/")
        if any(name in {"", ".", ".."} or name.startswith(".") for name in names[:-1]) or names[
            -1
        ].startswith("."):
            return None
        if not names[-1]:
            names[-1] = INDEX
        root = self._site.root
        found = root / posixpath.join(*names)
        return found if found.is_file() and found.resolve().is_relative_to(root.resolve()) else None


class _Listener(ThreadingHTTPServer):
    """Answers each client in a separate thread."""

    daemon_threads = True

    def server_bind(self) -> None:
        # The base class looks up this machine's name in the network, which can block.
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = LOOPBACK, int(self.server_address[1])

    def handle_error(self, request: object, client_address: object) -> None:
        """Print nothing; the base class would print a traceback if a client closes the connection."""


def _open(port: int, file: Callable[[str], Path | None]) -> ThreadingHTTPServer:
    try:
        return _Listener((LOOPBACK, port), partial(_Handler, file))
    except (OSError, OverflowError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(
            f"cannot be listened on: {reason}; name another, or leave it out for any that is free",
            source=f"port {port}",
        ) from None


class _Handler(BaseHTTPRequestHandler):
    """Answers GET and HEAD."""

    server_version = "calibrary"
    sys_version = ""
    timeout = PATIENCE_S
    protocol_version = "HTTP/1.1"

    def __init__(self, file: Callable[[str], Path | None], *arguments: object) -> None:
        self._file = file
        super().__init__(*arguments)  # type: ignore[arg-type]  # passed on from the server

    def do_GET(self) -> None:
        self._answer(body=True)

    def do_HEAD(self) -> None:
        self._answer(body=False)

    def _answer(self, *, body: bool) -> None:
        if not self._is_for_us():
            self._refuse(HTTPStatus.MISDIRECTED_REQUEST, body=body)
            return
        found = self._file(self.path)
        try:
            data = found.read_bytes() if found is not None else None
        except OSError:
            data = None
        if found is None or data is None:
            self._refuse(HTTPStatus.NOT_FOUND, body=body)
            return
        is_page = found.suffix == ".html"
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", TYPES.get(found.suffix, "application/octet-stream"))
        self.send_header("Content-Security-Policy", PAGE_POLICY if is_page else FILE_POLICY)
        if not is_page:
            self.send_header("Content-Disposition", "attachment")
        self._end(data, body=body)

    def _is_for_us(self) -> bool:
        hosts = self.headers.get_all("Host", [])
        port = self.connection.getsockname()[1]
        named = {f"{name}:{port}" for name in (LOOPBACK, "localhost")}
        return len(hosts) == 1 and hosts[0].strip().lower() in named

    def _refuse(self, status: HTTPStatus, *, body: bool) -> None:
        self.send_response(status)
        self.send_header("Content-Type", "text/plain; charset=utf-8")
        self.send_header("Content-Security-Policy", FILE_POLICY)
        self._end(f"{status.value} {status.phrase}\n".encode(), body=body)

    def _end(self, data: bytes, *, body: bool) -> None:
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        if body:
            self.wfile.write(data)

    def log_message(self, format: str, *arguments: object) -> None:  # noqa: A002  the base class's name
        """Print nothing, because the library never prints."""
