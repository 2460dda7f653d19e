"""Connections to a server of published files: kept open, opened again, and through a proxy."""

from __future__ import annotations

import base64
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from calibrary.registry.published import fetch as transport
from calibrary.registry.published.fetch import Connections, FetchError, fetch
from tests.registry.published.server import Answer, serving


@pytest.fixture(autouse=True)
def connections(monkeypatch: pytest.MonkeyPatch) -> Iterator[Connections]:
    """None open yet, and no proxy."""
    for name in ("http_proxy", "https_proxy", "all_proxy", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)
    found = Connections()
    monkeypatch.setattr(transport, "_connections", lambda: found)
    yield found
    found.close()


@pytest.fixture
def files(tmp_path: Path) -> Path:
    for number in range(20):
        (tmp_path / f"{number}.json").write_text(f"{{{number}}}")
    return tmp_path


def read(url: str, number: int) -> bytes | None:
    return fetch(f"{url}{number}.json", most=100).data


def test_files_of_a_server_come_over_one_connection(files: Path) -> None:
    with serving(files, most=100) as server:
        assert [read(server.url, number) for number in range(20)] == [b"{%d}" % n for n in range(20)]
        assert server.connections == 1


def test_what_has_no_body_leaves_it_open_too(files: Path) -> None:
    with serving(files, most=100) as server:
        etag = fetch(f"{server.url}1.json", most=100).etag
        assert fetch(f"{server.url}1.json", most=100, etag=etag).data is None
        assert read(server.url, 2) == b"{2}"
        assert server.connections == 1


def test_one_that_the_server_has_closed_meanwhile_is_opened_again(files: Path) -> None:
    with serving(files, most=3) as server:
        assert [read(server.url, number) for number in range(10)] == [b"{%d}" % n for n in range(10)]
        assert server.connections == 4


def test_one_that_was_not_read_to_its_end_is_not_used_again(files: Path) -> None:
    with serving(files, most=100) as server:
        server.faults["1.json"] = [Answer(200, b"x" * 4000)]
        with pytest.raises(FetchError, match="is longer than 0 KiB"):
            read(server.url, 1)
        assert read(server.url, 1) == b"{1}"
        assert server.connections == 2


def test_threads_have_connections_of_their_own(files: Path) -> None:
    with serving(files, most=1000) as server, ThreadPoolExecutor(4) as pool:
        found = [*pool.map(lambda number: read(server.url, number), [*range(20)] * 5)]
        assert found == [b"{%d}" % n for n in range(20)] * 5
        assert server.connections <= 4


@contextmanager
def proxy(asked: list[tuple[str, str | None]]) -> Iterator[str]:
    """A proxy that answers everything by itself; its host and port."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append((self.path, self.headers.get("Proxy-Authorization")))
            self.send_response(200)
            self.send_header("Content-Length", "2")
            self.end_headers()
            self.wfile.write(b"{}")

        def do_CONNECT(self) -> None:
            asked.append((self.path, self.headers.get("Proxy-Authorization")))
            self.send_error(403, "not here")

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as listening:
        thread = threading.Thread(target=listening.serve_forever, args=(0.01,), daemon=True)
        thread.start()
        yield f"127.0.0.1:{listening.server_port}"
        listening.shutdown()
        thread.join()


class TestProxies:
    def test_the_one_of_the_environment_is_asked(self, monkeypatch: pytest.MonkeyPatch) -> None:
        asked: list[tuple[str, str | None]] = []
        with proxy(asked) as place:
            monkeypatch.setenv("http_proxy", f"http://ada:s%40cret@{place}")
            monkeypatch.setenv("https_proxy", place)
            assert fetch("http://cameras.example/a.json", most=100).data == b"{}"
            with pytest.raises(FetchError, match="403 not here") as raised:
                fetch("https://cameras.example/a.json", most=100)
        pair = base64.b64encode(b"ada:s@cret").decode()
        assert asked == [
            ("http://cameras.example/a.json", f"Basic {pair}"),
            ("cameras.example:443", None),
        ]
        assert raised.value.is_temporary

    def test_but_not_for_this_machine_nor_where_it_is_excepted(
        self, files: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")
        with serving(files) as server:
            assert read(server.url, 1) == b"{1}"
        monkeypatch.setenv("no_proxy", "cameras.invalid")
        with pytest.raises(FetchError) as raised:
            fetch("http://cameras.invalid/a.json", most=100)
        assert "refused" not in str(raised.value)
