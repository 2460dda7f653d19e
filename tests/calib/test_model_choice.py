"""What a larger model promises before it is adjusted."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.calib.model_choice import PENALTY, promised_gain
from calibrary.calib.network import Network
from calibrary.calib.solve import solve

from .solving import SIZE, shoot


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
