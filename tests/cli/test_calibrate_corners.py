"""``calibrary calibrate`` from saved corners, tables of corners and control points."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calib.corners_file import read_corners
from calibrary.registry.entry import Status
from calibrary.registry.registry import Registry
from tests.calib.solving import Session, camera
from tests.cli.calibrating import BOARD, Run, calibrated, fleet, the_entry
from tests.jobs.calibrate.boards import (
    FIRMWARE,
    MAKE,
    MODEL,
    corners,
    frames,
)
from tests.registry.git.repositories import nobodys_git

__all__ = ["calibrated", "fleet", "nobodys_git"]


def test_corners_without_frames_become_an_entry_that_names_their_file(
    calibrated: Run, tmp_path: Path, fleet: Registry
) -> None:
    kept = corners(tmp_path / "kept.json", hashed=False)
    code, _, err = calibrated("--from", kept, "--registry", "fleet", "--approve", "--yes")
    assert (code, err) == (0, "")
    [source] = the_entry(fleet).calibration.provenance.sources
    assert (source.name, source.sha256) == ("kept.json", hashlib.sha256(kept.read_bytes()).hexdigest())
    assert the_entry(fleet).status is Status.APPROVED


def vnl_of(kept: Path, path: Path) -> Path:
    """The same corners as mrcal writes them: counted from the middle of the first pixel, the level behind."""
    seen = read_corners(kept)
    lines = ["## produced by a test", "# filename x y level"]
    for view in seen.views:
        assert len(view.ids) == len(seen.board.points)
        lines += [f"{view.name} {x - 0.5!r} {y - 0.5!r} 0" for x, y in view.image_points.tolist()]
    path.write_text("\n".join([*lines, "nothing.jpg - - -", ""]), encoding="utf-8")
    return path


def test_corners_of_mrcal_are_solved_approved_and_kept(
    calibrated: Run, tmp_path: Path, fleet: Registry
) -> None:
    kept = corners(tmp_path / "kept.json", how=Session(views=18), hashed=False)
    table = vnl_of(kept, tmp_path / "corners.vnl")
    own = json.loads(calibrated("--from", kept, "--json")[1])
    size = "{}x{}".format(*read_corners(kept).image_size)
    flags = ("--board", str(read_corners(kept).board), "--image-size", size, "--corners", "again.json")
    named = ("--make", "Example", "--model", "Solved")
    code, out, err = calibrated(
        "--from", table, *flags, *named, "--registry", "fleet", "--approve", "--yes", "--json"
    )
    assert code == 0, err
    theirs = json.loads(out)
    assert theirs["calibration"]["K"] == pytest.approx(np.array(own["calibration"]["K"]), rel=1e-7)
    # The table does not state the side of a square, and K does not need it.
    assert theirs["length_unit"] == "squares"
    provenance = the_entry(fleet).calibration.provenance
    [source] = provenance.sources
    assert source.sha256 == hashlib.sha256(table.read_bytes()).hexdigest()
    again = json.loads(calibrated("--from", "again.json", "--json")[1])
    assert again["calibration"]["provenance"]["sources"] == [{"name": source.name, "sha256": source.sha256}]
    assert again["calibration"]["K"] == theirs["calibration"]["K"]


def test_what_a_table_of_corners_does_not_say_is_asked_for(calibrated: Run, tmp_path: Path) -> None:
    kept = corners(tmp_path / "kept.json", how=Session(views=4))
    table = vnl_of(kept, tmp_path / "corners.vnl")
    board = ("--board", str(read_corners(kept).board))
    assert "--board" in calibrated("--from", table)[2]
    assert "--image-size" in calibrated("--from", table, *board)[2]
    code, _, err = calibrated("--from", table, "--board", "checkerboard:7x5", "--image-size", "640x480")
    assert code == 3
    assert "checkerboard:7x5" in err


def test_frames_beside_a_table_of_corners_say_what_they_say_of_their_camera(
    calibrated: Run, tmp_path: Path, fleet: Registry
) -> None:
    shots = frames(tmp_path / "shots", 8)
    calibrated(*shots, *BOARD, "--corners", "kept.json")
    seen = read_corners(tmp_path / "kept.json")
    lines = ["image,id,x,y"]
    for view in seen.views:
        lines += [
            f"{view.name},{at},{x - 0.5!r},{y - 0.5!r}"
            for at, (x, y) in zip(view.ids, view.image_points.tolist(), strict=True)
        ]
    table = tmp_path / "shots" / "found.csv"
    table.write_text("\n".join(lines), encoding="utf-8")
    code, _, err = calibrated("--from", table, *BOARD, "--registry", "fleet", "--yes")
    assert (code, err) == (1, "")
    made = the_entry(fleet).calibration
    assert (made.camera.make, made.camera.model, made.provenance.firmware) == (MAKE, MODEL, FIRMWARE)
    assert {source.name for source in made.provenance.sources} == {
        "found.csv",
        *(shot.name for shot in shots),
    }


def test_a_seed_starts_the_search_and_decides_nothing(calibrated: Run, tmp_path: Path) -> None:
    kept = corners(tmp_path / "kept.json")
    np.save(tmp_path / "K_seed.npy", np.array([[1000.0, 0, 960], [0, 1000.0, 720], [0, 0, 1]]))
    plain, seeded = (
        json.loads(calibrated("--from", kept, "--json", *flags)[1])["calibration"]["intrinsics"]
        for flags in ((), ("--seed-k", tmp_path / "K_seed.npy"))
    )
    assert seeded["fx"] == pytest.approx(plain["fx"], rel=1e-7)


def test_a_seed_of_another_frame_is_refused(calibrated: Run, tmp_path: Path) -> None:
    kept = corners(tmp_path / "kept.json")
    (tmp_path / "k.yml").write_bytes(
        parsers.encode([camera((1000, 1000), distortion=None)], "opencv_storage", name="k.yml")[0]
    )
    code, _, err = calibrated("--from", kept, "--seed-k", "k.yml")
    assert code == 3
    assert "not a K to start from" in err


def test_control_points_need_no_board(calibrated: Run, tmp_path: Path) -> None:
    truth = camera((640, 480), fx=500.0, fy=500.0, distortion=None)
    random = np.random.default_rng(1)
    points = random.uniform((-3, -2, 8), (3, 2, 14), (40, 3))
    rows = ["X,Y,Z,u,v,image"]
    for name, shift in (("a", 0.0), ("b", 1.0)):
        pixels = truth.project(points - [shift, 0, 0]) - 0.5
        rows += [f"{x},{y},{z},{u},{v},{name}" for (x, y, z), (u, v) in zip(points, pixels, strict=True)]
    (tmp_path / "gcp.csv").write_text("\n".join(rows))
    flags = ("--image-size", "640x480", "--pixel-origin", "centre", "--lens-model", "k1k2", "--json")
    _, out, _ = calibrated("--points", "gcp.csv", *flags)
    K = json.loads(out)["calibration"]["intrinsics"]
    assert K["fx"] == pytest.approx(500.0, abs=0.01)
    assert K["cx"] == pytest.approx(truth.intrinsics.cx, abs=0.01)
