"""Where boards are held, and corners with noise but without pixels."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.calib.artwork import paper_rim
from calibrary.calib.synthesis import Pose, Sheet, Shutter, poses, seen_corners
from calibrary.distortion import KannalaBrandt
from calibrary.errors import InputError

from .observing import observe
from .staging import BOARD, camera

CAMERA = camera()


def tilts_deg(held: tuple[Pose, ...]) -> list[float]:
    """Angles between the boards' normals and the optical axis."""
    return [float(np.degrees(np.arccos(pose.matrix[2, 2]))) for pose in held]


def test_every_pose_shows_the_whole_sheet() -> None:
    for pose in poses(BOARD, CAMERA, 30, seed=1):
        rim = CAMERA.project(pose.camera_points(paper_rim(BOARD)))
        assert (rim > 0).all()
        assert (rim < (1280, 960)).all()


def test_poses_are_tilted_all_ways_and_cover_the_frame() -> None:
    held = poses(BOARD, CAMERA, 60, seed=2)
    tilts = tilts_deg(held)
    assert max(tilts) > 30
    assert min(tilts) < 10
    middles = np.array([seen_corners(BOARD, CAMERA, pose, Sheet(), Shutter()).mean(axis=0) for pose in held])
    assert np.ptp(middles[:, 0]) > 0.4 * 1280
    assert np.ptp(middles[:, 1]) > 0.25 * 960


def test_tilt_fill_and_reach_are_kept_to() -> None:
    held = poses(BOARD, CAMERA, 20, 3, max_tilt_deg=2.0, fill=(0.2, 0.3), reach=0.5)
    assert max(tilts_deg(held)) < 2 * 2**0.5 + 0.1
    for pose in held:
        corners = seen_corners(BOARD, CAMERA, pose, Sheet(), Shutter())
        assert np.ptp(corners[:, 0]) < 0.3 * 1280
        assert (np.abs(corners - (640, 480)) < (320, 240)).all()


def test_the_same_seed_gives_the_same_poses() -> None:
    assert poses(BOARD, CAMERA, 3, 4) == poses(BOARD, CAMERA, 3, 4)
    assert poses(BOARD, CAMERA, 3, 4) != poses(BOARD, CAMERA, 3, 5)


def test_a_fisheye_is_shown_the_boards_face() -> None:
    wide = camera((1280, 960), 330.0, KannalaBrandt(k1=0.01, k2=-0.004, k3=0.0, k4=0.0))
    for pose in poses(BOARD, wide, 10, 1, max_tilt_deg=10):
        middle = pose.camera_points(np.array([[160.0, 100.0, 0.0]]))[0]
        assert pose.matrix[:, 2] @ middle / np.linalg.norm(middle) > 0.95


def test_an_impossible_wish_is_refused() -> None:
    with pytest.raises(InputError, match="fits nowhere"):
        poses(BOARD, CAMERA, 1, 1, fill=(500.0, 500.0), reach=0.05)


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_a_rotation_is_opencvs(vector: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(
        Pose(rotation=vector, translation_mm=(0, 0, 1)).matrix, cv2.Rodrigues(np.array(vector))[0], atol=1e-12
    )


def test_poses_turned_by_any_angle_are_the_rotations_they_were_drawn_as() -> None:
    for pose in poses(BOARD, CAMERA, 20, 6, roll_deg=180.0, fill=(0.2, 0.3)):
        assert np.linalg.norm(pose.rotation) < np.pi + 1e-9
        assert pose.matrix[2, 2] > 0.5


def test_corners_are_opencvs_half_a_pixel_on() -> None:
    held = poses(BOARD, CAMERA, 4, 7)
    seen = observe(BOARD, CAMERA, held, 0.0, 1)
    K, d = CAMERA.intrinsics, CAMERA.distortion
    matrix = K.matrix - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    assert d is not None
    coefficients = np.array([d.coefficients[name] for name in ("k1", "k2", "p1", "p2", "k3")])
    for view, pose in zip(seen.views, held, strict=True):
        expected, _ = cv2.projectPoints(
            BOARD.points, np.array(pose.rotation), np.array(pose.translation_mm), matrix, coefficients
        )
        np.testing.assert_allclose(view.image_points, expected.reshape(-1, 2) + 0.5, atol=1e-9)
        np.testing.assert_array_equal(view.ids, np.arange(54))


def test_noise_is_normal_with_the_standard_deviation_asked_for() -> None:
    held = poses(BOARD, CAMERA, 60, 8)
    exact, noisy = (observe(BOARD, CAMERA, held, sigma, 1) for sigma in (0.0, 0.3))
    off = np.concatenate(
        [a.image_points - b.image_points for a, b in zip(noisy.views, exact.views, strict=True)]
    )
    assert off.std(axis=0) == pytest.approx(0.3, rel=0.05)
    assert np.abs(off.mean(axis=0)).max() < 0.02


def test_bow_stretch_and_shutter_reach_the_corners() -> None:
    held = poses(BOARD, CAMERA, 1, 9)
    plain = observe(BOARD, CAMERA, held, 0.0, 1).views[0].image_points
    shutter = Shutter(readout_s=0.03, rate_deg_s=(0.0, 5.0, 0.0))
    for seen in (
        observe(BOARD, CAMERA, held, 0.0, 1, bow_mm=1.0),
        observe(BOARD, CAMERA, held, 0.0, 1, stretch=(1.002, 1.0)),
        observe(BOARD, CAMERA, held, 0.0, 1, shutter=shutter),
    ):
        faulty = seen.views[0].image_points
        assert 0.2 < np.abs(faulty - plain).max() < 5


def test_points_outside_the_frame_are_not_seen() -> None:
    close = Pose(rotation=(0.0, 0.0, 0.0), translation_mm=(-160.0, -100.0, 150.0))
    view = observe(BOARD, CAMERA, [close], 0.0, 1).views[0]
    assert 0 < len(view.ids) < 54
    assert (view.image_points > 0).all()
    assert (view.image_points < (1280, 960)).all()


def test_a_bow_is_the_same_curve_both_ways() -> None:
    sheet = Sheet.bowed(BOARD, 2.0)
    height = sheet.points(BOARD)[:, 2].reshape(6, 9)
    middle = sheet.height(BOARD, np.array([160.0]), np.array([100.0]))[0]
    assert middle - height[0, 4] == pytest.approx(2.0 * (100 / 160) ** 2)
    # The corners' plane is the sheet's; the ends of the longer side stand 2 mm before the middle.
    assert height[0, 0] == pytest.approx(0)
    assert middle - sheet.height(BOARD, np.array([0.0]), np.array([100.0]))[0] == pytest.approx(2.0)
