"""Images behind a web server: the same K as of the same files here, in few requests, whatever the server does."""

from __future__ import annotations

import io
import json
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Literal, cast

import numpy as np
import pytest

from calibrary.cli.main import main
from calibrary.errors import InputError
from calibrary.jobs.extract.run import run
from calibrary.jobs.images import ranged
from calibrary.jobs.images.observation import Image
from calibrary.jobs.images.places import shown
from calibrary.jobs.images.ranged import FIRST, Ranged, StoreError
from calibrary.jobs.images.reading import Question, Unit, here, read_images, read_unit
from calibrary.parsers.imagery import read_metadata
from calibrary.parsers.imagery.reader import read_source
from calibrary.parsers.imagery.source import Source
from calibrary.records import to_json
from tests.imagery import write_tiff
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, gate, picture
from tests.jobs.images.servers import Site, site


@pytest.fixture
def server() -> Iterator[Site]:
    with site() as found:
        yield found


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Attempts are made again without waiting."""
    monkeypatch.setattr(ranged, "WAITS_S", (0.0, 0.0, 0.0))


@pytest.fixture
def flight(tmp_path: Path, server: Site) -> Path:
    folder = tmp_path / "flight"
    for number in range(12):
        tags = P4R if number % 3 else NOBODY
        path = picture(folder / f"{number:02}.jpg", dewarp=DEWARP if number % 2 else None, **tags)
        server.files[f"day/{path.name}"] = path.read_bytes()
    return folder


def listed(server: Site) -> list[str]:
    return [f"{server.url}/{path}" for path in server.files]


def rows(server: Site, path: str) -> dict[str, str]:
    """The reasons for which images cannot be read, one good one beside the one in question."""
    outcome = gate_lines([f"{server.url}/{path}"])
    return {row.name.rpartition("/")[2]: row.reason for row in outcome.rejected}


def gate_lines(lines: list[str], **request: Any) -> Any:
    return run(lines=lines, **request)


def test_k_is_that_of_the_same_files_here(flight: Path, server: Site) -> None:
    far, near = gate_lines(listed(server)), gate(flight)
    assert [c.calibration and c.calibration.intrinsics for c in far.judged] == [
        c.calibration and c.calibration.intrinsics for c in near.judged
    ]
    assert [c.camera.names for c in far.judged] == [
        tuple(f"{server.url}/day/{name}" for name in c.camera.names) for c in near.judged
    ]
    assert set(server.requests.values()) == {1}
    assert max(server.sent.values()) <= FIRST


def test_a_folder_and_a_list_of_urls_are_one_run(flight: Path, server: Site, tmp_path: Path) -> None:
    names = tmp_path / "list.txt"
    names.write_text("# both\n\n" + "\n".join([*listed(server), str(flight)]) + "\n")
    assert main(["extract", "--from", str(names), "--dry-run", "--json"]) in {0, 1}
    outcome = gate_lines(names.read_text().splitlines(keepends=True))
    assert outcome.images == 24


def test_standard_input_is_a_list(
    flight: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{flight}/00.jpg\n{flight}/00.jpg\n{flight}/03.jpg\n"))
    main(["extract", "--from", "-", "--dry-run", "--json"])
    assert json.loads(capsys.readouterr().out)["images"] == 2


def test_a_list_that_is_not_there_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["extract", "--from", "/nowhere/list.txt", "--dry-run"]) == 3
    assert "/nowhere/list.txt: cannot be read: No such file" in capsys.readouterr().err


@pytest.mark.usefixtures("at_once", "flight")
class TestFailures:
    @pytest.mark.parametrize(
        ("fault", "said", "requests"),
        [(403, "access is denied (HTTP 403)", 1), (404, "is not there (HTTP 404)", 1), (410, "any more", 1)],
    )
    def test_what_will_not_pass_is_a_row_at_once(
        self, server: Site, fault: int, said: str, requests: int
    ) -> None:
        server.faults["day/01.jpg"] = [fault] * 9
        assert said in rows(server, "day/01.jpg")["01.jpg"]
        assert server.requests["day/01.jpg"] == requests

    @pytest.mark.parametrize("fault", [500, 503, 429, "cut"])
    def test_what_may_pass_is_tried_again(self, server: Site, fault: int | str) -> None:
        server.faults["day/01.jpg"] = [fault] * 3
        assert rows(server, "day/01.jpg") == {}
        assert server.requests["day/01.jpg"] == 4
        server.faults["day/01.jpg"] = [fault] * 4
        assert len(rows(server, "day/01.jpg")) == 1

    def test_the_waits_between_attempts_grow(self, monkeypatch: pytest.MonkeyPatch) -> None:
        waited: list[float] = []
        monkeypatch.setattr(time, "sleep", waited.append)
        with pytest.raises(StoreError, match="x"):
            ranged.patiently(lambda: (_ for _ in ()).throw(StoreError("x", passing=True)))
        assert waited == sorted(waited) == list(ranged.WAITS_S)
        assert len(waited) == 3

    def test_a_server_that_is_gone_is_a_row(self) -> None:
        outcome = gate_lines(["http://127.0.0.1:9/a.jpg"])
        assert "cannot be read: Connection refused" in outcome.rejected[0].reason

    def test_an_image_that_changes_while_it_is_read_is_a_row(self, tmp_path: Path, server: Site) -> None:
        server.files["a.tif"] = _tiff_with_its_directory_last(tmp_path)
        server.faults["a.tif"] = [0, "changed"]
        server.faults["a.tif"][0] = "none"
        assert "was changed while it was read" in rows(server, "a.tif")["a.tif"]

    def test_a_server_without_ranges_sends_small_files_whole(self, server: Site) -> None:
        server.ranges = False
        assert rows(server, "day/01.jpg") == {}
        server.files["long.jpg"] = server.files["day/01.jpg"] + bytes(9 << 20)
        assert "sends no ranges" in rows(server, "long.jpg")["long.jpg"]

    def test_an_empty_file_is_a_row(self, server: Site) -> None:
        server.files["a.jpg"] = b""
        assert "is empty" in rows(server, "a.jpg")["a.jpg"]


def _tiff_with_its_directory_last(tmp_path: Path) -> bytes:
    """A TIFF of three megabytes with its directory behind its pixels."""
    data = write_tiff(tmp_path / "a.tif", (64, 48)).read_bytes()
    pixels = 3 << 20
    # Offsets count from the header: a second header in front moves nothing but the first directory's place.
    order: Literal["little", "big"] = "little" if data[:2] == b"II" else "big"
    body = bytearray(pixels) + data
    return bytes(data[:4]) + (pixels + _first_directory(data)).to_bytes(4, order) + bytes(body[8:])


def _first_directory(data: bytes) -> int:
    return int.from_bytes(data[4:8], "little" if data[:2] == b"II" else "big")


@pytest.mark.usefixtures("at_once", "flight")
class TestPrivacy:
    def test_credentials_go_to_the_server_and_nowhere_else(
        self, server: Site, caplog: pytest.LogCaptureFixture
    ) -> None:
        host = server.url.removeprefix("http://")
        server.faults["day/02.jpg"] = [503] * 2
        caplog.set_level("DEBUG")
        outcome = gate_lines(
            [f"http://pilot:geheim@{host}/day/0{n}.jpg?X-Amz-Signature=abc{n}" for n in (1, 2, 99)]
        )
        printed = json.dumps(to_json(outcome)) + caplog.text
        assert "geheim" not in printed
        assert "Signature" not in printed
        assert server.credentials == {"Basic cGlsb3Q6Z2VoZWlt"}

    def test_a_redirect_takes_no_credentials_along(self, server: Site) -> None:
        with site() as other:
            other.files["b.jpg"] = server.files["day/01.jpg"]
            server.faults["day/01.jpg"] = [f"{other.url}/b.jpg"]
            host = server.url.removeprefix("http://")
            assert gate_lines([f"http://pilot:geheim@{host}/day/01.jpg"]).rejected == ()
            assert other.credentials == {None}

    def test_a_url_is_shown_without_them(self) -> None:
        assert shown("https://u:p@host:8/a%20b.jpg?sig=1#x") == "https://host:8/a%20b.jpg"
        assert shown("s3://bucket/a?b#c.jpg") == "s3://bucket/a?b#c.jpg"


class TestRanges:
    def read(self, data: bytes) -> tuple[Any, list[int]]:
        sizes = []

        def fetch(start: int, end: int) -> bytes:
            sizes.append(end - start)
            return data[start:end]

        file = Ranged(fetch, data[:FIRST], len(data))
        return read_source(Source(cast("BinaryIO", file), name="a", size=len(data))), sizes

    def test_a_directory_at_the_end_takes_one_request_more(self, tmp_path: Path) -> None:
        data = _tiff_with_its_directory_last(tmp_path)
        metadata, sizes = self.read(data)
        (tmp_path / "b.tif").write_bytes(data)
        assert metadata == read_metadata(tmp_path / "b.tif")
        assert len(sizes) == 1
        assert sizes[0] <= ranged.TAIL

    def test_segments_of_a_thermal_image_take_few_requests(self, tmp_path: Path) -> None:
        plain = picture(tmp_path / "a.jpg", (64, 48), **P4R).read_bytes()
        segment = b"\xff\xe3\xff\xff" + bytes(65533)
        thermal = plain[:2] + segment * 40 + plain[2:]
        (tmp_path / "b.jpg").write_bytes(thermal)
        metadata, sizes = self.read(thermal)
        assert metadata == read_metadata(tmp_path / "b.jpg")
        assert len(sizes) <= 7

    def test_any_pattern_of_reads_gives_the_files_bytes(self) -> None:
        random = np.random.default_rng(3)
        data = random.bytes(3 << 20)
        for _ in range(30):
            file = Ranged(lambda start, end: data[start:end], data[:FIRST], len(data))
            for _ in range(20):
                at, size = int(random.integers(len(data) + 10)), int(random.choice([1, 4, 100, 70_000]))
                file.seek(at)
                assert file.read(size) == data[at : at + size]


@pytest.mark.usefixtures("flight")
def test_waiting_for_answers_is_done_side_by_side(server: Site) -> None:
    server.delay_s = 0.02
    images = tuple(Image(str(n), f"{server.url}/day/{n % 12:02}.jpg?{n}") for n in range(320))

    def seconds(count: int, at_once: int, monkeypatch: pytest.MonkeyPatch) -> float:
        monkeypatch.setattr("calibrary.jobs.images.reading.AT_ONCE", at_once)
        start = time.perf_counter()
        read_unit(Unit(images[:count]), question=Question())
        return (time.perf_counter() - start) / count

    with pytest.MonkeyPatch.context() as monkeypatch:
        alone, together = seconds(20, 1, monkeypatch), seconds(320, 32, monkeypatch)
    # Ten times on an idle machine (docs/performance.md); a busy one has other things to do than to wait.
    assert together < alone / 3


@pytest.mark.usefixtures("flight")
def test_several_processes_read_from_a_server(server: Site) -> None:
    images = [Image(str(n), url) for n, url in enumerate(listed(server) * 12)]
    one = read_images(images, engine=here(1, known=None)).images
    two = read_images(images, engine=here(2, known=None)).images
    assert one.to_bytes() == two.to_bytes()


def test_a_scheme_that_nothing_knows_is_told() -> None:
    outcome = gate_lines(["nowhere://host/a.jpg"])
    assert "nowhere:// is not a store that can be read" in outcome.rejected[0].reason
    with pytest.raises(InputError, match="not a store"):
        gate_lines(["nowhere://host/folder"])


def test_without_the_extra_the_command_that_brings_it_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("calibrary.extras.find_spec", lambda _: None)
    assert main(["extract", "s3://bucket-that-was-never-asked-for/flight/", "--dry-run"]) == 2
    assert 'pip install "calibrary[remote]"' in capsys.readouterr().err


class TestArchives:
    @pytest.fixture
    def archive(self, flight: Path, server: Site) -> str:
        """The flight as a zip file on the server, stored and deflated members in turn, much longer than is fetched."""
        made = io.BytesIO()
        with zipfile.ZipFile(made, "w") as archive:
            for number, path in enumerate(sorted(flight.iterdir())):
                kind = zipfile.ZIP_DEFLATED if number % 2 else zipfile.ZIP_STORED
                archive.writestr(f"day/{path.name}", path.read_bytes(), kind)
                archive.writestr(f"raw/{number}.bin", bytes(2 << 20))
            archive.writestr("day/.hidden.jpg", b"no image")
        server.files = {"flight.zip": made.getvalue()}
        return f"{server.url}/flight.zip"

    @pytest.mark.parametrize("scheme", ["", "zip://"])
    def test_a_zip_file_is_read_by_ranges(
        self, archive: str, scheme: str, flight: Path, server: Site
    ) -> None:
        far, near = run(scheme + archive), gate(flight)
        assert [c.calibration and c.calibration.intrinsics for c in far.judged] == [
            c.calibration and c.calibration.intrinsics for c in near.judged
        ]
        assert [c.camera.names for c in far.judged] == [
            tuple(f"day/{name}" for name in c.camera.names) for c in near.judged
        ]
        # The end with the directory, and one range an image: not the 24 MB between them.
        assert server.requests["flight.zip"] <= 2 + 12
        assert server.sent["flight.zip"] < len(server.files["flight.zip"]) / 10

    def test_its_images_have_its_name_in_a_list_and_no_credentials(self, archive: str) -> None:
        outcome = gate_lines([archive.replace("http://", "http://pilot:geheim@") + "?sig=1", archive])
        names = [name for one in outcome.judged for name in one.camera.names]
        assert all(name.startswith(f"{archive}/day/") for name in names)

    def test_one_that_is_changed_or_damaged_is_told(self, archive: str, server: Site) -> None:
        server.faults["flight.zip"] = ["none", "none", *["changed"] * 40]
        [row, *_] = run(archive).rejected
        assert "was changed while it was read" in row.reason
        server.files["other.zip"] = b"no zip file"
        with pytest.raises(InputError, match=r"other\.zip: cannot be read: is not a zip file"):
            run(f"{server.url}/other.zip")
        with pytest.raises(InputError, match=r"gone\.zip: cannot be read: is not there"):
            run(f"{server.url}/gone.zip")

    @pytest.mark.parametrize("name", ["flight.tar", "flight.tar.gz", "flight.tgz"])
    def test_a_tar_file_there_is_refused_with_what_to_do(self, server: Site, name: str) -> None:
        with pytest.raises(InputError, match=rf"{name}: is a tar file.*make it a zip file"):
            run(f"{server.url}/{name}")
