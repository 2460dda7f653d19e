"""Cameras written into a COLMAP database, which COLMAP's own library made and reads."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from calibrary.cli.main import main
from calibrary.jobs.extract.targets import RESTORE
from tests.jobs.extract.fleet import DEWARP, P4R, picture

pycolmap = pytest.importorskip("pycolmap")

FIRST = ("a.jpg", "b.jpg")
SECOND = ("z.jpg",)


def database(path: Path, *groups: tuple[str, ...], size: tuple[int, int] = (5472, 3648)) -> Path:
    """As feature_extractor leaves it: a camera for each group of images, its focal length a guess."""
    with pycolmap.Database.open(path) as opened:
        for number, names in enumerate(groups, start=1):
            camera = pycolmap.Camera(
                model="SIMPLE_RADIAL",
                width=size[0],
                height=size[1],
                params=[6566.4, size[0] / 2, size[1] / 2, 0],
            )
            camera.camera_id = number
            opened.write_camera(camera, use_camera_id=True)
            for name in names:
                opened.write_image(pycolmap.Image(name=name, camera_id=number))
    return path


def read(path: Path) -> dict[str, tuple[str, list[float], bool]]:
    """Model, parameters and whether the focal length is known, of each image, by COLMAP's own library."""
    with pycolmap.Database.open(path) as opened:
        cameras = {camera.camera_id: camera for camera in opened.read_all_cameras()}
        found = {image.name: cameras[image.camera_id] for image in opened.read_all_images()}
    return {
        name: (one.model.name, [float(value) for value in one.params], one.has_prior_focal_length)
        for name, one in found.items()
    }


def rows(path: Path) -> list[tuple[object, ...]]:
    with closing(sqlite3.connect(path)) as connection:
        return connection.execute("SELECT * FROM cameras ORDER BY camera_id").fetchall()


@pytest.fixture
def flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two units: one with its calibration, one without."""
    for name in FIRST:
        picture(tmp_path / "flight" / name, **P4R, dewarp=DEWARP, body_serial="1")
    for name in SECOND:
        picture(tmp_path / "flight" / name, **P4R, body_serial="2")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def extract(*flags: str) -> int:
    return main(["extract", "flight", "--to", "colmap", "--database", "database.db", *flags])


def test_every_image_has_the_k_of_its_camera(flight: Path) -> None:
    database(flight / "database.db", FIRST, SECOND)
    assert extract() == 0
    found = read(flight / "database.db")
    model, params, known = found["a.jpg"]
    assert (model, known) == ("FULL_OPENCV", True)
    assert params[:4] == [3660.5, 3655.25, 2731.5, 1846.75]
    assert found["b.jpg"] == found["a.jpg"]
    model, params, known = found["z.jpg"]
    assert (model, known) == ("OPENCV", True)
    assert params[0] == pytest.approx(8.8 / 0.0024)
    assert params[2:] == [2736.0, 1824.0, 0.0, 0.0, 0.0, 0.0]


def test_a_camera_for_every_image_is_filled_as_well(flight: Path) -> None:
    database(flight / "database.db", ("a.jpg",), ("b.jpg",), ("z.jpg",))
    assert extract() == 0
    found = read(flight / "database.db")
    assert found["a.jpg"] == found["b.jpg"] != found["z.jpg"]


def test_what_was_there_can_be_put_back(flight: Path) -> None:
    before = rows(database(flight / "database.db", FIRST, SECOND))
    assert extract() == 0
    assert rows(flight / "database.db") != before
    with closing(sqlite3.connect(flight / "database.db")) as connection:
        connection.executescript((flight / RESTORE).read_text())
    assert rows(flight / "database.db") == before


@pytest.mark.parametrize(
    ("groups", "said"),
    [
        ([(*FIRST, *SECOND)], "is that of the images of dji-fc6310r"),
        ([("other.jpg",)], "none of these images"),
    ],
    ids=["one camera for all", "other images"],
)
def test_what_would_be_wrong_is_refused_and_k_is_written_all_the_same(
    flight: Path, groups: list[tuple[str, ...]], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = rows(database(flight / "database.db", *groups))
    assert extract() == 1
    assert said in " ".join(capsys.readouterr().out.split())
    assert rows(flight / "database.db") == before
    assert (flight / "K_matrix.json").exists()
    assert not (flight / RESTORE).exists()


def test_images_of_another_size_are_refused(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    database(flight / "database.db", FIRST, SECOND, size=(2736, 1824))
    assert extract() == 1
    assert "images of 2736×1824" in " ".join(capsys.readouterr().out.split())


def test_a_locked_database_stays_as_it_was(flight: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = rows(database(flight / "database.db", FIRST, SECOND))
    monkeypatch.setattr("calibrary.interop.colmap_database.BUSY_S", 0.1)
    holder = sqlite3.connect(flight / "database.db", isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")
    try:
        assert extract() == 3
    finally:
        holder.execute("ROLLBACK")
        holder.close()
    assert rows(flight / "database.db") == before


def test_a_dry_run_writes_nothing(flight: Path) -> None:
    before = rows(database(flight / "database.db", FIRST, SECOND))
    assert extract("--dry-run") == 0
    assert rows(flight / "database.db") == before


def test_it_is_for_colmap_only(flight: Path) -> None:
    assert flight.is_dir()
    assert main(["extract", "flight", "--database", "database.db"]) == 2
