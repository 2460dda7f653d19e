"""A published registry over HTTP: the answers of the registry itself, verified, cached, and in bad weather."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from datetime import UTC, date, datetime
from pathlib import Path

import pytest

from calibrary.calibration import CameraKey
from calibrary.errors import RegistryError
from calibrary.records import replace
from calibrary.registry.places import PUBLISHED_FILE
from calibrary.registry.published import fetch as transport
from calibrary.registry.published import read
from calibrary.registry.published.address import normalised
from calibrary.registry.published.cache import Cache
from calibrary.registry.published.read import Published
from calibrary.registry.registry import open_snapshot
from tests.registry.entries import an_entry
from tests.registry.git.repositories import packed
from tests.registry.published.publications import (
    FLEET,
    UNIT,
    camera,
    commit,
    dated,
    manifest,
    nobodys_git,
    published,
)
from tests.registry.published.server import Answer, Server, serving

__all__ = ["nobodys_git"]

P4R = CameraKey(make="DJI", model="FC6310R", focal_mm=8.8, image_size=(5472, 3648))
MODEL = "dji/fc6310r"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registry and its publication, to copy."""
    folder = tmp_path_factory.mktemp("made")
    commit(folder / "fleet", *FLEET)
    dated(folder / "fleet")
    packed(folder / "fleet")
    published(folder / "fleet", folder / "out")
    return folder


@pytest.fixture
def place(made: Path, tmp_path: Path) -> Path:
    """A registry in fleet/ and its publication in out/."""
    shutil.copytree(made, tmp_path / "place")
    return tmp_path / "place"


@pytest.fixture
def server(place: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setattr(read, "PAUSES_S", (0.0, 0.0, 0.0))
    with serving(place / "out") as server:
        yield server


@pytest.fixture
def cache(tmp_path: Path) -> Cache:
    return Cache(tmp_path / "cache")


def fx(registry: Published, key: CameraKey = P4R, on: date | None = None) -> float | None:
    found = registry.index_for(key).resolve(key, on=on)
    return found.calibration.intrinsics.fx if found is not None else None


KEYS = [
    P4R,
    replace(P4R, serial=UNIT),
    replace(P4R, serial="00" * 8),
    replace(P4R, firmware="01.10"),
    replace(P4R, image_size=(2736, 1824)),
    replace(P4R, image_size=(4864, 3648)),
    replace(P4R, capture_mode="dewarped"),
    replace(P4R, model="FC330", image_size=(4000, 3000)),
    replace(P4R, make="other", model="P4  RTK"),
    replace(P4R, make="Bild & Flug", model="WEISS/KAMERA"),
    replace(P4R, model="DATED"),
    replace(P4R, model="DRAFT"),
    replace(P4R, model="FC9"),
    CameraKey(make="DJI"),
]


def test_it_answers_as_the_registry_does(made: Path, cache: Cache) -> None:
    own = open_snapshot(made / "fleet").index()
    drafts = {entry.path for entry in FLEET if entry.status.value == "draft"}
    with serving(made / "out") as untouched:
        for key in KEYS:
            other = Published(untouched.url, cache=cache).index_for(key)
            assert other.is_dated(key) == own.is_dated(key)
            for day in (None, date(2025, 1, 1), date(2026, 5, 5), date(2026, 10, 1)):
                assert other.resolve(key, on=day) == own.resolve(key, on=day), (key, day)
                near = tuple(one for one in own.near(key, on=day) if one.path not in drafts)
                assert other.near(key, on=day) == near, (key, day)


def test_a_camera_costs_few_files_and_the_next_time_one_question(
    place: Path, server: Server, cache: Cache
) -> None:
    first = Published(server.url, cache=cache)
    assert fx(first) == 3661.25
    assert fx(first, replace(P4R, serial=UNIT)) == 3655.5
    out = place / "out"
    cameras = [camera(out, name) for name in (MODEL, f"{MODEL}/sn-{UNIT}")]
    files = [out / PUBLISHED_FILE, out / f"data/{manifest(out)['cameras']}.json", *cameras]
    assert server.paths == [file.relative_to(out).as_posix() for file in files]
    again = Published(server.url, cache=cache)
    assert fx(again, replace(P4R, serial=UNIT)) == 3655.5
    assert server.asked == [(PUBLISHED_FILE, 200)]
    assert (again.warnings, again.commit) == ((), first.commit)


def test_what_is_not_there_is_known_without_asking(server: Server, cache: Cache) -> None:
    assert fx(Published(server.url, cache=cache), CameraKey(make="DJI", model="FC9")) is None
    assert len(server.paths) == 2


def test_of_many_cameras_only_the_one_is_read(tmp_path: Path, cache: Cache) -> None:
    commit(tmp_path / "fleet", *(an_entry(model=f"M {number}", fx=3000.0 + number) for number in range(300)))
    published(tmp_path / "fleet", tmp_path / "out")
    with serving(tmp_path / "out") as server:
        registry = Published(server.url, cache=cache)
        assert [fx(registry, replace(P4R, model=f"m {number}")) for number in (0, 150, 299)] == [
            3000,
            3150,
            3299,
        ]
        assert fx(registry, replace(P4R, model="M 300")) is None
        assert len(server.paths) == 2 + 3


class TestDamage:
    @pytest.mark.parametrize("kind", ["corrupt", "cut", "html", "missing"])
    @pytest.mark.parametrize("what", ["camera", "list"])
    def test_a_file_that_is_not_vouched_for_is_refused(
        self, place: Path, server: Server, cache: Cache, what: str, kind: str
    ) -> None:
        out = place / "out"
        file = camera(out, MODEL) if what == "camera" else out / f"data/{manifest(out)['cameras']}.json"
        data = file.read_bytes()
        damaged = {"corrupt": data.replace(b"fc6310r", b"fc6310s"), "cut": data[:100], "html": b"<html>"}
        if kind == "missing":
            file.unlink()
        else:
            file.write_bytes(damaged[kind])
        with pytest.raises(RegistryError, match=file.name) as raised:
            fx(Published(server.url, cache=cache))
        assert "damaged on the server or on the way" in str(raised.value)
        assert "\n" not in str(raised.value)
        file.write_bytes(data)
        assert fx(Published(server.url, cache=cache)) == 3661.25

    def test_one_that_was_damaged_on_the_way_is_read_again(
        self, place: Path, server: Server, cache: Cache
    ) -> None:
        path = camera(place / "out", MODEL).relative_to(place / "out").as_posix()
        cut = Answer(200, b'{"schema"', {"Content-Length": "4000"})
        server.faults[path] = [Answer(200, b"{}"), cut, Answer(404)]
        assert fx(Published(server.url, cache=cache)) == 3661.25

    @pytest.mark.parametrize(
        ("body", "expected"),
        [
            (b"<html>please log in</html>", "this is no manifest"),
            (b'{"manifest"', "this is no manifest"),
            (b"{}", "this is no manifest"),
            (b"\xff\xfe", "this is no manifest"),
            (b"{" + b" " * (6 << 20), "is longer than"),
        ],
    )
    def test_a_manifest_that_is_none_is_an_error_of_one_line(
        self, server: Server, cache: Cache, body: bytes, expected: str
    ) -> None:
        server.faults[PUBLISHED_FILE] = [Answer(200, body)]
        with pytest.raises(RegistryError, match=expected) as raised:
            Published(server.url, cache=cache)
        assert "\n" not in str(raised.value)

    def test_an_address_without_a_registry_says_so(self, server: Server, cache: Cache) -> None:
        with pytest.raises(RegistryError, match="no published registry here, expected calibrary-manifest"):
            Published(f"{server.url}nowhere", cache=cache)

    def test_a_damaged_cache_is_read_again(self, server: Server, cache: Cache) -> None:
        fx(Published(server.url, cache=cache))
        for file in (cache.folder / "files").rglob("*"):
            if file.is_file():
                file.write_bytes(file.read_bytes()[:-7] + b"garbage")
        server.asked.clear()
        assert fx(Published(server.url, cache=cache)) == 3661.25
        assert len(server.paths) == 3

    def test_a_cache_that_cannot_be_written_only_takes_longer(self, server: Server, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("")
        assert fx(Published(server.url, cache=Cache(tmp_path / "file/cache"))) == 3661.25


class TestPublishedInBetween:
    def test_a_manifest_that_changes_before_the_camera_s_file_is_read_is_read_again(
        self, place: Path, server: Server, cache: Cache
    ) -> None:
        registry = Published(server.url, cache=cache)
        commit(place / "fleet", an_entry(focal_mm=None, fx=3670.0))
        published(place / "fleet", place / "out")
        assert fx(registry) == 3670.0
        assert registry.commit == open_snapshot(place / "fleet").commit

    def test_a_file_that_is_removed_while_it_is_read_too(
        self, place: Path, server: Server, cache: Cache
    ) -> None:
        commit(place / "fleet", an_entry(focal_mm=None, fx=3670.0))

        def publish_before_the_first_file(path: str) -> None:
            if path.startswith("data"):
                server.before = lambda _: None
                published(place / "fleet", place / "out")

        server.before = publish_before_the_first_file
        assert fx(Published(server.url, cache=cache)) == 3670.0

    def test_a_half_done_upload_is_the_former_state(self, place: Path, server: Server, cache: Cache) -> None:
        former = (place / "out" / PUBLISHED_FILE).read_bytes()
        shutil.copytree(place / "out/data", place / "former")
        commit(place / "fleet", an_entry(focal_mm=None, fx=3670.0))
        published(place / "fleet", place / "out")
        (place / "out" / PUBLISHED_FILE).write_bytes(former)
        shutil.copytree(place / "former", place / "out/data", dirs_exist_ok=True)
        assert fx(Published(server.url, cache=cache)) == 3661.25

    def test_a_reader_keeps_to_one_state_while_nothing_it_needs_changes(
        self, place: Path, server: Server, cache: Cache
    ) -> None:
        registry = Published(server.url, cache=cache)
        assert fx(registry) == 3661.25
        commit(place / "fleet", an_entry(focal_mm=None, fx=3670.0))
        published(place / "fleet", place / "out")
        assert fx(registry) == 3661.25
        assert fx(Published(server.url, cache=cache)) == 3670.0


class TestOffline:
    def test_what_was_read_before_answers_and_its_age_is_told(
        self, server: Server, cache: Cache, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        fx(Published(server.url, cache=cache))
        long_ago = time.time() - 73 * 3600
        os.utime(cache.trusted(server.url), (long_ago, long_ago))
        monkeypatch.setattr(transport, "TIMEOUT_S", 1.0)
        server.faults[PUBLISHED_FILE] = [Answer(status) for status in (500, 503, 429)]
        for _ in range(3):
            registry = Published(server.url, cache=cache)
            assert fx(registry) == 3661.25
            [warning] = registry.warnings
            assert "the server answers" in warning
            assert f"the copy in the cache of {datetime.fromtimestamp(long_ago, UTC):%Y-%m-%d}" in warning

    def test_without_a_server_too(self, place: Path, cache: Cache) -> None:
        with serving(place / "out") as server:
            fx(Published(server.url, cache=cache))
        registry = Published(server.url, cache=cache)
        assert fx(registry) == 3661.25
        assert "Connection refused" in registry.warnings[0]
        with pytest.raises(RegistryError, match="it is not in the cache"):
            fx(registry, replace(P4R, model="FC330"))

    def test_what_was_never_read_is_an_error(self, place: Path, cache: Cache) -> None:
        with serving(place / "out") as server:
            pass
        with pytest.raises(RegistryError, match="cannot be reached: Connection refused"):
            Published(server.url, cache=cache)

    def test_a_server_that_says_there_is_none_is_believed(self, server: Server, cache: Cache) -> None:
        Published(server.url, cache=cache)
        server.faults[PUBLISHED_FILE] = [Answer(404)] * 8
        with pytest.raises(RegistryError, match="the server answers 404"):
            Published(server.url, cache=cache)

    def test_a_server_that_says_nothing_is_given_up(
        self, server: Server, cache: Cache, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(transport, "TIMEOUT_S", 0.05)
        server.before = lambda _: __import__("time").sleep(0.4)
        with pytest.raises(RegistryError, match=r"no answer within 0\.05 s"):
            Published(server.url, cache=cache)


class TestAddresses:
    @pytest.mark.parametrize(
        ("address", "printed"),
        [
            ("http://example.com/cameras", "expected https:"),
            ("https://ada:secret@example.com/", "password"),
            ("https://ada:secret@example.com/?token=secret", "expected https://HOST/FOLDER/"),
            ("https://", "expected https://HOST/FOLDER/"),
            ("https://[::1", "expected https://HOST/FOLDER/"),
        ],
    )
    def test_what_is_not_read_is_refused(self, address: str, printed: str) -> None:
        with pytest.raises(RegistryError, match=printed) as raised:
            normalised(address)
        assert "secret" not in str(raised.value)

    def test_a_plain_connection_is_read_where_it_is_allowed(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("CALIBRARY_ALLOW_HTTP", "1")
        assert normalised("HTTP://Example.com/Cameras/") == "http://example.com/Cameras/"
        monkeypatch.delenv("CALIBRARY_ALLOW_HTTP")
        assert normalised("http://localhost:8000") == "http://localhost:8000/"

    @pytest.mark.parametrize(
        "target", ["file:///etc/passwd", "ftp://127.0.0.1/x", "http://example.com/x", "https://x/"]
    )
    def test_no_redirect_leads_to_another_scheme_or_elsewhere_in_clear(
        self, server: Server, cache: Cache, target: str
    ) -> None:
        server.faults[PUBLISHED_FILE] = [Answer(302, b"", {"Location": target})]
        with pytest.raises(RegistryError, match=r"not followed|not allowed"):
            Published(server.url, cache=cache)

    def test_others_are_followed_but_not_for_ever(self, place: Path, server: Server, cache: Cache) -> None:
        shutil.copytree(place / "out", place / "out/v1")
        server.faults[PUBLISHED_FILE] = [Answer(301, b"", {"Location": f"{server.url}v1/{PUBLISHED_FILE}"})]
        assert fx(Published(server.url, cache=cache)) == 3661.25
        again = Answer(301, b"", {"Location": f"{server.url}{PUBLISHED_FILE}"})
        server.faults[PUBLISHED_FILE] = [again] * transport.MOST_REDIRECTS
        assert fx(Published(server.url, cache=Cache(place / "patient"))) == 3661.25
        server.faults[PUBLISHED_FILE] = [again] * (transport.MOST_REDIRECTS + 1)
        with pytest.raises(RegistryError, match="301"):
            Published(server.url, cache=Cache(place / "cache"))
