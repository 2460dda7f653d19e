"""The server: for this machine alone, for nobody by another name, and nothing but the site."""

from __future__ import annotations

import http.client
import os
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from calibrary.cli.main import main
from calibrary.errors import InputError
from calibrary.jobs.site import server as module
from calibrary.jobs.site.building import Site
from calibrary.jobs.site.server import Server
from calibrary.registry.registry import Registry
from tests.jobs.site.fleet import SETTLED, later, save
from tests.jobs.site.test_site import P4R_PAGE


@pytest.fixture(scope="module")
def server(registry: Path) -> Iterator[Server]:
    with Server(registry, workers=1) as made:
        thread = threading.Thread(target=made.run)
        thread.start()
        yield made
        made.stop()
        thread.join()


def asked(
    server: Server, target: str, *, method: str = "GET", host: str | None = None, **headers: str
) -> tuple[int, http.client.HTTPMessage, bytes]:
    """What the server answers to exactly this request."""
    place = urlsplit(server.url)
    connection = http.client.HTTPConnection(place.hostname or "", place.port, timeout=10)
    connection.putrequest(method, target, skip_host=True)
    if host != "":
        connection.putheader("Host", host or place.netloc)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, answer.headers, body


def test_it_listens_on_loopback_alone(server: Server) -> None:
    place = urlsplit(server.url)
    assert place.hostname == "127.0.0.1"
    with pytest.raises(OSError), socket.create_connection(("127.0.0.2", place.port or 0), timeout=0.3):  # noqa: PT011
        pass


def test_pages_are_the_sites_own(server: Server, site: Site) -> None:
    for target in ("/", "/index.html", f"/{P4R_PAGE}", f"/{P4R_PAGE.replace('+', '%2B')}", "/?x=1"):
        status, headers, body = asked(server, target)
        path = site.root / (P4R_PAGE if "fc6310r" in target else "index.html")
        assert (status, body) == (200, path.read_bytes())
        assert headers["Content-Type"] == "text/html; charset=utf-8"


def test_files_are_handed_out_to_be_kept(server: Server, site: Site) -> None:
    name = "files/dji/fc6310r/5472x3648+f8.8/fc6310r-5472x3648-agisoft_xml.xml"
    status, headers, body = asked(server, f"/{name}")
    assert (status, body) == (200, (site.root / name).read_bytes())
    assert headers["Content-Disposition"] == "attachment"
    assert headers["Content-Type"] == "application/octet-stream"
    assert "sandbox" in headers["Content-Security-Policy"]


def test_head_is_get_without_the_body(server: Server) -> None:
    whole = asked(server, "/")
    status, headers, body = asked(server, "/", method="HEAD")
    assert (status, body) == (200, b"")
    assert headers["Content-Length"] == str(len(whole[2]))


@pytest.mark.parametrize(
    "host",
    ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example", "", "[::1]", "0.0.0.0"],  # noqa: S104
)
def test_a_name_that_is_not_this_server_s_gets_nothing(server: Server, host: str) -> None:
    status, _, body = asked(server, "/", host=host)
    assert status == 421
    assert b"FC6310R" not in body


def test_localhost_is_this_machine_too(server: Server) -> None:
    assert asked(server, "/", host=f"LocalHost:{urlsplit(server.url).port}")[0] == 200


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "TRACE", "PATCH"])
def test_nothing_can_be_done_but_read(server: Server, method: str) -> None:
    assert asked(server, "/", method=method)[0] == 501


@pytest.mark.parametrize(
    "target",
    [
        "/../fleet/registry.yaml",
        "/%2e%2e/%2e%2e/etc/passwd",
        "/..%2f..%2fetc/passwd",
        "/cameras/../../../etc/passwd",
        "/cameras\\..\\..\\x",
        "//etc/passwd",
        "/cameras",
        "/cameras/",
        "/.calibrary-site",
        "/index.html/",
        "/index.html%00.yaml",
        "/%ff%fe",
        "/nothing.html",
        "etc/passwd",
        "http://127.0.0.1/%2e%2e/x",
    ],
)
def test_there_is_no_way_out_of_the_site(server: Server, target: str) -> None:
    status, headers, body = asked(server, target)
    assert (status, body) == (404, b"404 Not Found\n")
    assert headers["Content-Type"].startswith("text/plain")


@pytest.mark.parametrize(
    "target", ["/", "/nothing", "/files/dji/fc6310r/5472x3648+f8.8/5472x3648+f8.8-entry.yaml"]
)
def test_every_answer_keeps_others_out(server: Server, target: str) -> None:
    _, headers, _ = asked(server, target)
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert "Access-Control-Allow-Origin" not in headers
    assert headers["Server"] == "calibrary "


def test_a_registry_that_moves_on_is_shown_anew(
    registry: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LOOK_EVERY_S", 0.05)
    copy = shutil.copytree(registry, tmp_path / "fleet")
    told: list[str] = []
    with Server(copy, workers=1, told=told.append) as server:
        thread = threading.Thread(target=server.run)
        thread.start()
        assert b"3665.60 " in asked(server, f"/{P4R_PAGE}")[2]
        save(Registry.open(copy), [later(SETTLED, fx=0.5, firmware="01.09")], "Once more")
        until = time.monotonic() + 10
        while b"3666.10 " not in asked(server, f"/{P4R_PAGE}")[2]:
            assert time.monotonic() < until, told
            time.sleep(0.05)
        server.stop()
        thread.join()
    assert told[0].startswith("rebuilt at ")


def test_a_client_that_hangs_up_is_no_event(server: Server, capfd: pytest.CaptureFixture[str]) -> None:
    place = urlsplit(server.url)
    for _ in range(20):
        with socket.create_connection((place.hostname or "", place.port or 0)) as connection:
            # Closed with data unread, which resets the connection.
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            connection.sendall(f"GET / HTTP/1.1\r\nHost: {place.netloc}\r\n\r\n".encode())
    assert asked(server, "/")[0] == 200
    assert capfd.readouterr().err == ""


def test_nothing_is_left_behind(registry: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with Server(registry, workers=1):
        assert len(list(tmp_path.iterdir())) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_port_that_is_taken_is_named(server: Server, registry: Path) -> None:
    port = urlsplit(server.url).port
    with pytest.raises(InputError, match=f"port {port}: cannot be listened on"):
        Server(registry, port=port or 0)
    assert main(["registry", "site", "--serve", "--port", str(port), "--registry", str(registry)]) == 3


@pytest.mark.parametrize("words", [["out", "--serve"], ["out", "--port", "8710"]])
def test_a_folder_and_a_server_are_not_asked_for_at_once(words: list[str], registry: Path) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["registry", "site", *words, "--registry", str(registry)])
    assert ended.value.code == 2


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C is no signal there")
def test_ctrl_c_ends_it_in_peace(registry: Path) -> None:
    command = [sys.executable, "-m", "calibrary", "registry", "site", "--serve", "--registry", str(registry)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        url = process.stdout.readline().strip()
        assert url.startswith("http://127.0.0.1:")
        connection = http.client.HTTPConnection(urlsplit(url).netloc, timeout=10)
        connection.request("GET", "/")
        assert connection.getresponse().status == 200
        connection.close()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=20)
    assert process.returncode == 0
    assert "Traceback" not in err
    assert "ended" in err
