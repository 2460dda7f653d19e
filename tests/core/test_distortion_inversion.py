"""The searches behind undistort, one by one: each alone finds what the forward map came from, and nothing beyond."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.arrays import FloatArray
from calibrary.distortion import BrownConrady, Rational
from calibrary.distortion.opencv import OpenCVDistortion, _followed_down, monotonic_radius
from calibrary.distortion.polynomial import Inversion, Rising, inverse_of_rising, solved

LENSES = {
    "brown": BrownConrady(k1=-0.5, k2=0.02, p1=0.004, p2=-0.003),
    "rational": Rational(k1=-0.5, k2=0.02, p1=0.004, p2=-0.003, k3=0.0, k4=0.02, k5=0.01, k6=0.0),
}
DIRECTIONS = np.linspace(0, 2 * np.pi, 13)[:-1]


@pytest.fixture(params=LENSES)
def lens(request: pytest.FixtureRequest) -> OpenCVDistortion:
    return LENSES[request.param]


def test_the_patient_search_finds_every_point_up_to_the_limit(lens: OpenCVDistortion) -> None:
    formula = lens._lens()
    radius = monotonic_radius(formula)
    r, angle = np.meshgrid(radius * np.array([0.2, 0.6, 0.9, 0.99, 0.9999]), DIRECTIONS)
    x, y = (r * np.cos(angle)).ravel(), (r * np.sin(angle)).ravel()
    found = Inversion.of(formula, radius, 2.0).patient(*formula.image(x, y))
    np.testing.assert_allclose(found, (x, y), rtol=0, atol=1e-8)


@pytest.mark.parametrize("radius", [0.3, 0.6])
def test_a_point_that_is_solved_alone_lies_inside_the_disc(lens: OpenCVDistortion, radius: float) -> None:
    formula = lens._lens()
    for angle in DIRECTIONS:
        x, y = (float(side) * radius * 0.999 for side in (np.cos(angle), np.sin(angle)))
        u, v = formula.image(x, y)
        assert solved(formula, u, v, radius) == pytest.approx((x, y), abs=1e-12)
        u, v = formula.image(1.01 * x, 1.01 * y)
        assert solved(formula, u, v, radius) is None


def test_a_rising_function_is_inverted_from_a_poor_start_and_next_to_where_it_stops_rising() -> None:
    """With x = 100·at, 3x − x³ = 2·sin(3·asin(x/2)) rises up to 1; the limit is far from 1, as a pixel's may be."""
    wanted = np.concatenate([np.linspace(0.01, 1.999, 50), 2.0 - np.logspace(-3, -12, 10)])

    def miss_and_step(at: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
        x = 100 * at
        miss = 3 * x - x**3 - value
        with np.errstate(divide="ignore", invalid="ignore"):
            return miss, miss / (3 - 3 * x**2) / 100

    nodes = np.linspace(0, 1, 500)
    good = Rising.of(nodes / 100, 3 * nodes - nodes**3)
    poor = Rising(good.limit, good.top, np.full_like(good.starts, good.limit * (1 - 1e-9)))
    for table in (good, poor):
        found = 100 * inverse_of_rising(wanted, table, miss_and_step)
        np.testing.assert_allclose(found, 2 * np.sin(np.arcsin(wanted / 2) / 3), rtol=0, atol=3e-8)


@pytest.mark.parametrize("lowest", [0.03, 0.4321, 0.5, 0.97])
def test_a_dip_is_followed_to_its_lowest_point_or_to_where_it_fails(lowest: float) -> None:
    assert _followed_down(lambda r: (r - lowest) ** 2 + 0.1, 0.0, 1.0) == pytest.approx(lowest, abs=1e-6)
    failing = _followed_down(lambda r: (r - lowest) ** 2 - 1e-8, 0.0, 1.0)
    assert abs(failing - lowest) <= 1e-4
