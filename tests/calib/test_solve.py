from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrary.calib.adjustment import Adjusted, adjust, lens_covariance
from calibrary.calib.board import Board
from calibrary.calib.lens_models import Solvable
from calibrary.calib.network import Network
from calibrary.calib.observations import Observations
from calibrary.calib.solve import solve
from calibrary.calib.start import seed, start
from calibrary.calibration import Intrinsics
from calibrary.distortion import BrownConrady, KannalaBrandt
from calibrary.errors import CalibrationError
from calibrary.records import replace

from .solving import SIZE, Session, camera, moved, shoot


def _cv2(seen: Observations, flags: int = 0) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """OpenCV's answer on the same corners, as far as float32 lets it go: rms, K, coefficients, standard deviations."""
    points = [seen.object_points(view).astype(np.float32) for view in seen.views]
    pixels = [view.image_points.astype(np.float32) for view in seen.views]
    rms, K, lens, _, _, std, _, _ = cv2.calibrateCameraExtended(
        points, pixels, seen.image_size, np.eye(3), np.zeros(5), flags=flags, criteria=(3, 200, 1e-14)
    )
    return rms, K, np.ravel(lens), np.ravel(std)


def _brown(seen: Observations) -> Adjusted:
    return solve(Network.of(seen), seen.image_size, model=Solvable.BROWN, warp=False).adjusted


def test_the_minimum_is_opencvs_on_the_same_corners() -> None:
    seen = shoot(seed=1)
    ours = _brown(seen)
    rms, K, lens, _ = _cv2(seen)
    assert ours.rms_px == pytest.approx(rms, abs=1e-5)
    np.testing.assert_allclose(ours.state.parameters[:4], [K[0, 0], K[1, 1], K[0, 2], K[1, 2]], atol=2e-3)
    np.testing.assert_allclose(ours.state.parameters[4:], lens[:5], atol=2e-5)


def test_the_covariance_has_opencvs_standard_deviations_on_its_diagonal() -> None:
    seen = shoot(seed=2)
    std = list(lens_covariance(_brown(seen)).std.values())
    np.testing.assert_allclose(std, _cv2(seen)[3][:9], rtol=1e-4)


def test_the_covariance_is_the_scatter_of_many_calibrations() -> None:
    solved = _brown(shoot(how=Session(views=12)))
    network, rng = solved.network, np.random.default_rng(5)
    exact = network.pixels - solved.linear.residuals.reshape(network.pixels.shape)
    found = [
        adjust(
            replace(network, pixels=exact + rng.normal(0, 0.05, exact.shape)), solved.state
        ).state.parameters
        for _ in range(150)
    ]
    stated = lens_covariance(solved).matrix * 0.05**2 / solved.variance
    unit = np.sqrt(np.outer(np.diag(stated), np.diag(stated)))
    np.testing.assert_allclose(np.cov(np.array(found).T) / unit, stated / unit, atol=0.3)


def test_noiseless_corners_give_the_camera_back() -> None:
    truth = camera()
    found = _brown(shoot(how=Session(sigma_px=0.0, views=10))).state
    np.testing.assert_allclose(
        found.parameters, Solvable.BROWN.values(truth.intrinsics, truth.distortion), atol=1e-6
    )


@pytest.mark.parametrize(
    "lens",
    [
        BrownConrady(k1=-0.1, k2=0.03, p1=0.0, p2=0.0),
        BrownConrady(k1=-0.27, k2=0.11, p1=0.0, p2=0.0, k3=-0.035),
        BrownConrady(k1=-0.1, k2=0.03, p1=1e-3, p2=-1e-3),
        BrownConrady(k1=-0.27, k2=0.11, p1=4e-4, p2=-4e-4, k3=-0.035),
    ],
)
def test_nothing_leaner_than_full_brown_is_chosen_and_what_is_not_there_comes_out_as_zero(
    lens: BrownConrady,
) -> None:
    found = solve(Network.of(shoot(camera(distortion=lens), seed=4)), SIZE)
    assert found.state.model is Solvable.BROWN
    std = lens_covariance(found.adjusted).std
    for name, value in zip(Solvable.BROWN.parameters, found.state.parameters, strict=True):
        if name in lens.coefficients:
            assert abs(value - lens.coefficients[name]) < 3.5 * std[name]


def test_a_fisheye_is_recognised_as_one() -> None:
    lens = KannalaBrandt(k1=0.02, k2=-0.01, k3=0.001, k4=0.0)
    seen = shoot(camera(fx=560.0, fy=561.0, distortion=lens), Session(fill=(0.2, 0.6), views=15), seed=2)
    found = solve(Network.of(seen), SIZE)
    assert found.state.model is Solvable.FISHEYE
    assert found.state.parameters[0] == pytest.approx(560.0, rel=5e-4)


def test_a_bent_board_is_solved_for() -> None:
    bent = solve(Network.of(shoot(how=Session(bow_mm=0.2), seed=6)), SIZE)
    assert bent.is_warped
    np.testing.assert_allclose(bent.state.warp, [0.2, 0.098], atol=0.02)
    assert bent.state.parameters[0] == pytest.approx(1450.37, rel=3e-4)


def test_a_flat_board_stays_flat() -> None:
    flat = solve(Network.of(shoot(seed=7)), SIZE)
    assert not flat.is_warped
    np.testing.assert_array_equal(flat.state.warp, [0.0, 0.0])


def test_bad_corners_are_set_aside_one_by_one_and_a_dragged_view_whole() -> None:
    by = np.zeros((88, 2))
    by[[3, 40, 41, 80]] = [[8, 3], [-5, 9], [4, -4], [0, -12]]
    seen = moved(shoot(seed=3), 4, by)
    drag = np.zeros((88, 2))
    drag[:, 0] = np.linspace(0, 6, 88) ** 2 / 12
    found = solve(Network.of(moved(seen, 9, drag)), SIZE)
    seen_by_view = found.adjusted.network.seen
    assert np.flatnonzero(~found.adjusted.network.used).tolist() == [9]
    assert np.flatnonzero(~seen_by_view[4]).tolist() == [3, 40, 41, 80]
    assert seen_by_view.sum() == 15 * 88 - 4


@pytest.mark.thorough
def test_the_seed_rescues_a_start_that_ended_in_a_wrong_minimum() -> None:
    for number in range(8):
        seen = shoot(how=Session(tilt_deg=8.0, views=12), seed=300 + number)
        assert solve(Network.of(seen), SIZE).adjusted.rms_px < 0.08


def test_a_view_along_a_wall_whose_centre_is_behind_the_camera_leads_to_the_same_camera() -> None:
    wall = Board(columns=60, rows=40, square_mm=50.0)
    seen_by, middle = camera(distortion=None), wall.points.mean(axis=0)
    seen = shoot(seen_by, Session(views=8), board=wall)
    views = list(seen.views)
    for number, along in enumerate((1.0, -1.0)):
        R = cv2.Rodrigues(np.array([0.0, -along * np.radians(62), 0.1 * number]))[0]
        at = (wall.points - middle - np.array([along * 500.0, 0.0, -400.0])) @ R.T
        assert -(R @ np.array([along * 500.0, 0.0, -400.0]))[2] < 0
        pixels = seen_by.project(at)
        inside = (at[:, 2] > 0) & ((pixels > 0) & (pixels < np.array(SIZE))).all(axis=1)
        views.append(replace(views[0], ids=np.flatnonzero(inside), image_points=pixels[inside]))
    found = start(Network.of(replace(seen, views=tuple(views))), SIZE, Solvable.BROWN, None)
    assert found.rms_px < 0.1


@pytest.mark.parametrize(("at", "seed"), [((-240.0, 720.0), 4), ((100.0, 100.0), 5)])
def test_a_principal_point_far_from_the_middle_as_in_a_cropped_image_is_found(
    at: tuple[float, float], seed: int
) -> None:
    truth = camera(distortion=BrownConrady(k1=-0.1, k2=0.03, p1=0.0, p2=0.0, k3=0.0))
    truth = replace(truth, intrinsics=replace(truth.intrinsics, cx=at[0], cy=at[1]))
    found = _brown(shoot(truth, Session(views=12, sigma_px=0.3), seed)).state.parameters[:4]
    assert found == pytest.approx([1450.37, 1447.6, *at], abs=5.0)


def test_a_view_of_too_few_corners_for_a_pose_is_an_error_of_the_start() -> None:
    network = Network.of(shoot(how=Session(views=4)))
    seen = network.seen.copy()
    seen[1, 1:] = False
    with pytest.raises(CalibrationError, match="too few corners"):
        start(network.only(seen), SIZE, Solvable.BROWN, None)


def test_any_sensible_guess_leads_to_the_same_camera() -> None:
    network = Network.of(shoot(seed=8, how=Session(views=12)))
    found = []
    for factor in (0.3, 1.0, 3.0):
        K = seed(SIZE)
        guess = Intrinsics(fx=K.fx * factor, fy=K.fy * factor, cx=K.cx, cy=K.cy, image_size=SIZE)
        found.append(start(network, SIZE, Solvable.K1K2P1P2, guess).state.parameters)
    np.testing.assert_allclose(found[1:], found[:1] * 2, atol=1e-4)
