"""Parts of a file on a web server belong to one version of it."""

from __future__ import annotations

import gc
from email.message import Message
from urllib.parse import urlsplit

import pytest

from calibrary.jobs.images.ranged import StoreError
from calibrary.jobs.images.web import WebServer
from tests.jobs.images.servers import site


@pytest.mark.parametrize(
    ("version", "sent", "is_same"),
    [
        ('"a"', '"a"', True),
        ('"a"', '"b"', False),
        ('W/"a"', 'W/"b"', False),
        ('"a"', None, True),
        (None, '"b"', True),
    ],
)
def test_a_part_of_another_version_than_the_first_is_refused(
    version: str | None, sent: str | None, *, is_same: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: dict[str, str] = {}
    headers = Message()
    if sent is not None:
        headers["ETag"] = sent

    def get(_: WebServer, key: str, wanted: dict[str, str]) -> tuple[int, Message, bytes]:
        asked.update(wanted, key=key)
        return 206, headers, b"3456"

    monkeypatch.setattr(WebServer, "_get", get)
    server = WebServer("https", "example.com")
    if is_same:
        assert server.part("a.tif", 3, 7, version) == b"3456"
    else:
        with pytest.raises(StoreError, match="was changed while it was read"):
            server.part("a.tif", 3, 7, version)
    # A weak version cannot be a condition of a range (RFC 9110, 13.1.1).
    condition = {"If-Match": version} if version == '"a"' else {}
    assert asked == {"key": "a.tif", "Range": "bytes=3-6"} | condition


def test_open_connections_end_with_their_server() -> None:
    with site() as found:
        found.files["a.jpg"] = b"0123"
        place = urlsplit(found.url)
        server = WebServer(place.scheme, place.netloc)
        assert server.first("a.jpg", 4).data == b"0123"
        [kept] = server._idle
        assert kept.sock is not None
        del server
        gc.collect()
        assert kept.sock is None
