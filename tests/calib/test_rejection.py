"""Corners that are no corners, found among those that are."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.calib.lens_models import Solvable
from calibrary.calib.network import Network
from calibrary.calib.rejection import Gate, screened
from calibrary.calib.solve import solve
from tests.calib.solving import Session, moved, shoot


def test_a_small_outlier_does_not_hide_behind_the_large_ones_of_its_view() -> None:
    clean = shoot(how=Session(views=10), seed=3)
    adjusted = solve(Network.of(clean), clean.image_size, model=Solvable.BROWN, warp=False).adjusted
    by = np.zeros((88, 2))
    # Three corners that turn the pose of the view, and one six and a half standard deviations off.
    by[[0, 1, 11]], by[50] = (30.0, -30.0), (0.23, 0.23)
    seen = screened(Network.of(moved(clean, 4, by)), adjusted, Gate())
    assert np.argwhere(~seen).tolist() == [[4, 0], [4, 1], [4, 11], [4, 50]]


@pytest.mark.parametrize(("sigmas", "is_kept"), [(4.5, True), (5.75, False)])
def test_a_corner_of_a_blurred_view_is_judged_by_the_noise_of_its_view(
    sigmas: float, *, is_kept: bool
) -> None:
    clean = shoot(how=Session(views=10), seed=3)
    adjusted = solve(Network.of(clean), clean.image_size, model=Solvable.BROWN, warp=False).adjusted
    by = np.random.default_rng(1).normal(0.0, 0.5, (88, 2))
    by[50] = (0.5 * sigmas, 0.0)
    # As a whole the view is no outlier among others that may be as bad.
    seen = screened(Network.of(moved(clean, 4, by)), adjusted, Gate(most_views=0.0))
    assert seen[4, 50] == is_kept
    assert seen.sum() >= seen.size - 1
