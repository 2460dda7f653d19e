"""Pix4D's fisheye, against its own formula in right angles and against OpenCV where the two meet."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibrary.distortion import MODELS, BrownConrady, FisheyePolynomial, KannalaBrandt, exact
from tests.thorough import examples

LENSES = st.builds(
    FisheyePolynomial, k2=st.floats(-0.1, 0.1), k3=st.floats(-0.1, 0.1), k4=st.floats(-0.05, 0.05)
)


def rays_to(angle: float, count: int = 400) -> NDArray[np.float64]:
    theta = np.linspace(0.0, angle, count)
    around = np.linspace(0.0, 40.0, count)
    return np.column_stack([np.sin(theta) * np.cos(around), np.sin(theta) * np.sin(around), np.cos(theta)])


def pix4d(p2: float, p3: float, rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """The white paper's formula, for a circle of radius 1 at 90°."""
    X, Y, Z = rays.T
    t = 2 / np.pi * np.arctan2(np.hypot(X, Y), Z)
    rho = t + p2 * t**2 + p3 * t**3
    R = np.maximum(np.hypot(X, Y), 1e-300)
    return np.stack([rho * X / R, rho * Y / R], axis=1)


def test_it_is_pix4ds_formula_counted_in_radians() -> None:
    p2, p3 = 0.0152646, -0.161096
    lens = FisheyePolynomial(k2=p2 * 2 / math.pi, k3=p3 * (2 / math.pi) ** 2)
    rays = rays_to(1.9)
    np.testing.assert_allclose(lens.distort_rays(rays), pix4d(p2, p3, rays) * math.pi / 2, rtol=0, atol=1e-14)


def test_without_even_powers_it_is_opencvs_fisheye() -> None:
    rays = rays_to(1.2)[1:]
    seen = FisheyePolynomial(k2=0.0, k3=-0.031).distort_rays(rays)
    D = np.array([-0.031, 0.0, 0.0, 0.0])
    by_cv2 = cv2.fisheye.projectPoints(rays[:, None], np.zeros(3), np.zeros(3), np.eye(3), D)[0].reshape(
        -1, 2
    )
    np.testing.assert_allclose(seen, by_cv2, rtol=0, atol=1e-14)


@settings(max_examples=examples(24), deadline=None)
@given(lens=LENSES)
def test_from_the_limit_on_there_is_nothing(lens: FisheyePolynomial) -> None:
    limit = lens.max_angle_rad()
    theta = np.array([0.999 * limit, 1.001 * limit])
    seen = lens.distort_rays(np.column_stack([np.sin(theta), np.zeros(2), np.cos(theta)]))
    assert np.isfinite(seen[0]).all()
    if limit < math.pi:
        assert np.isnan(seen[1]).all()
        slope = 1 + 2 * lens.k2 * theta + 3 * lens.k3 * theta**2 + 4 * lens.k4 * theta**3
        assert slope[0] > 0
        assert slope[1] < 1e-2


def test_it_sees_behind_itself_but_not_in_x_over_z() -> None:
    lens = FisheyePolynomial(k2=0.01, k3=-0.01)
    behind = np.array([[1.0, 0.0, -0.2]])
    assert np.isfinite(lens.distort_rays(behind)).all()
    assert np.isnan(lens.undistort(lens.distort_rays(behind))).all()
    assert lens.valid_radius() == math.inf


def test_it_and_kannala_brandt_hold_one_another_where_both_end_with_the_cube() -> None:
    lens = FisheyePolynomial(k2=0.0, k3=-0.031)
    kannala_brandt = KannalaBrandt(k1=-0.031, k2=0.0, k3=0.0, k4=0.0)
    assert exact(lens, KannalaBrandt) == kannala_brandt
    assert exact(kannala_brandt, FisheyePolynomial) == lens
    assert exact(FisheyePolynomial(k2=0.01, k3=0.0), KannalaBrandt) is None
    assert exact(KannalaBrandt(k1=0.1, k2=0.01, k3=0.0, k4=0.0), FisheyePolynomial) is None
    assert exact(lens, BrownConrady) is None


def test_files_and_reports_know_it_by_name() -> None:
    lens = FisheyePolynomial(k2=0.01, k3=-0.03, k4=0.001)
    assert MODELS["fisheye-polynomial"](**lens.coefficients) == lens
    assert lens.max_angle_rad() == pytest.approx(math.pi)
