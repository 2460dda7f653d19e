"""A first reconstruction from matches alone: which lens it begins with."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import pycolmap
import pytest

from calibrary.calibration import Calibration, Intrinsics
from calibrary.errors import CalibrationError
from calibrary.progress import Progress
from calibrary.sfm.colmap_process import run_apart
from calibrary.sfm.engine import FlightImage, MatchedFlight, _begin_database
from calibrary.sfm.mapping import OPENCV_FISHEYE, reconstruct
from tests.sfm.flights import CAMERA, FISHEYE, SIZE, Plan, fly

FLAT: Final = Plan(heights=(1.0, 1.0), cross=True, rows=2, columns=3, points=900, outliers=0.0)
START: Final = Intrinsics(fx=1200.0, fy=1200.0, cx=750.0, cy=500.0, image_size=SIZE)
LEAST_SHARED: Final = 15


def matched(folder: Path, camera: Calibration) -> MatchedFlight:
    """What COLMAP would have found in the images of a flight over flat ground."""
    tracks, _ = fly(FLAT, 1, camera)
    names = [f"{at:05d}.png" for at in range(len(tracks.names))]
    (folder / "images").mkdir()
    cv2.imwrite(str(folder / "blank.png"), np.zeros((SIZE[1], SIZE[0]), dtype=np.uint8))
    for name in names:
        (folder / "images" / name).symlink_to(folder / "blank.png")
    images = tuple(FlightImage(path=folder / "images" / name, name=name, size=SIZE) for name in names)
    found = MatchedFlight(folder=folder, images=images)
    _begin_database(pycolmap, found, names, START)
    seen = [np.flatnonzero(tracks.image == at) for at in range(len(names))]
    with pycolmap.Database.open(found.database) as database:
        for at, rows in enumerate(seen):
            database.write_keypoints(at + 1, tracks.pixels[rows].astype(np.float32))
        for a, b in combinations(range(len(names)), 2):
            _, first, second = np.intersect1d(
                tracks.point[seen[a]], tracks.point[seen[b]], return_indices=True
            )
            if len(first) >= LEAST_SHARED:
                pairs = np.column_stack([first, second]).astype(np.uint32)
                database.write_matches(a + 1, b + 1, pairs)
                planar = pycolmap.TwoViewGeometry(
                    config=pycolmap.TwoViewGeometryConfiguration.PLANAR, inlier_matches=pairs
                )
                database.write_two_view_geometry(a + 1, b + 1, planar)
    return found


@pytest.mark.thorough
def test_a_fisheye_over_flat_ground_is_reconstructed_whole(tmp_path: Path) -> None:
    """A perspective lens takes a few of its images for a flight of 1 % of the focal length."""
    tracks, scene = reconstruct(matched(tmp_path, FISHEYE), start=START)
    assert scene.model.is_omnidirectional
    assert 0.8 < scene.parameters[0] / FISHEYE.intrinsics.fx < 1.25
    assert tracks.used.all()


@pytest.mark.thorough
def test_a_perspective_lens_stays_one_beside_a_fisheye(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = []

    def run(work: Callable[..., Any], progress: Progress | None, *args: Any) -> object:
        tried.append(args[-1])
        return run_apart(work, progress, *args)

    monkeypatch.setattr("calibrary.sfm.mapping.run_apart", run)
    monkeypatch.setattr("calibrary.sfm.mapping.WIDE_RAD", 0.1)
    tracks, scene = reconstruct(matched(tmp_path, CAMERA), start=START)
    assert not scene.model.is_omnidirectional
    assert tracks.used.all()
    assert tried[-1] is OPENCV_FISHEYE


def test_a_wide_lens_keeps_its_reconstruction_if_that_as_a_fisheye_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(work: Callable[..., Any], progress: Progress | None, *args: Any) -> object:
        if args[-1] is OPENCV_FISHEYE:
            raise CalibrationError("COLMAP failed on these images: its process died 2 times")
        return run_apart(work, progress, *args)

    monkeypatch.setattr("calibrary.sfm.mapping.run_apart", run)
    monkeypatch.setattr("calibrary.sfm.mapping.WIDE_RAD", 0.1)
    tracks, scene = reconstruct(matched(tmp_path, CAMERA), start=START)
    assert not scene.model.is_omnidirectional
    assert tracks.used.all()


@pytest.mark.thorough
def test_a_fisheye_is_tried_where_a_perspective_lens_reconstructs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(work: Callable[..., Any], progress: Progress | None, *args: Any) -> object:
        return run_apart(work, progress, *args) if args[-1] is OPENCV_FISHEYE else None

    monkeypatch.setattr("calibrary.sfm.mapping.run_apart", run)
    tracks, scene = reconstruct(matched(tmp_path, FISHEYE), start=START)
    assert scene.model.is_omnidirectional
    assert tracks.used.all()
