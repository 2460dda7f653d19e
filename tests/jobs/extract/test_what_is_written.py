"""What a run writes and how it ends, case by case: every image counts, and what no camera took does not."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from calibrary.cli.main import main
from tests.imagery import ExifTags, write_jpeg, write_tiff
from tests.jobs.extract.fleet import NOBODY, P4R, gate, only, picture
from tests.parsers.imagery.build import heif, png

K = "K_matrix.npy"
UNPROVEN = "K_matrix_unproven.npy"


def good(flight: Path, count: int = 12) -> None:
    """Originals of one camera."""
    for number in range(count):
        picture(flight / f"DJI_{number:04}.JPG", **P4R)


def corrupt(flight: Path, *numbers: int) -> None:
    """The same, cut off in the first segment."""
    for number in numbers:
        (flight / f"DJI_{number:04}.JPG").write_bytes(b"\xff\xd8\xff\xe1\x40")


def put(path: Path, data: bytes) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)


def all_good(flight: Path) -> None:
    good(flight)


def one_corrupt(flight: Path) -> None:
    good(flight)
    corrupt(flight, 3)


def nine_of_ten_corrupt(flight: Path) -> None:
    good(flight, 1)
    corrupt(flight, *range(1, 10))


def preview(flight: Path) -> None:
    good(flight)
    put(flight / "preview.png", png((800, 600)))


def thumbnail(flight: Path) -> None:
    good(flight)
    write_jpeg(flight / "thumb.jpg", (160, 120))


def orthophoto(flight: Path) -> None:
    good(flight)
    write_tiff(flight / "odm_orthophoto.tif", (913, 877))


def stripped(flight: Path) -> None:
    good(flight)
    write_jpeg(flight / "stripped.jpg", (5472, 3648))


def nine_of_ten_resized_and_stripped(flight: Path) -> None:
    good(flight, 1)
    for number in range(1, 10):
        write_jpeg(flight / f"DJI_{number:04}.JPG", (2736, 1824))


def only_a_preview(flight: Path) -> None:
    put(flight / "preview.png", png((800, 600)))


def unproven(flight: Path) -> None:
    picture(flight / "a.jpg", **NOBODY)


def mpo(flight: Path) -> None:
    good(flight, 2)
    (flight / "DJI_0001.JPG").rename(flight / "DJI_0001.MPO")


def turned_heic(flight: Path) -> None:
    """EXIF's size is the portrait's, as after irot; that of the item table is the sensor's."""
    exif = ExifTags(**P4R, pixel_size=(3648, 5472), orientation=6).encode()
    put(flight / "IMG_0001.HEIC", heif((5472, 3648), exif=exif))


CASES: list[tuple[Callable[[Path], None], int, list[str], str]] = [
    (all_good, 0, [K], "1 valid"),
    (one_corrupt, 1, [K], "1 valid; 1 of 12 images unread"),
    (nine_of_ten_corrupt, 1, [K], "1 valid; 9 of 10 images unread"),
    (preview, 0, [K], "1 valid"),
    (thumbnail, 0, [K], "1 valid"),
    (orthophoto, 0, [K], "1 valid"),
    (
        stripped,
        1,
        ["K_matrix.dji-fc6310r-5472x3648.npy", "K_matrix_seed.unknown-camera-5472x3648.npy"],
        "1 valid, 1 rejected",
    ),
    (
        nine_of_ten_resized_and_stripped,
        1,
        ["K_matrix.dji-fc6310r-5472x3648.npy", "K_matrix_seed.unknown-camera-2736x1824.npy"],
        "1 valid, 1 rejected",
    ),
    (only_a_preview, 1, ["K_matrix_seed.npy"], "1 rejected"),
    (unproven, 1, [UNPROVEN], "1 unproven"),
    (mpo, 0, [K], "1 valid"),
    (turned_heic, 0, [K], "1 valid"),
]


@pytest.mark.parametrize(
    ("build", "code", "matrices", "last"), CASES, ids=[case[0].__name__ for case in CASES]
)
def test_every_image_counts(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    build: Callable[[Path], None],
    code: int,
    matrices: list[str],
    last: str,
) -> None:
    flight = tmp_path / "flight"
    flight.mkdir()
    build(flight)
    monkeypatch.chdir(tmp_path)
    assert main(["extract", "flight"]) == code
    printed = capsys.readouterr().out
    assert {path.name for path in tmp_path.glob("*.npy")} == set(matrices)
    assert printed.splitlines()[-1].partition("policy: ")[2] == last
    everywhere = {path.name for path in flight.iterdir()}
    for name in ("preview.png", "thumb.jpg", "odm_orthophoto.tif"):
        if name in everywhere and code == 0:
            assert name in printed


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may read every folder")
def test_a_folder_without_permission_ends_no_run(tmp_path: Path) -> None:
    locked = tmp_path / "locked"
    locked.mkdir(mode=0)
    assert_counted(tmp_path)
    locked.chmod(0o700)


def test_a_sub_folder_that_cannot_be_read_is_a_line_and_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "flight" / "locked").mkdir(parents=True)
    scandir = os.scandir

    def refused(path: Path) -> object:
        if str(path).endswith("locked"):
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr("calibrary.jobs.images.folders.os.scandir", refused)
    assert_counted(tmp_path / "flight")


def assert_counted(flight: Path) -> None:
    good(flight, 2)
    outcome = gate(flight, recursive=True)
    [folder] = outcome.rejected
    assert folder.name == "locked/"
    assert "cannot be read: Permission denied" in folder.reason
    assert outcome.unread == "1 folder unread"
    assert outcome.exit_code == 1
    assert len(only(outcome).images) == 2
