"""What a larger model promises before it is adjusted."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.calib.estimation import estimate, solved_views
from calibrary.calib.lens_models import Solvable
from calibrary.calib.model_choice import PENALTY, Candidate, calmer, promised_gain
from calibrary.calib.network import Network
from calibrary.calib.projection_difference import projection_difference
from calibrary.calib.solve import solve
from calibrary.calib.synthesis import Shutter
from calibrary.distortion import KannalaBrandt

from .solving import SIZE, Session, camera, shoot


def test_the_gain_of_a_step_is_the_gradients_square_in_the_inverse_of_the_normal_matrix() -> None:
    rng = np.random.default_rng(4)
    A = rng.normal(size=(30, 4)) * [1.0, 1e3, 1e-3, 20.0]
    b = rng.normal(size=30)
    left = b - A @ np.linalg.lstsq(A, b, rcond=None)[0]
    assert promised_gain(A.T @ A, A.T @ b) == pytest.approx(b @ b - left @ left)


def test_a_direction_that_nothing_determines_promises_nothing() -> None:
    rng = np.random.default_rng(5)
    A = rng.normal(size=(30, 2))
    twice, b = A[:, [0, 1, 1]], rng.normal(size=30)
    assert promised_gain(twice.T @ twice, twice.T @ b) == pytest.approx(promised_gain(A.T @ A, A.T @ b))
    assert promised_gain(np.diag([1.0, 0.0]), np.ones(2)) == 0.0


def test_each_free_parameter_of_the_lens_costs_the_penalty_in_the_criterion() -> None:
    network = Network.of(shoot())
    solution = solve(network, SIZE)
    [brown] = solution.candidates
    by_residuals = network.scalars * np.log(brown.rms_px**2 / 2)
    assert brown.criterion - by_residuals == pytest.approx(len(solution.adjusted.free) * PENALTY, rel=1e-6)


def test_what_the_rational_lens_gains_counts_less_by_how_far_the_views_contradict_one_another() -> None:
    def candidate(model: Solvable, criterion: float) -> Candidate:
        return Candidate(model=model, rms_px=0.2, criterion=criterion, condition=1e6)

    # Three terms more, 16.2 of the criterion: it has gained 46.2, which are 15.4 where χ² counts three times.
    tried = [candidate(Solvable.BROWN, 0.0), candidate(Solvable.RATIONAL, -30.0)]
    assert calmer(tried, Solvable.RATIONAL, 2.8) is None
    found = calmer(tried, Solvable.RATIONAL, 3.0)
    assert found is not None
    assert found[0] is Solvable.BROWN
    assert found[1][1].refused == "gains less than the views contradict one another: variance factor 3.0"


@pytest.mark.thorough
def test_a_rational_lens_is_not_chosen_for_what_a_rolling_shutter_did() -> None:
    fisheye = camera(fx=1000.0, fy=1000.0, distortion=KannalaBrandt(k1=0.02, k2=-0.01, k3=0.001, k4=0.0))
    shutter = Shutter(readout_s=0.02, rate_deg_s=(3.0, -2.0, 1.0))
    seen = shoot(fisheye, Session(views=20, shutter=shutter), seed=16)
    assert solved_views(seen).solution.state.model is Solvable.RATIONAL
    result = estimate(seen)
    assert result.model is Solvable.FISHEYE
    assert projection_difference(fisheye, result.calibration).max_px < 5.0
