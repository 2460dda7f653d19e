"""Files in a folder are what their content says, whatever they are called."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary import parsers
from calibrary.cli.main import main
from calibrary.errors import InputError
from calibrary.jobs.check import check
from calibrary.jobs.extract.calibration_files import LARGEST_OF_ANY_NAME, MOST_OF_A_NAME
from tests.jobs.check.test_check import DEWARP, UNIT, flight, with_k
from tests.jobs.extract.fleet import gate


def lens(path: Path, fx: float = 3669.2) -> Path:
    data, _ = parsers.encode([with_k(fx=fx, fy=fx)], "agisoft_xml")
    path.write_bytes(data)
    return path


def named(images: Path) -> list[str]:
    try:
        return [one.file for one in check(images).files]
    except InputError:
        return []


@pytest.mark.parametrize("name", ["lens", "lens.calibration", "lens.xml.bak", "lens.dat"])
def test_a_calibration_beside_the_images_is_found_under_any_name(tmp_path: Path, name: str) -> None:
    images = flight(tmp_path, DEWARP)
    lens(images / name, fx=3500.0)
    assert named(images) == [name]
    [said] = [one for one in gate(images).warnings if name in one]
    assert said.startswith(f"beside the images, but not used: {name}: off by ")


def test_what_merely_has_the_shape_of_one_is_not_taken_under_any_name(tmp_path: Path) -> None:
    images = flight(tmp_path, DEWARP)
    (images / "flight.log").write_text("3500.5 3501.25 2736 1824\n")
    assert named(images) == []


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of files that are identified."""
    names: list[str] = []
    identify = parsers.identify

    def noted(path: Path, **more: int) -> parsers.Identity:
        names.append(path.name)
        return identify(path, **more)

    monkeypatch.setattr(parsers, "identify", noted)
    return names


def test_long_files_under_other_names_are_not_opened(tmp_path: Path, opened: list[str]) -> None:
    images = flight(tmp_path, DEWARP)
    (images / "flight.bin").write_bytes(b"\0" * (LARGEST_OF_ANY_NAME + 1))
    assert named(images) == []
    assert opened == []


def test_nor_what_lies_beside_every_image(tmp_path: Path, opened: list[str]) -> None:
    images = flight(tmp_path, DEWARP)
    for number in range(MOST_OF_A_NAME + 1):
        (images / f"DJI_{number:04}.sidecar").write_text("rating 5\n")
    lens(images / "lens")
    assert named(images) == ["lens"]
    assert opened == ["lens"]


def test_what_colmap_starts_from_contradicts_nothing(tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    images = flight(tmp_path, DEWARP)
    with pycolmap.Database.open(images / "database.db") as opened:
        opened.write_camera(
            pycolmap.Camera(model="SIMPLE_RADIAL", width=5472, height=3648, params=[6566.4, 2736, 1824, 0])
        )
    assert [one for one in gate(images).warnings if "database" in one] == []


def test_a_folder_is_converted_with_the_calibration_that_is_called_an_image(tmp_path: Path) -> None:
    images = flight(tmp_path, DEWARP)
    lens(images / "lens.jpg")
    out = tmp_path / "out"
    assert main(["convert", str(images), str(out), "--to", "opencv_storage"]) == 0
    assert [path.name for path in out.iterdir()] == ["lens.yml"]
    [back] = parsers.read(out / "lens.yml")
    assert back.intrinsics.fx == UNIT.intrinsics.fx
