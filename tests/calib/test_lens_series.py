"""What a lens model leaves out is part of σ: little where corners were seen, all of the prior where none were."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.calib.assessment import MAP_SHAPE
from calibrary.calib.estimation import estimate
from calibrary.calib.lens_models import Solvable
from calibrary.calib.lens_series import series_shift
from calibrary.calib.network import Network
from calibrary.calib.observations import Observations
from calibrary.calib.projection_difference import projection_difference, projection_uncertainty
from calibrary.calib.solve import solve
from calibrary.calibration import Calibration, Covariance
from calibrary.distortion import Rational

from .solving import SIZE, Session, camera, shoot

OUTSIDE_BROWN = camera(
    distortion=Rational(k1=0.25, k2=0.02, p1=2e-4, p2=-2e-4, k3=0.001, k4=0.5, k5=0.06, k6=0.002)
)
STRONG = camera(
    fx=1000.0,
    fy=1000.0,
    distortion=Rational(k1=1.2, k2=0.25, p1=2e-4, p2=-2e-4, k3=0.005, k4=1.55, k5=0.5, k6=0.03),
)
TWENTY = Session(views=20)


def _errors(seen: Observations, truth: Calibration) -> tuple[np.ndarray, np.ndarray]:
    """Px over the frame: the true error, and σ as it is stated; NaN where none is."""
    found = estimate(seen).calibration
    assert found.quality is not None
    assert found.quality.covariance is not None
    C = found.quality.covariance
    stated = Covariance.from_matrix(C.names, C.matrix * found.quality.inflation)
    exact = Covariance.from_matrix(("fx",), [[0.0]])
    apart = projection_difference(found, truth, shape=MAP_SHAPE, covariances=(stated, exact))
    assert apart.std_px is not None
    return apart.lengths_px, apart.std_px


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [10, 15, 64])
def test_a_lens_outside_brown_stays_within_3_sigma_in_the_corners_too(seed: int) -> None:
    error, std = _errors(shoot(OUTSIDE_BROWN, TWENTY, seed), OUTSIDE_BROWN)
    assert np.nanmax(error) > 3
    assert np.nanmax(error / np.hypot(std, 0.01)) < 3


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 9])
def test_a_strong_rational_lens_is_uncertain_where_no_corner_was_seen(seed: int) -> None:
    error, std = _errors(shoot(STRONG, TWENTY, seed), STRONG)
    known = std <= 10
    assert np.max(error[known] / np.hypot(std[known], 0.01)) < 3
    assert np.max(error[known]) < 3
    assert not known.all()


def test_the_next_term_costs_little_where_corners_were_seen_and_much_where_none_were() -> None:
    seen = shoot(how=Session(views=20, reach=0.7), seed=2)
    adjusted = solve(Network.of(seen), SIZE, model=Solvable.BROWN, warp=False).adjusted
    shift = series_shift(adjusted, SIZE)
    assert shift is not None
    values = dict(zip(Solvable.BROWN.parameters, adjusted.state.parameters.tolist(), strict=True))
    calibration = camera(distortion=Solvable.BROWN.distortion(values))
    bend = Covariance.from_matrix(Solvable.BROWN.parameters, np.outer(shift, shift))
    std = projection_uncertainty(calibration, bend, shape=MAP_SHAPE).std_px
    assert std[3:10, 5:12].max() < 0.1
    assert std[0, 0] > 1


def test_a_model_that_was_asked_for_by_name_has_no_next_term() -> None:
    adjusted = solve(Network.of(shoot(how=TWENTY)), SIZE, model=Solvable.K1K2, warp=False).adjusted
    assert series_shift(adjusted, SIZE) is None
