"""``calibrary calibrate`` and input that cannot be calibrated, in one line each."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from calibrary.calib.corners_file import read_corners
from tests.calib.photographs import encoded, photograph
from tests.calib.solving import Session
from tests.cli.calibrating import BOARD, Run, calibrated, fleet
from tests.jobs.calibrate.boards import (
    corners,
    exif,
    frames,
)
from tests.registry.git.repositories import nobodys_git

__all__ = ["calibrated", "fleet", "nobodys_git"]


def mosaic(folder: Path) -> None:
    pixels = np.random.default_rng(0).integers(90, 110, (480, 640)).astype(np.uint8)
    pixels[::2, ::2] //= 2
    for number in range(3):
        (folder / f"{number}.tif").write_bytes(encoded(pixels, "TIFF"))


def printers_ink(folder: Path) -> None:
    frame = Image.fromarray(photograph()[0]).convert("CMYK")
    for number in range(3):
        frame.save(folder / f"{number}.jpg")


def cut_short(folder: Path) -> None:
    for path in frames(folder, 3):
        path.write_bytes(path.read_bytes()[:-4000])


def empty_walls(folder: Path) -> None:
    for number in range(3):
        (folder / f"{number}.png").write_bytes(encoded(np.full((480, 640), 120 + number, np.uint8), "PNG"))


def two_sizes(folder: Path) -> None:
    (folder / "a.png").write_bytes(encoded(photograph()[0], "PNG"))
    (folder / "b.png").write_bytes(encoded(photograph()[0][:, :600], "PNG"))


def two_cameras(folder: Path) -> None:
    frames(folder, 2)
    frames(folder, 1, exif(model="Board Two"), first=2)


def two_focuses(folder: Path) -> None:
    frames(folder, 2)
    frames(folder, 1, exif(focus_m=(3, 1)), first=2)


def two_views(folder: Path) -> None:
    frames(folder, 2)


def nothing(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.mkdir()


@pytest.mark.parametrize(
    ("fill", "board", "code", "said"),
    [
        (nothing, "checkerboard:9x6", 3, "a folder without images"),
        (empty_walls, "checkerboard:9x6", 1, "no checkerboard:9x6 found in any of 3 frames"),
        (two_views, "checkerboard:8x5", 1, "but it has 9×6 inner corners; give checkerboard:9x6"),
        (two_sizes, "checkerboard:9x6", 3, "of 2 sizes"),
        (two_cameras, "checkerboard:9x6", 3, "of 2 cameras"),
        (two_focuses, "checkerboard:9x6", 3, "of 2 focus settings: 2 of 1.5 m"),
        (mosaic, "checkerboard:9x6", 1, "raw colour mosaic"),
        (printers_ink, "checkerboard:9x6", 3, "CMYK"),
        (cut_short, "checkerboard:9x6", 1, "cut short"),
        (two_views, "chessboard", 3, "expected PATTERN:COLUMNSxROWS"),
    ],
)
def test_bad_frames_get_one_line_and_leave_nothing(
    calibrated: Run, tmp_path: Path, fill: Callable[[Path], None], board: str, code: int, said: str
) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    fill(folder)
    outputs = ("--html", "r.html", "--corners", "c.json", "--out", "k.xml", "--to", "agisoft_xml")
    found, out, err = calibrated(folder, "--board", board, "--square-mm", "40", *outputs)
    assert found == code
    assert said in err
    assert err.count("\n") == 1
    assert out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["frames"]


def test_corners_that_determine_no_camera_are_kept(calibrated: Run, tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    two_views(folder)
    outputs = ("--html", "r.html", "--corners", "c.json", "--out", "k.xml", "--to", "agisoft_xml")
    found, out, err = calibrated(folder, "--board", "checkerboard:9x6", "--square-mm", "40", *outputs)
    assert (found, out) == (1, "")
    assert "2 of 2 views show enough of the board" in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.json", "frames"]


@pytest.mark.parametrize(
    ("flags", "expected", "said"),
    [
        (("--html", "page.txt"), 3, "ends in .html"),
        (("--corners", "/dev/null/c.json"), 3, "is a file; expected a folder"),
        (("--out", "k.xml"), 2, "say which with --to"),
        (("--out", "k.xml", "--to", "nonsense"), 3, "there is no format"),
        (("--html", "a.html", "--out", "a.html", "--to", "agisoft_xml"), 3, "one name"),
    ],
)
def test_a_place_that_cannot_be_written_is_named_before_the_work(
    calibrated: Run, tmp_path: Path, flags: tuple[str, ...], expected: int, said: str
) -> None:
    code, _, err = calibrated("frames-that-are-not-there", *BOARD, *flags)
    assert code == expected
    assert said in err
    assert list(tmp_path.iterdir()) == []


def code_of(run: Callable[[], int]) -> object:
    """The exit code, of the parser too."""
    try:
        return run()
    except SystemExit as stop:
        return stop.code


@pytest.mark.parametrize(
    "argv",
    [
        (),
        ("frames", "--board", "charuco:8x5", "--marker-mm", "30"),
        ("frames", "--square-mm", "40", "--from", "c.json"),
        ("--from", "c.json", "--board", "checkerboard:9x6"),
        ("--points", "p.csv"),
        ("--from", "c.json", "--to", "agisoft_xml"),
        ("--from", "c.json", "--approve"),
        ("--from", "c.json", "--registry", "fleet"),
        ("--from", "c.json", "--lens-model", "splines"),
        ("--from", "c.json", "--date", "2999-01-01"),
        ("--from", "c.json", "--registry", "fleet", "--yes", "--force"),
    ],
)
def test_what_makes_no_sense_exits_with_2(calibrated: Run, argv: tuple[str, ...]) -> None:
    assert code_of(lambda: calibrated(*argv)[0]) == 2


def test_a_registry_that_is_not_there_ends_the_run_before_the_work(calibrated: Run) -> None:
    code, _, err = calibrated("frames-that-are-not-there", *BOARD, "--registry", "nowhere", "--yes")
    assert code == 4
    assert "nowhere" in err


def test_a_format_that_cannot_hold_the_lens_takes_nothing_else_with_it(
    calibrated: Run, tmp_path: Path
) -> None:
    kept = corners(tmp_path / "kept.json")
    flags = ("--lens-model", "mei", "--out", "k.xml", "--to", "agisoft_xml", "--html", "r.html", "--json")
    code, out, _ = calibrated("--from", kept, *flags)
    document = json.loads(out)
    assert (code, document["verdict"]) == (3, "fixed")
    assert "no exact counterpart" in document["unwritten"]
    assert (tmp_path / "r.html").exists()
    assert not (tmp_path / "k.xml").exists()


def test_a_set_of_sights_too_few_to_compute_says_so(calibrated: Run, tmp_path: Path) -> None:
    kept = corners(tmp_path / "kept.json", how=Session(views=2))
    code, _, err = calibrated("--from", kept, "--html", "r.html", "--corners", "again.json")
    assert code == 1
    assert "expected at least 3" in err
    # What was seen is measured, whether a camera comes of it or not.
    assert "kept in again.json" in err
    assert len(read_corners(tmp_path / "again.json").views) == 2
    assert not (tmp_path / "r.html").exists()


def test_a_file_without_a_place_for_a_distortion_is_refused_before_the_work_begins(calibrated: Run) -> None:
    code, _, err = calibrated("frames-that-are-not-there", *BOARD, "--out", "K.npy")
    assert code == 2
    assert "no place for the distortion" in err
    assert "calibrary convert" in err
