"""The desk's guard: for one person, at this host and port, and for no page but the desk's own."""

from __future__ import annotations

import http.client
import os
import queue
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from calibrary.cli.main import main
from calibrary.errors import RegistryError
from calibrary.jobs.desk import desk
from calibrary.jobs.desk.guard import Desk, Guarded, Keys

FORM = "application/x-www-form-urlencoded"
RIGHT = "password=correct+horse+battery"


def asked(
    server: Desk,
    target: str,
    method: str = "GET",
    *,
    host: str | None = None,
    at: str | None = None,
    body: str = "",
    **headers: str,
) -> tuple[int, http.client.HTTPMessage, str]:
    """What the desk answers to exactly this request."""
    place = urlsplit(server.address)
    connection = http.client.HTTPConnection(at or place.hostname or "", place.port, timeout=60)
    connection.putrequest(method, target, skip_host=True)
    connection.putheader("Host", place.netloc if host is None else host)
    for name, value in headers.items():
        connection.putheader(name.replace("_", "-"), value)
    if body:
        connection.putheader("Content-Length", str(len(body)))
    connection.endheaders(body.encode() or None)
    answer = connection.getresponse()
    text = answer.read().decode("utf-8", "replace")
    connection.close()
    return answer.status, answer.headers, text


def cookie(server: Desk) -> str:
    _, headers, _ = asked(server, server.address[server.address.index("/start") :])
    return headers["Set-Cookie"].partition(";")[0]


def own(server: Desk) -> str:
    return server.address.partition("/start")[0]


def test_it_listens_on_loopback_alone(served: Desk) -> None:
    place = urlsplit(served.address)
    assert place.hostname == "127.0.0.1"
    with pytest.raises(OSError), socket.create_connection(("127.0.0.2", place.port or 0), timeout=0.3):  # noqa: PT011
        pass


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example", ""])
def test_a_name_that_is_not_this_desks_gets_nothing(served: Desk, host: str) -> None:
    assert asked(served, "/", host=host, Cookie=cookie(served))[0] == 421


def test_localhost_is_this_machine_too(served: Desk) -> None:
    assert asked(served, "/", host=f"LocalHost:{served.port}", Cookie=cookie(served))[0] == 200


def test_without_the_printed_address_there_is_no_way_in(served: Desk) -> None:
    for target in ("/", "/desk.js", "/start", "/start?token=guess", "/cameras/dji/x/1x1.html"):
        status, headers, text = asked(served, target)
        assert (status, "FC6310R" in text) == (403, False)
        assert "Set-Cookie" not in headers


def test_the_cookie_is_for_this_port_and_for_no_script_or_other_site(served: Desk) -> None:
    _, headers, _ = asked(served, served.address.partition(own(served))[2])
    assert headers["Set-Cookie"].startswith(f"calibrary-desk-{served.port}=")
    assert {"HttpOnly", "SameSite=strict"} <= set(headers["Set-Cookie"].split("; "))


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"Origin": "null"},
        {"Origin": "http://evil.example"},
        # Another port of this machine gets the cookie too: ports make no other site.
        {"Origin": "http://127.0.0.1:1"},
        {"Origin": "OWN", "Sec_Fetch_Site": "same-site"},
        {"Origin": "OWN", "Sec_Fetch_Site": "cross-site"},
    ],
)
def test_a_form_of_another_page_is_refused(served: Desk, headers: dict[str, str]) -> None:
    said = {name: value.replace("OWN", own(served)) for name, value in headers.items()}
    status, _, text = asked(
        served, "/look", "POST", body="image=x", Cookie=cookie(served), Content_Type=FORM, **said
    )
    assert (status, "another page" in text) == (403, True)


@pytest.mark.parametrize("body", ["image=x", "token=guess&image=x"])
def test_a_form_without_its_proof_is_refused(served: Desk, body: str) -> None:
    status, _, text = asked(
        served, "/look", "POST", body=body, Cookie=cookie(served), Content_Type=FORM, Origin=own(served)
    )
    assert (status, "earlier desk" in text) == (403, True)


def test_a_request_that_is_no_form_needs_the_proof_in_a_header(served: Desk) -> None:
    for proof in ({}, {"X_Desk_Token": "guess"}):
        said = {"Origin": own(served), "Content_Type": "text/plain", **proof}
        assert asked(served, "/look", "POST", body="{}", Cookie=cookie(served), **said)[0] == 403


def test_more_than_a_request_may_have_is_refused_before_it_is_read(served: Desk) -> None:
    status, _, text = asked(
        served, "/look", "POST", Content_Length=str(65 << 20), Content_Type=FORM, Origin=own(served)
    )
    assert (status, "name a path instead" in text) == (413, True)


def test_every_answer_keeps_others_out(served: Desk) -> None:
    for target in ("/", "/nothing", "/desk.js", "/start"):
        _, headers, _ = asked(served, target, Cookie=cookie(served))
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Referrer-Policy"] == "same-origin"
        assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        assert "unsafe" not in headers["Content-Security-Policy"]
        assert "Access-Control-Allow-Origin" not in headers


def test_a_page_that_is_not_there_says_so(served: Desk) -> None:
    for target in ("/nothing", "/cameras/../../registry.yaml", "/files/dji/fc6310r/..%2f..%2fregistry.yaml"):
        status, _, text = asked(served, target, Cookie=cookie(served))
        assert (status, "no page of this address" in text or "no such camera" in text) in {
            (404, True),
            (409, True),
        }


def test_a_bug_is_told_as_one_on_a_page(served: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("<b>broken")

    admitted = cookie(served)
    assert asked(served, "/review", Cookie=admitted)[0] == 200
    monkeypatch.setattr("calibrary.jobs.desk.pages.queue", broken)
    status, headers, text = asked(served, "/review", Cookie=admitted)
    assert (status, "This is a bug: RuntimeError: &lt;b&gt;broken" in text) == (500, True)
    assert "default-src" in headers["Content-Security-Policy"]


def test_a_port_that_is_taken_is_named(served: Desk, fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["desk", "--no-open", "--port", str(served.port), "--registry", str(fleet)]) == 3
    assert f"port {served.port}: cannot be listened on" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", ["--host 127.0.0.2", "--let-others-act-as-me", "--host 127.0.0.2 --let-others-act-as-me"]
)
def test_others_are_let_in_only_by_consent_and_with_a_password(
    fleet: Path, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["desk", "--no-open", "--registry", str(fleet), *words.split()]) == 2
    assert "approves with your key, and nothing is encrypted" in capsys.readouterr().err


def test_a_short_password_is_refused(fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "word").write_text("secret\n")
    others = ["--host", "127.0.0.2", "--let-others-act-as-me", "--password-file", str(tmp_path / "word")]
    assert main(["desk", "--no-open", "--registry", str(fleet), *others]) == 3
    assert "has 6 characters" in capsys.readouterr().err


@contextmanager
def shared(fleet: Path, folder: Path, host: str) -> Iterator[Desk]:
    """A desk for others than this machine."""
    (folder / "word").write_text("correct horse battery\n")
    server = desk(fleet, host=host, let_others_act_as_me=True, password_file=str(folder / "word"))
    thread = threading.Thread(target=server.run)
    thread.start()
    yield server
    server.stop()
    thread.join()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux listens on all of 127/8")
def test_who_has_the_password_is_let_in_at_the_stated_address(fleet: Path, tmp_path: Path) -> None:
    with shared(fleet, tmp_path, "127.0.0.2") as server:
        form = {"Content_Type": FORM, "Origin": own(server)}
        assert "password" in asked(server, "/start")[2]
        assert "Set-Cookie" not in asked(server, "/start", "POST", body="password=guess", **form)[1]
        assert "Set-Cookie" not in asked(server, "/start", "POST", body=RIGHT, Content_Type=FORM)[1]
        assert "Set-Cookie" in asked(server, "/start", "POST", body=RIGHT, **form)[1]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux listens on all of 127/8")
def test_who_hangs_up_may_not_guess_again_any_sooner(fleet: Path, tmp_path: Path) -> None:
    with shared(fleet, tmp_path, "127.0.0.2") as server:
        head = f"POST /start HTTP/1.1\r\nHost: 127.0.0.2:{server.port}\r\nOrigin: {own(server)}\r\n"
        guess = f"{head}Content-Type: {FORM}\r\nContent-Length: 14\r\n\r\npassword=guess"
        with socket.create_connection(("127.0.0.2", server.port)) as hasty:
            hasty.sendall(guess.encode())
            time.sleep(0.2)
        form = {"Content_Type": FORM, "Origin": own(server)}
        assert asked(server, "/start", "POST", body=RIGHT, **form)[0] == 429
        time.sleep(1)
        assert "Set-Cookie" in asked(server, "/start", "POST", body=RIGHT, **form)[1]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux listens on all of 127/8")
@pytest.mark.parametrize("body", ["", "\r\nContent-Length: 9\r\n\r\npass"])
def test_who_does_not_say_what_they_want_keeps_no_connection(
    fleet: Path, tmp_path: Path, body: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calibrary.jobs.desk.guard.ASKING_S", 0.3)
    with shared(fleet, tmp_path, "127.0.0.2") as server:
        head = f"POST /start HTTP/1.1\r\nHost: 127.0.0.2:{server.port}\r\nOrigin: {own(server)}\r\n"
        with socket.create_connection(("127.0.0.2", server.port), timeout=30) as slow:
            slow.sendall(f"{head}Content-Type: {FORM}{body}".encode())
            assert slow.recv(100).startswith(b"HTTP/1.1 408" if body else b"")
            while slow.recv(4096):
                pass


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux listens on all of 127/8")
@pytest.mark.parametrize(
    ("host", "code"),
    [
        ("127.0.0.1", 200),
        (socket.gethostname(), 200),
        (f"{socket.gethostname()}.local", 200),
        # An address of another machine, and a name that anybody may lead here.
        ("127.0.0.9", 421),
        ("evil.example", 421),
    ],
)
def test_at_all_addresses_it_goes_by_that_of_the_request_and_by_the_machines_names(
    fleet: Path, tmp_path: Path, host: str, code: int
) -> None:
    with shared(fleet, tmp_path, "0.0.0.0") as server:  # noqa: S104  what is tested
        place = f"{host}:{server.port}"
        assert asked(server, "/start", host=place, at="127.0.0.1")[0] == code
        form = {"Content_Type": FORM, "Origin": f"http://{place}"}
        _, headers, _ = asked(server, "/start", "POST", host=place, at="127.0.0.1", body=RIGHT, **form)
        assert ("Set-Cookie" in headers) is (code == 200)
        assert urlsplit(server.address).hostname != "0.0.0.0"  # noqa: S104


def test_a_registry_that_is_none_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["desk", "--no-open", "--registry", str(tmp_path)]) == 4
    assert str(tmp_path) in capsys.readouterr().err


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C is no signal there")
def test_pages_that_cannot_be_loaded_leave_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    def load(_: Keys, scratch: Path) -> Guarded:
        assert scratch.parent == tmp_path
        raise RegistryError("nothing to show")

    with pytest.raises(RegistryError):
        Desk(load, port=0, host=None, is_agreed=False, password_file=None)
    assert [*tmp_path.iterdir()] == []


def test_ctrl_c_ends_it_in_peace_and_leaves_nothing(fleet: Path, tmp_path: Path) -> None:
    scratch = tmp_path / "tmp"
    scratch.mkdir()
    (scratch / "calibrary-desk-999999999-killed").mkdir()
    command = [sys.executable, "-m", "calibrary", "desk", "--no-open", "--registry", str(fleet)]
    environment = {**os.environ, "TMPDIR": str(scratch)}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stdout is not None
        place = urlsplit(process.stdout.readline().strip())
        connection = http.client.HTTPConnection(place.netloc, timeout=60)
        connection.request("GET", f"{place.path}?{place.query}")
        assert connection.getresponse().status == 200
        assert [one.name.split("-")[2] for one in scratch.iterdir()] == [str(process.pid)]
        connection.close()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 0
    assert err == "Ctrl-C ends it\nended\n"
    assert [*scratch.iterdir()] == []


def test_the_address_that_a_browser_is_started_with_opens_the_desk_once(fleet: Path) -> None:
    launched: queue.Queue[str] = queue.Queue()
    server = desk(fleet)
    thread = threading.Thread(target=server.run, args=(launched.put,))
    thread.start()
    address = launched.get(timeout=30)
    assert address != server.address
    statuses = [asked(server, address.partition(own(server))[2])[0] for _ in range(2)]
    again = asked(server, server.address.partition(own(server))[2])[0]
    server.stop()
    thread.join()
    assert (statuses, again) == ([200, 403], 200)


@pytest.mark.parametrize(("address", "way"), [("/", "Look up"), ("/boards", "Boards"), ("/nowhere", None)])
def test_the_way_to_the_page_that_is_shown_is_marked(served: Desk, address: str, way: str | None) -> None:
    _, _, text = asked(served, address, Cookie=cookie(served))
    assert re.findall(r'aria-current="page">([^<]+)<', text) == ([way] if way else [])


@pytest.mark.parametrize("address", ["/", "/flight", "/onboard", "/boards", "/compare"])
def test_a_page_has_one_strong_button(served: Desk, address: str) -> None:
    assert asked(served, address, Cookie=cookie(served))[2].count('<button class="strong">') == 1


def test_a_board_to_print_is_a_pdf_under_its_name(served: Desk) -> None:
    pytest.importorskip("cv2")
    status, headers, text = asked(
        served, "/boards/print?board=checkerboard%3A9x6&square-mm=25", Cookie=cookie(served)
    )
    assert (status, text[:5]) == (200, "%PDF-")
    assert "checkerboard-9x6.pdf" in headers["Content-Disposition"]


def test_a_board_without_the_side_of_its_squares_is_asked_again(served: Desk) -> None:
    status, _, text = asked(served, "/boards/print?board=checkerboard%3A9x6", Cookie=cookie(served))
    assert (status, "expected the side of a square in mm" in text) == (400, True)


def test_the_use_of_a_k_stands_once_in_its_answer(served: Desk) -> None:
    _, _, text = asked(served, "/?q=dji/fc6310r/5472x3648%2Bf8.8", Cookie=cookie(served))
    assert text.count("<dt>use</dt>") == 1
    assert text.count("A solver may ") == 1


def test_where_no_k_applies_the_nearest_entries_are_named(served: Desk) -> None:
    _, _, text = asked(served, "/?make=DJI&model=FC6310R&focal_mm=24", Cookie=cookie(served))
    assert "No approved K applies to DJI FC6310R" in text
    assert "it is of 8.8 mm, not 24 mm" in text
