"""Connections to a server of published files: limited, through a proxy, and with secrets."""

from __future__ import annotations

import base64
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from calibrary.registry.published import fetch as transport
from calibrary.registry.published.fetch import FetchError, fetch
from tests.registry.published.server import Answer, serving


@pytest.fixture(autouse=True)
def no_proxy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No proxy, and no secret."""
    for name in ("http_proxy", "https_proxy", "all_proxy", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)
    monkeypatch.setenv("NETRC", str(tmp_path / "netrc"))


@pytest.fixture
def files(tmp_path: Path) -> Path:
    for number in range(20):
        (tmp_path / f"{number}.json").write_text(f"{{{number}}}")
    return tmp_path


def read(url: str, number: int) -> bytes:
    return fetch(f"{url}{number}.json", most=100)


def test_one_that_is_longer_than_expected_is_not_read_to_its_end(files: Path) -> None:
    with serving(files) as server:
        server.faults["1.json"] = [Answer(200, b"x" * 4_000_000)]
        with pytest.raises(FetchError, match="is longer than 0 KiB"):
            read(server.url, 1)


def test_the_body_of_a_redirect_is_not_read(files: Path) -> None:
    with serving(files) as server:
        away = {"Location": f"{server.url}2.json", "Content-Length": str(1 << 40)}
        server.faults["1.json"] = [Answer(302, b"x", away)]
        assert read(server.url, 1) == b"{2}"


def test_a_head_that_comes_drop_by_drop_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transport, "LONGEST_S", 0.5)
    is_over = threading.Event()

    def drip(listening: socket.socket) -> None:
        one, _ = listening.accept()
        with one, suppress(OSError):
            one.sendall(b"HTTP/1.1 200 OK\r\nX-Drops: ")
            while not is_over.wait(0.05):
                one.sendall(b".")

    with socket.create_server(("127.0.0.1", 0)) as listening:
        thread = threading.Thread(target=drip, args=(listening,))
        thread.start()
        began = time.monotonic()
        with pytest.raises(FetchError, match=r"takes longer than 0\.5 s") as raised:
            fetch(f"http://127.0.0.1:{listening.getsockname()[1]}/a.json", most=100)
        assert time.monotonic() - began < 5
        is_over.set()
        thread.join()
    assert raised.value.is_temporary


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
            assert fetch("http://cameras.example/a.json", most=100) == b"{}"
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


class TestSecrets:
    @pytest.fixture
    def asked(self) -> Iterator[tuple[str, list[str | None]]]:
        """A server, and the authorization of each question; /away/ leads to another address."""
        seen: list[str | None] = []

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                seen.append(self.headers.get("Authorization"))
                self.send_response(302 if self.path.startswith("/away/") else 401)
                self.send_header("Location", f"http://localhost:{listening.server_port}/a.json")
                self.send_header("Content-Length", "0")
                self.end_headers()

            def log_message(self, *_: object) -> None:
                """Say nothing."""

        transport._netrc.cache_clear()
        with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as listening:
            thread = threading.Thread(target=listening.serve_forever, args=(0.01,), daemon=True)
            thread.start()
            yield f"http://127.0.0.1:{listening.server_port}/", seen
            listening.shutdown()
            thread.join()
        transport._netrc.cache_clear()

    def test_a_name_in_netrc_is_for_its_server_alone(
        self, asked: tuple[str, list[str | None]], tmp_path: Path
    ) -> None:
        url, seen = asked
        (tmp_path / "netrc").write_text("machine 127.0.0.1 login ada password s3cret\n")
        with pytest.raises(FetchError, match=r"401.*netrc") as raised:
            fetch(f"{url}away/a.json", most=100)
        assert seen == [f"Basic {base64.b64encode(b'ada:s3cret').decode()}", None]
        assert "s3cret" not in str(raised.value)

    def test_a_token_does_not_follow_a_redirect_to_another_server(
        self, asked: tuple[str, list[str | None]], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        url, seen = asked
        monkeypatch.setenv("CALIBRARY_TOKEN", "127.0.0.1=t0ken")
        with pytest.raises(FetchError, match="401") as raised:
            fetch(f"{url}away/a.json", most=100)
        assert seen == ["Bearer t0ken", None]
        assert "t0ken" not in str(raised.value)
        seen.clear()
        monkeypatch.setenv("CALIBRARY_TOKEN", "cameras.example.com=t0ken")
        with pytest.raises(FetchError, match="401"):
            fetch(f"{url}a.json", most=100)
        assert seen == [None]
