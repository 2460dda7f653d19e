"""Scaramuzza's model, against the toolbox's cam2world written out, and its own inverse."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary.distortion.scaramuzza import Scaramuzza


def image_to(radius: float, count: int = 400) -> NDArray[np.float64]:
    s, around = np.linspace(0.0, radius, count), np.linspace(0.0, 40.0, count)
    return np.column_stack([s * np.cos(around), s * np.sin(around)])


def test_it_is_the_toolboxs_cam2world_in_units_of_the_focal_length() -> None:
    a = (-325.9, 0.0, 8.6e-4, -3.5e-8, 6.7e-9)
    f = -a[0]
    lens = Scaramuzza(c2=-a[2] * f, c3=-a[3] * f**2, c4=-a[4] * f**3)
    px = image_to(400.0)
    rho = np.hypot(*px.T)
    backwards = a[0] + a[1] * rho + a[2] * rho**2 + a[3] * rho**3 + a[4] * rho**4
    expected = np.column_stack([px, -backwards])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(lens.undistort_to_rays(px / f), expected, rtol=0, atol=1e-14)
    assert lens.max_angle_rad() > math.pi / 2


def test_past_the_limit_nothing_is_seen() -> None:
    lens = Scaramuzza(c2=0.5, c3=0.0, c4=0.0)
    limit = math.sqrt(2.0)
    assert lens.max_angle_rad() == pytest.approx(math.atan2(limit, 2.0))
    assert lens.valid_radius() == pytest.approx(limit / 2)
    assert np.isnan(lens.undistort_to_rays(np.array([[limit * 1.01, 0.0]]))).all()
    assert np.isnan(lens.distort_rays(np.array([[0.8, 0.0, 1.0], [math.nan, 0, 1], [0, 0, -1]]))).all()


def test_rays_past_a_right_angle_are_seen() -> None:
    lens = Scaramuzza(c2=-0.5, c3=0.0, c4=0.0)
    [[x, y]] = lens.distort_rays(np.array([[1.0, 0.0, -0.5]]))
    assert x == pytest.approx(2.0, rel=1e-14)  # −s/2 = 1 − s²/2
    assert y == 0.0
