"""Servers on this machine: one that sends ranges and misbehaves on request, and moto's S3."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from http.client import HTTPConnection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


@dataclass(slots=True)
class Site:
    """What a web server has, and how it answers.

    Attributes:
        files: content by path, without the first slash.
        faults: by path, what happens to its next requests: a status, "cut" or "changed".
        delay_s: before each answer.
        ranges: whether it knows ranges.
        requests, sent: of each path, how many and how many bytes.
        credentials: the Authorization headers that it was sent.
    """

    url: str = ""
    files: dict[str, bytes] = field(default_factory=dict)
    faults: dict[str, list[int | str]] = field(default_factory=dict)
    delay_s: float = 0.0
    ranges: bool = True
    requests: Counter[str] = field(default_factory=Counter)
    sent: Counter[str] = field(default_factory=Counter)
    credentials: set[str | None] = field(default_factory=set)
    versions: Counter[str] = field(default_factory=Counter)


@contextmanager
def site() -> Iterator[Site]:
    """A web server for the length of the block."""
    found = Site()

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            _answer(self, found)

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    found.url = f"http://127.0.0.1:{server.server_address[1]}"
    threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
    try:
        yield found
    finally:
        server.shutdown()
        server.server_close()


def _answer(handler: BaseHTTPRequestHandler, found: Site) -> None:
    path = handler.path.lstrip("/").partition("?")[0]
    time.sleep(found.delay_s)
    found.requests[path] += 1
    found.credentials.add(handler.headers["Authorization"])
    fault = found.faults[path].pop(0) if found.faults.get(path) else None
    if fault == "changed":
        found.versions[path] += 1
        fault = None
    if isinstance(fault, str) and fault.startswith("http"):
        return _status(handler, HTTPStatus.FOUND, {"Location": fault})
    if isinstance(fault, int) or path not in found.files:
        return _status(handler, int(fault or 404), {})
    data, tag = found.files[path], f'"{found.versions[path]}"'
    if handler.headers["If-Match"] not in {None, tag}:
        return _status(handler, HTTPStatus.PRECONDITION_FAILED, {})
    asked = re.fullmatch(r"bytes=(\d+)-(\d+)", handler.headers["Range"] or "") if found.ranges else None
    headers = {"ETag": tag}
    body, status = data, HTTPStatus.OK
    if asked is not None:
        start, end = int(asked[1]), min(int(asked[2]) + 1, len(data))
        if start >= len(data):
            return _status(handler, HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, {})
        body, status = data[start:end], HTTPStatus.PARTIAL_CONTENT
        headers["Content-Range"] = f"bytes {start}-{end - 1}/{len(data)}"
    handler.send_response(status)
    for name, value in (headers | {"Content-Length": str(len(body))}).items():
        handler.send_header(name, value)
    handler.end_headers()
    with suppress(OSError):
        handler.wfile.write(body[: len(body) // 2] if fault == "cut" else body)
    found.sent[path] += len(body)
    handler.close_connection = fault == "cut"
    return None


def _status(handler: BaseHTTPRequestHandler, status: int, headers: dict[str, str]) -> None:
    handler.send_response(status)
    for name, value in headers.items():
        handler.send_header(name, value)
    handler.send_header("Content-Length", "0")
    handler.end_headers()


@contextmanager
def moto() -> Iterator[str]:
    """The URL of an S3 server, in a process of its own."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-W", "ignore", "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        for _ in range(300):
            with suppress(OSError), closing(HTTPConnection("127.0.0.1", port, timeout=5)) as connection:
                connection.request("GET", "/")
                connection.getresponse().read()
                break
            time.sleep(0.2)
        yield f"http://127.0.0.1:{port}"
    finally:
        server.kill()
        server.wait()
