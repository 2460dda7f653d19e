"""The term that a lens model leaves out: how far a pixel moves by its coefficient."""

from __future__ import annotations

import math

import numpy as np
import pytest

from calibrary.calib.lens_models import Solvable
from calibrary.calib.lens_series import next_term
from calibrary.calib.rig.estimation import _plane_points
from calibrary.calib.rig.lens import Place, RigLens

POINTS = np.random.default_rng(2).normal((0.0, 0.0, 900.0), 200.0, (20, 3))
BROWN = np.array([900.0, 910.0, 640.0, 480.0, -0.1, 0.05, 1e-3, -2e-3, 0.01])


@pytest.mark.parametrize(
    ("model", "denominator"), [(Solvable.BROWN, ()), (Solvable.RATIONAL, (0.3, 0.2, 0.1))]
)
def test_of_a_polynomial_it_is_the_ninth_power_of_the_radius(
    model: Solvable, denominator: tuple[float, ...]
) -> None:
    expected = []
    for X, Y, Z in POINTS.tolist():
        x, y = X / Z, Y / Z
        r = math.hypot(x, y)
        lens = r**8 / (1 + sum(k * r ** (2 * power) for power, k in enumerate(denominator, start=1)))
        expected += [900.0 * x * lens, 910.0 * y * lens]
    found = next_term(model, np.array([*BROWN, *denominator]), POINTS)
    np.testing.assert_allclose(found.ravel(), expected)


def test_of_a_fisheye_it_is_the_eleventh_power_of_the_angle() -> None:
    expected = []
    for X, Y, Z in POINTS.tolist():
        across = math.hypot(X, Y)
        lens = math.atan2(across, Z) ** 11
        expected += [900.0 * lens * X / across, 910.0 * lens * Y / across]
    found = next_term(Solvable.FISHEYE, np.array([900.0, 910.0, 640, 480, 0, 0, 0, 0]), POINTS)
    np.testing.assert_allclose(found.ravel(), expected)


def test_a_rigs_reference_sees_a_plane_across_its_axis_over_its_whole_image() -> None:
    place = Place(rotation=np.eye(3), translation=np.zeros(3))
    lens = RigLens(names=("a", "b"), models=(Solvable.BROWN, Solvable.BROWN), noise_px=(1.0, 1.0), corners=1)
    values = lens.of([BROWN, BROWN], [place])
    points = _plane_points(lens, BROWN, (1280, 960), 2000.0)
    np.testing.assert_allclose(points[:, 2], 2000.0)
    pixels = lens.project(values, np.repeat(points[:, None], 2, axis=1))[0][:, 0]
    assert (pixels > 0).all()
    assert (pixels < (1280, 960)).all()
    assert (np.ptp(pixels, axis=0) > 0.7 * np.array([1280, 960])).all()
