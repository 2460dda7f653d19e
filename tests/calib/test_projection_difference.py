from __future__ import annotations

import math

import numpy as np
import pytest

from calibrary.calib.adjustment import lens_covariance
from calibrary.calib.estimation import estimate
from calibrary.calib.lens_models import Solvable
from calibrary.calib.network import Network
from calibrary.calib.projection_difference import (
    ProjectionDifference,
    projection_difference,
    projection_uncertainty,
)
from calibrary.calib.solve import solve
from calibrary.calib.synthesis import poses
from calibrary.calibration import Calibration, Covariance
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion, Rational
from calibrary.errors import CalibrationError, InputError
from calibrary.jobs.diff.uncertainty import image_scale, noise_test
from calibrary.records import replace

from .observing import observe
from .solving import BOARD, SIZE, Session, camera, shoot

SHAPE = (17, 13)


def _solved(seed: int, truth: Calibration | None = None) -> tuple[Calibration, Covariance]:
    found = solve(
        Network.of(shoot(truth, seed=seed, how=Session(views=15))), SIZE, model=Solvable.BROWN, warp=False
    )
    values = dict(zip(found.state.model.parameters, found.state.parameters, strict=True))
    lens = Solvable.BROWN.distortion(values)
    solved = replace(camera(), intrinsics=Solvable.BROWN.intrinsics(values, SIZE), distortion=lens)
    return solved, lens_covariance(found.adjusted)


def _nudged(**by: float) -> Calibration:
    base = camera()
    K = base.intrinsics
    return replace(
        base, intrinsics=replace(K, **{name: getattr(K, name) + value for name, value in by.items()})
    )


def test_a_camera_does_not_differ_from_itself() -> None:
    same = projection_difference(camera(), camera(), shape=SHAPE)
    assert same.max_px < 1e-7
    assert same.rotation_deg < 1e-9
    assert same.region.any()


def test_a_shifted_principal_point_is_nearly_a_rotation() -> None:
    shifted = projection_difference(camera(), _nudged(cx=2.0), shape=SHAPE)
    assert shifted.rotation_deg == pytest.approx(math.degrees(2 / 1450.37), rel=0.05)
    assert shifted.centre_rms_px < 0.05
    # Turned left by as much as the principal point moved right: about +y, in the right-handed frame, by −2/f.
    assert shifted.rotation_rad[1] == pytest.approx(-2 / 1450.37, rel=0.05)


def test_a_longer_focal_length_is_seen_as_far_out_as_it_is_long() -> None:
    base, K = camera(distortion=NoDistortion()), camera().intrinsics
    longer = replace(base, intrinsics=replace(K, fx=K.fx * 1.001, fy=K.fy * 1.001))
    found = projection_difference(base, longer, shape=SHAPE)
    offset = found.pixels - [K.cx, K.cy]
    np.testing.assert_allclose(found.vectors, 0.001 * offset, atol=0.02)


def test_two_models_of_one_lens_can_be_compared() -> None:
    equidistant = camera(distortion=KannalaBrandt(k1=0.0, k2=0.0, k3=0.0, k4=0.0))
    pinhole = camera(distortion=NoDistortion())
    found = projection_difference(pinhole, equidistant, shape=SHAPE)
    assert found.region.all()
    assert found.max_px > 100 > found.centre_rms_px


def test_weights_say_where_the_cameras_are_laid_together() -> None:
    right = np.zeros(SHAPE[::-1])
    right[:, -4:] = 1.0
    other = _nudged(fx=1.5)
    middle = projection_difference(camera(), other, shape=SHAPE)
    weighted = projection_difference(camera(), other, shape=SHAPE, weights=right)
    assert weighted.lengths_px[6, -2] < middle.lengths_px[6, -2]
    assert weighted.lengths_px[6, 8] > middle.lengths_px[6, 8]


def chance(found: ProjectionDifference) -> float:
    """Probability of such a difference from noise alone."""
    tested = noise_test(found, image_scale(found), level=0.01, matters_px=0.1, matters_scale=1e-4)
    assert tested is not None
    return tested[0]


@pytest.mark.thorough
def test_noise_alone_alarms_no_more_often_than_it_says() -> None:
    chances = []
    for seed in range(5):
        (a, C_a), (b, C_b) = _solved(1000 + seed), _solved(2000 + seed)
        found = projection_difference(a, b, shape=(9, 7), covariances=(C_a, C_b))
        chances.append(chance(found))
    assert min(chances) > 0.01
    assert 0.1 < float(np.median(chances)) < 0.9


def test_a_twentieth_of_a_percent_of_focal_length_is_found() -> None:
    longer = _nudged(fx=0.0015 * 1450, fy=0.0015 * 1450)
    (a, C_a), (b, C_b) = _solved(1), _solved(2, longer)
    found = projection_difference(a, b, shape=SHAPE, covariances=(C_a, C_b))
    assert chance(found) < 0.01


def test_uncertainty_is_the_scatter_of_calibrations() -> None:
    truth = camera()
    (_, C), scatter = _solved(0), []
    L = np.linalg.cholesky(C.matrix)
    rng = np.random.default_rng(0)
    theta = Solvable.BROWN.values(truth.intrinsics, truth.distortion)
    stated = projection_uncertainty(truth, C, shape=SHAPE).std_px
    inside = stated < 0.2
    weights = np.where(inside, 1.0 / stated**2, 0.0)
    for _ in range(60):
        values = dict(zip(C.names, theta + L @ rng.normal(size=len(theta)), strict=True))
        drawn = replace(
            truth,
            intrinsics=Solvable.BROWN.intrinsics(values, SIZE),
            distortion=Solvable.BROWN.distortion(values),
        )
        scatter.append(projection_difference(truth, drawn, shape=SHAPE, weights=weights).vectors)
    worst = np.sqrt(
        np.linalg.eigvalsh(np.einsum("kijx,kijy->ijxy", scatter, scatter) / len(scatter))[..., -1]
    )
    assert np.median(worst[inside] / stated[inside]) == pytest.approx(1.0, abs=0.15)


def test_a_pixel_for_which_one_camera_has_no_ray_is_not_compared() -> None:
    lens = BrownConrady(k1=-0.312, k2=0.108, p1=0.0004, p2=-0.0007, k3=-0.0173)
    one = camera((1280, 960), fx=641.2, fy=640.9, distortion=lens)
    other = replace(one, distortion=replace(lens, k1=-0.318))
    found = projection_difference(one, other)
    rays = [each.unproject(found.pixels.reshape(-1, 2)) for each in (one, other)]
    by_both = np.isfinite(rays).all(axis=(0, 2)).reshape(found.region.shape)
    assert 0.5 < by_both.mean() < np.isfinite(rays[0]).all(axis=1).mean()
    assert not (found.region & ~by_both).any()


def test_frames_of_two_sizes_are_not_compared() -> None:
    with pytest.raises(InputError, match="scale one first"):
        projection_difference(camera(), camera(size=(960, 720)))


def test_cameras_that_see_nothing_in_common_are_not_compared() -> None:
    away = _nudged(cx=1e6)
    with pytest.raises((CalibrationError, InputError)):
        projection_difference(camera(), away, shape=SHAPE)


def test_a_covariance_of_another_model_is_refused() -> None:
    C = Covariance.from_matrix(("fx", "xi"), np.eye(2))
    with pytest.raises(InputError, match="'xi'"):
        projection_uncertainty(camera(), C)


def test_coefficients_that_cancel_leave_a_rational_lens_as_sure_as_its_pixels() -> None:
    lens = Rational(k1=0.5, k2=0.1, p1=1e-4, p2=1e-4, k3=0.01, k4=0.9, k5=0.2, k6=0.03)
    truth = camera(fx=1000.0, fy=1000.0, distortion=lens)
    held = poses(BOARD, truth, 25, 1, roll_deg=180.0)
    found = estimate(observe(BOARD, truth, held, 0.05, 1), model="rational").calibration
    assert found.quality is not None
    assert found.quality.covariance is not None
    C = found.quality.covariance
    assert C.std["k4"] > 0.1

    stated = projection_uncertainty(found, C, shape=(9, 7)).std_px
    draws = np.random.default_rng(0).multivariate_normal(
        [values(found)[name] for name in C.names], C.matrix, size=60, method="eigh"
    )
    misses = [
        projection_difference(
            found, drawn(found, dict(zip(C.names, draw, strict=True))), shape=(9, 7)
        ).vectors
        for draw in draws
    ]
    inner = (slice(1, -1), slice(1, -1))
    scatter = np.sqrt(np.nanmean(np.square(misses), axis=0).sum(axis=-1))[inner]
    assert np.median(stated[inner]) < 0.1
    assert 0.5 < np.median(stated[inner] / scatter) < 2.0


def values(calibration: Calibration) -> dict[str, float]:
    K, lens = calibration.intrinsics, calibration.distortion
    assert lens is not None
    return {"fx": K.fx, "fy": K.fy, "cx": K.cx, "cy": K.cy, **lens.coefficients}


def drawn(calibration: Calibration, by_name: dict[str, float]) -> Calibration:
    """The same camera with other numbers."""
    fx, fy, cx, cy = (by_name[name] for name in ("fx", "fy", "cx", "cy"))
    lens = Rational(**{name: by_name[name] for name in Rational.names()})
    K = replace(calibration.intrinsics, fx=fx, fy=fy, cx=cx, cy=cy)
    return replace(calibration, intrinsics=K, distortion=lens)
