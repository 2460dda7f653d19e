"""A web server on this machine that gives out a folder, knows ETags, and fails where a test wants it to."""

from __future__ import annotations

import hashlib
import http.server
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Answer:
    """What is answered in place of a file.

    Attributes:
        status: of the answer.
        body: of it.
        headers: beside those of every answer; a Content-Length of its own is sent as it is.
    """

    status: int = 200
    body: bytes = b""
    headers: Mapping[str, str] = field(default_factory=dict)


@dataclass(slots=True)
class Server:
    """A folder that is given out.

    Attributes:
        folder: of the files.
        url: of the folder.
        asked: every path that was asked for, with the status of the answer.
        faults: by path, what is answered in its place: once for each item.
        before: called with each path before it is answered.
    """

    folder: Path
    url: str = ""
    asked: list[tuple[str, int]] = field(default_factory=list)
    faults: dict[str, list[Answer]] = field(default_factory=dict)
    before: Callable[[str], None] = lambda _: None

    @property
    def paths(self) -> list[str]:
        """What was asked for since this was last looked at."""
        found = [path for path, _ in self.asked]
        self.asked.clear()
        return found

    def answer(self, path: str, etag: str | None) -> Answer:
        """The answer to a request."""
        self.before(path)
        if waiting := self.faults.get(path):
            return waiting.pop(0)
        try:
            data = (self.folder / path).read_bytes()
        except OSError:
            return Answer(404, b"not found")
        own = f'"{hashlib.sha256(data).hexdigest()[:16]}"'
        return Answer(304, b"", {"ETag": own}) if own == etag else Answer(200, data, {"ETag": own})


@contextmanager
def serving(folder: Path) -> Iterator[Server]:
    """The folder on the web, for as long as it takes."""
    server = Server(folder)

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            path = self.path.removeprefix(server.url).lstrip("/")
            answer = server.answer(path, self.headers.get("If-None-Match"))
            server.asked.append((path, answer.status))
            self.send_response(answer.status)
            for name, value in answer.headers.items():
                self.send_header(name, value)
            if "Content-Length" not in answer.headers and answer.status != 304:
                self.send_header("Content-Length", str(len(answer.body)))
            self.end_headers()
            self.wfile.write(answer.body)

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as listening:
        server.url = f"http://127.0.0.1:{listening.server_port}/"
        thread = threading.Thread(target=listening.serve_forever, args=(0.01,), daemon=True)
        thread.start()
        try:
            yield server
        finally:
            listening.shutdown()
            thread.join()
