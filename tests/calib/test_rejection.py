"""Corners that are no corners, found among those that are."""

from __future__ import annotations

import numpy as np

from calibrary.calib.lens_models import Solvable
from calibrary.calib.network import Network
from calibrary.calib.rejection import Gate, screened
from calibrary.calib.solve import solve
from tests.calib.solving import Session, moved, shoot


def test_a_small_outlier_does_not_hide_behind_the_large_ones_of_its_view() -> None:
    clean = shoot(how=Session(views=10), seed=3)
    adjusted = solve(Network.of(clean), clean.image_size, model=Solvable.BROWN, warp=False).adjusted
    by = np.zeros((88, 2))
    # Three corners that turn the pose of the view, and one ten standard deviations off.
    by[[0, 1, 11]], by[50] = (30.0, -30.0), (0.4, 0.4)
    seen = screened(Network.of(moved(clean, 4, by)), adjusted, Gate())
    assert np.argwhere(~seen).tolist() == [[4, 0], [4, 1], [4, 11], [4, 50]]
