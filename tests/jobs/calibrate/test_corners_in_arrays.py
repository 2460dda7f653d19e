"""Corners in arrays, and tables of several cameras: what other programs find becomes a verdict in three lines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import calibrary
from calibrary.calib.board import Board
from calibrary.calib.corners_file import encode_corners, read_corners
from calibrary.errors import InputError
from calibrary.jobs.calibrate import calibrate_rig
from calibrary.records import replace
from tests.calib.solving import BOARD, SIZE, camera, shoot

SEEN = shoot()
PIXELS = [(view.image_points - 0.5).astype(np.float32) for view in SEEN.views]
GRID = np.zeros((88, 3), np.float32)
GRID[:, :2] = np.mgrid[0:11, 0:8].T.reshape(-1, 2)


def test_what_cv2_calibrates_from_gives_the_same_camera_and_a_verdict() -> None:
    points = [GRID] * len(PIXELS)
    corners = calibrary.Corners(
        object_points=points, image_points=[one.reshape(-1, 1, 2) for one in PIXELS], image_size=SIZE
    )
    result = calibrary.calibrate(corners=corners, flat=True, lens_model="brown")
    _, K, _, _, _ = cv2.calibrateCamera(points, PIXELS, SIZE, None, None)
    found = result.calibration.intrinsics
    assert (found.fx, found.cx - 0.5) == pytest.approx((K[0, 0], K[0, 2]), abs=0.1)
    assert found.fx == pytest.approx(camera().intrinsics.fx, abs=1)
    assert result.calibration.provenance.source == "checkerboard:11x8"
    assert result.length_unit == "squares"


def test_corners_with_ids_are_of_the_board_that_is_named() -> None:
    half = [np.arange(at % 2, 88, 2) for at in range(len(PIXELS))]
    corners = calibrary.Corners(
        ids=[one[:, None] for one in half],
        image_points=[pixels[ids] for pixels, ids in zip(PIXELS, half, strict=True)],
        image_size=SIZE,
    )
    result = calibrary.calibrate(corners=corners, board="charuco:11x8", square_mm=40)
    assert result.calibration.intrinsics.fx == pytest.approx(camera().intrinsics.fx, abs=2)
    assert result.length_unit == "mm"


def test_object_points_that_are_no_grid_are_points_at_known_places() -> None:
    bent = np.column_stack([GRID[:, :2], np.sin(GRID[:, 0])]).astype(np.float32)
    K, lens = camera().to_opencv()
    seen = [
        cv2.projectPoints(bent, turn, np.array([-5.0, -3.5, 14 + at]), K, lens)[0]
        for at, turn in enumerate(np.random.default_rng(1).normal(0, 0.3, (12, 3)))
    ]
    corners = calibrary.Corners(object_points=[bent] * 12, image_points=seen, image_size=SIZE)
    result = calibrary.calibrate(corners=corners)
    assert result.calibration.provenance.kind == "control-points"
    assert result.calibration.intrinsics.fx == pytest.approx(camera().intrinsics.fx, abs=0.5)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"image_size": (300, 400)}, r"in images of 300×400 px; expected image_size as \(width, height\)"),
        ({"object_points": [GRID] * 3}, "3 of 16 views"),
        ({"object_points": [GRID[:9]] * 16}, "9 points for 88 image points"),
        ({"object_points": None}, "expected object_points, or a board"),
        ({"image_points": [None] * 16}, "no corner in any of 16 views"),
        ({"image_points": [np.zeros((4, 3))] * 16}, r"an array of shape \(4, 3\)"),
        ({"image_points": [[[1, 2], [3]]] * 16}, r"^image_points\[0\]: rows of different lengths"),
        ({"image_points": [[["1", "2"]]] * 16}, r"^image_points\[0\]: an array of <U1; expected \(N, 2\)"),
        ({"image_points": [PIXELS[0] + 1j] * 16}, r"^image_points\[0\]: an array of complex64; expected"),
        ({"image_points": None}, "^image_points: a NoneType; expected a list, one for each view"),
        ({"object_points": [GRID[:, :2]] * 16}, r"^object_points\[0\]: an array of shape \(88, 2\) for 88"),
        ({"object_points": [[["a", "b", "c"]]] * 16}, r"^object_points\[0\]: an array of <U1"),
        ({"object_points": [None] * 16}, r"^object_points\[0\]: an array of object"),
        ({"image_size": None}, r"^image_size: None; expected \(width, height\)"),
        ({"image_size": (1280,)}, r"^image_size: \(1280,\); expected \(width, height\)"),
        ({"image_size": (1280.5, 960)}, r"^image_size: \(1280.5, 960\); expected"),
        ({"ids": [np.arange(88)] * 16}, "^ids: given beside object_points; expected one of the two"),
        ({"names": list(range(16))}, r"^names\[0\]: 0; expected the name of a view"),
        ({"names": ["a", *"bcdefghijklmno", "a"]}, r"^names\[15\]: a as names\[0\]; expected another"),
    ],
)
def test_arrays_that_do_not_go_together_are_told(change: dict[str, Any], said: str) -> None:
    whole = calibrary.Corners(object_points=[GRID] * 16, image_points=PIXELS, image_size=SIZE)
    with pytest.raises(InputError, match=said):
        calibrary.calibrate(corners=replace(whole, **change))


def test_ids_beyond_the_board_are_told() -> None:
    corners = calibrary.Corners(ids=[np.arange(88)] * 16, image_points=PIXELS, image_size=SIZE)
    with pytest.raises(InputError, match="the board has 54; expected an id below 54"):
        calibrary.calibrate(corners=corners, board="checkerboard:9x6")


@pytest.mark.parametrize(
    ("ids", "said"),
    [
        (np.arange(88) * 0.99, "no whole numbers"),
        (np.arange(88).astype(str), "an array of <U"),
        ([[0, 1], [2]], "rows of different lengths"),
    ],
)
def test_ids_that_are_no_numbers_of_points_are_told(ids: Any, said: str) -> None:
    corners = calibrary.Corners(ids=[ids] * 16, image_points=PIXELS, image_size=SIZE)
    with pytest.raises(InputError, match=rf"^ids\[0\]: .*({said})"):
        calibrary.calibrate(corners=corners, board="checkerboard:11x8")


def table(folder: Path, cameras: tuple[str, ...]) -> Path:
    lines = ["# filename x y level"]
    for at, pixels in enumerate(PIXELS):
        lines += [f"{name}-{at:02}.png {x:.4f} {y:.4f} 0" for name in cameras for x, y in pixels]
    path = folder / "corners.vnl"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_table_of_two_cameras_is_two_cameras(tmp_path: Path) -> None:
    path, size = table(tmp_path, ("cam0", "cam1")), calibrary.CameraKey(image_size=SIZE)
    with pytest.raises(InputError, match=r"has corners of 2 cameras, cam0, cam1 .*; solve them with --rig"):
        calibrary.calibrate(corners=path, board="checkerboard:11x8", camera=size)
    rig = calibrate_rig(corners=path, board="checkerboard:11x8", square_mm=40, camera=size, flat=True)
    assert list(rig.poses) == ["cam1"]
    assert np.allclose(rig.poses["cam1"].translation_mm, 0, atol=1e-3)


def test_arrays_by_camera_are_a_rig_and_a_view_may_miss_in_one() -> None:
    right = [one + np.float32(0.01) for one in PIXELS]
    views: dict[str, list[Any]] = {"left": [None, *PIXELS[1:]], "right": right}
    both = {
        name: calibrary.Corners(object_points=[GRID] * 16, image_points=seen, image_size=SIZE)
        for name, seen in views.items()
    }
    rig = calibrate_rig(corners=both, square_mm=40, flat=True, lens_model="brown")
    assert list(rig.poses) == ["right"]
    assert {camera.name: len(camera.result.views) for camera in rig.cameras} == {"left": 15, "right": 16}


def test_corners_that_were_kept_before_days_were_are_read(tmp_path: Path) -> None:
    path = tmp_path / "corners.json"
    content = encode_corners(SEEN)
    assert b'"taken": null,\n' in content
    path.write_bytes(content.replace(b'"taken": null,\n', b""))
    assert read_corners(path).taken is None
    assert isinstance(read_corners(path).board, Board)
    assert read_corners(path).board == BOARD
