"""``convert`` into the cameras of a COLMAP database, which COLMAP's own library made and reads."""

from __future__ import annotations

import json
import signal
import sqlite3
import threading
from contextlib import closing
from pathlib import Path

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics
from calibrary.cli.main import main
from calibrary.distortion import BrownConrady, InverseBrown
from calibrary.errors import InputError
from calibrary.interop import colmap_database
from calibrary.interop.colmap_database import change_of, read_database, write_database
from calibrary.jobs.convert.run import write_into_database
from calibrary.parsers.format import Fidelity
from calibrary.provenance import Provenance
from calibrary.records import replace
from calibrary.schemas import require

pycolmap = pytest.importorskip("pycolmap")

SIZE = (4000, 3000)
LENS = BrownConrady(k1=-0.11, k2=0.02, p1=0.001, p2=-0.002)


def camera(
    fx: float = 3100.5, size: tuple[int, int] = SIZE, grade: Grade = Grade.CALIBRATED, *, number: int = 0
) -> Calibration:
    tag, name = (f"camera {number}", str(number)) if number else (None, None)
    return Calibration(
        camera=CameraKey(image_size=size, sub_camera=name),
        intrinsics=Intrinsics(fx=fx, fy=fx + 2, cx=size[0] / 2 + 7.25, cy=size[1] / 2 - 3.5, image_size=size),
        distortion=LENS,
        grade=grade,
        provenance=Provenance(kind="calibration-file", source="test", tag=tag),
    )


def database(path: Path, *sizes: tuple[int, int]) -> Path:
    """As feature_extractor leaves it: an image for each camera, the focal lengths guessed."""
    with pycolmap.Database.open(path) as opened:
        for number, (width, height) in enumerate(sizes, start=1):
            params = [1.2 * max(width, height), width / 2, height / 2, 0]
            row = pycolmap.Camera(model="SIMPLE_RADIAL", width=width, height=height, params=params)
            row.camera_id = number
            opened.write_camera(row, use_camera_id=True)
            opened.write_image(pycolmap.Image(name=f"{number}.jpg", camera_id=number))
    return path


def stored(path: Path) -> dict[str, tuple[int, str, list[float], bool]]:
    """Camera number, model, parameters and whether the focal length is known of each image, as COLMAP reads them."""
    with pycolmap.Database.open(path) as opened:
        cameras = {one.camera_id: one for one in opened.read_all_cameras()}
        found = {image.name: cameras[image.camera_id] for image in opened.read_all_images()}
    return {
        name: (
            one.camera_id,
            one.model.name,
            [float(value) for value in one.params],
            one.has_prior_focal_length,
        )
        for name, one in found.items()
    }


def rows(path: Path) -> list[tuple[object, ...]]:
    with closing(sqlite3.connect(path)) as connection:
        return connection.execute("SELECT * FROM cameras ORDER BY camera_id").fetchall()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    parsers.write([camera()], tmp_path / "camera.yml", "opencv_storage")
    return tmp_path


def convert(folder: Path, *flags: str, source: str = "camera.yml") -> int:
    return main(["convert", str(folder / source), str(folder / "database.db"), *flags])


def test_the_one_camera_of_that_size_gets_the_calibration(folder: Path) -> None:
    path = database(folder / "database.db", (640, 480), SIZE)
    before = stored(path)
    assert convert(folder) == 0
    after = stored(path)
    assert after["1.jpg"] == before["1.jpg"]
    number, model, params, known = after["2.jpg"]
    assert (number, model, known) == (2, "OPENCV", True)
    K = camera().intrinsics
    assert params == pytest.approx([K.fx, K.fy, K.cx, K.cy, *list(LENS.coefficients.values())[:4]], abs=1e-9)


def test_the_database_reads_back_as_what_was_written(folder: Path) -> None:
    database(folder / "database.db", SIZE)
    assert convert(folder) == 0
    [back] = parsers.read(folder / "database.db")
    assert back.grade is Grade.ADJUSTED
    assert dict(back.extras)["colmap/prior_focal_length"] == "1"
    assert back.intrinsics.fx == pytest.approx(3100.5, abs=1e-9)
    assert back.distortion == LENS


def test_which_of_several_cameras_is_asked_for(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = database(folder / "database.db", SIZE, SIZE, SIZE)
    before = rows(path)
    assert convert(folder) == 3
    said = " ".join(capsys.readouterr().err.split())
    assert "3 of its cameras (1, 2, 3) have images of 4000×3000" in said
    assert "--into all" in said
    assert rows(path) == before
    assert [item.name for item in folder.glob("*.sql")] == []
    assert convert(folder, "--into", "1,3") == 0
    found = stored(path)
    assert [found[f"{number}.jpg"][1] for number in (1, 2, 3)] == ["OPENCV", "SIMPLE_RADIAL", "OPENCV"]
    assert convert(folder, "--into", "all") == 0
    assert {one[1] for one in stored(path).values()} == {"OPENCV"}


def test_cameras_of_colmaps_own_file_go_by_their_numbers(folder: Path) -> None:
    path = database(folder / "database.db", SIZE, SIZE)
    parsers.write([camera(2900, number=2), camera(3300, number=1)], folder / "cameras.txt", "colmap_text")
    assert convert(folder, source="cameras.txt") == 0
    found = stored(path)
    assert [found["1.jpg"][2][0], found["2.jpg"][2][0]] == [3300, 2900]


def test_every_run_keeps_what_it_found(folder: Path) -> None:
    path = database(folder / "database.db", SIZE)
    first = rows(path)
    assert convert(folder) == 0
    second = rows(path)
    parsers.write([camera(3000)], folder / "camera.yml", "opencv_storage")
    assert convert(folder) == 0
    for backup, wanted in (("database.db.before-2.sql", second), ("database.db.before.sql", first)):
        with closing(sqlite3.connect(path)) as connection:
            connection.executescript((folder / backup).read_text())
        assert rows(path) == wanted


def test_a_prior_is_written_on_request_and_as_one_that_colmap_refines(folder: Path) -> None:
    path = database(folder / "database.db", SIZE)
    params = [1.2 * SIZE[0], SIZE[0] / 2, SIZE[1] / 2, 0]
    seed = folder / "cameras.db"
    database(seed, SIZE)
    assert parsers.read(seed)[0].grade is Grade.SEED
    assert convert(folder, source="cameras.db") == 3
    assert convert(folder, "--allow-prior", source="cameras.db") == 0
    assert stored(path)["1.jpg"] == (1, "SIMPLE_RADIAL", params, False)


@pytest.mark.parametrize(
    ("sizes", "flags", "said"),
    [
        ([(640, 480)], (), "has images of 4000×3000, as the calibration; it has 640×480"),
        ([(640, 480)], ("--into", "1"), "its camera 1 has images of 640×480"),
        ([SIZE], ("--into", "7"), "it has no camera 7; it has 1"),
    ],
)
def test_what_cannot_be_meant_is_refused(
    folder: Path,
    sizes: list[tuple[int, int]],
    flags: tuple[str, ...],
    said: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    before = rows(database(folder / "database.db", *sizes))
    assert convert(folder, *flags) == 3
    assert said in " ".join(capsys.readouterr().err.split())
    assert rows(folder / "database.db") == before


def test_no_database_is_made(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert convert(folder) == 3
    assert "run 'colmap feature_extractor' first" in capsys.readouterr().err
    assert not (folder / "database.db").exists()


def test_another_program_that_changed_it_meanwhile_wins(folder: Path) -> None:
    path = database(folder / "database.db", SIZE)
    change = change_of(path, read_database(path), {1: camera().to_colmap()})
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE cameras SET prior_focal_length = 1")
    before = rows(path)
    with pytest.raises(InputError, match="another program changed"):
        write_database(change)
    assert rows(path) == before


def test_into_is_for_databases_only(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(
            [
                "convert",
                str(folder / "camera.yml"),
                str(folder / "cameras.txt"),
                "--to",
                "colmap_text",
                "--into",
                "1",
            ]
        )
        == 2
    )
    assert "--into" in capsys.readouterr().err


def test_machines_are_told_what_was_changed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    database(folder / "database.db", SIZE)
    assert convert(folder, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    require(document, "convert-2")
    [written] = document["files"]
    assert (written["into"], written["backup"]) == ([1], "database.db.before.sql")


def test_a_lens_that_colmap_lacks_is_refitted_and_measured(folder: Path) -> None:
    path = database(folder / "database.db", SIZE)
    original = replace(camera(), distortion=InverseBrown(k1=0.02, k2=0.001, p1=0.0, p2=0.0))
    verdict, _, _ = write_into_database([original], path)
    assert verdict.outcome is Fidelity.REFITTED
    assert 0 < verdict.max_px < 0.05
    assert stored(path)["1.jpg"][1] in {"OPENCV", "FULL_OPENCV"}


ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT max(i) AS camera_id FROM n"


@pytest.mark.parametrize(
    ("kind", "sql"),
    [
        ("trigger", f"CREATE TRIGGER endless BEFORE UPDATE ON cameras BEGIN {ENDLESS}; END"),
        ("view", f"CREATE VIEW endless AS {ENDLESS}"),
    ],
)
def test_a_database_with_a_trigger_or_a_view_is_refused_and_stays(
    folder: Path, kind: str, sql: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = database(folder / "database.db", SIZE)
    with closing(sqlite3.connect(path)) as connection:
        connection.execute(sql)
    before = path.read_bytes()
    assert main(["convert", str(folder / "camera.yml"), str(path), "--to", "colmap_database"]) == 3
    assert f"it contains the {kind} 'endless'" in capsys.readouterr().err
    assert path.read_bytes() == before
    assert not list(folder.glob("*.sql"))


def test_a_statement_ends_with_the_signal(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python hears a signal only between statements; SQLite asks while one runs."""
    path = database(folder / "database.db", SIZE)
    monkeypatch.setattr(colmap_database, "CAMERAS", ENDLESS)
    timer = threading.Timer(0.2, signal.raise_signal, [signal.SIGINT])
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        read_database(path)
    timer.join()
