"""The family of models: what they are called, what they hold, what they refuse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from calibrary.distortion import (
    BrownConrady,
    Distortion,
    KannalaBrandt,
    NoDistortion,
    Rational,
    ThinPrism,
    Tilted,
)
from calibrary.errors import InputError

OPENCVS = (BrownConrady, Rational, ThinPrism, Tilted, KannalaBrandt)
OPENCV_ORDER = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")


def test_coefficients_are_given_back_by_name() -> None:
    assert KannalaBrandt(k1=1 / 3, k2=0.1, k3=0, k4=-0.2).coefficients == {
        "k1": 1 / 3,
        "k2": 0.1,
        "k3": 0.0,
        "k4": -0.2,
    }


def test_four_brown_coefficients_are_five_with_k3_zero() -> None:
    four = {"k1": -0.1, "k2": 0.02, "p1": 1e-3, "p2": -1e-3}
    assert BrownConrady(**four) == BrownConrady(**four, k3=0.0)


def test_numpy_numbers_become_floats() -> None:
    lens = BrownConrady(k1=np.float32(0.25), k2=np.int64(0), p1=0, p2=0)  # type: ignore[arg-type] # as files yield
    assert all(type(value) is float for value in lens.coefficients.values())


def test_a_sensor_tilted_by_90_degrees_is_refused() -> None:
    zeros = dict.fromkeys(OPENCV_ORDER, 0.0)
    with pytest.raises(InputError, match="is it in degrees"):
        Tilted(**{**zeros, "tau_x": 1.6})


def test_a_model_cannot_be_changed() -> None:
    lens = BrownConrady(k1=0.1, k2=0, p1=0, p2=0)
    with pytest.raises(AttributeError, match="immutable"):
        lens.k1 = 0.2  # type: ignore[misc] # that is the point


def test_an_array_of_another_shape_is_named() -> None:
    with pytest.raises(InputError, match=r"shape \(2, 3\), expected \(N, 2\)"):
        NoDistortion().distort(np.zeros((2, 3)))


@pytest.mark.parametrize("huge", [1e30, -1e30, 1e300, -1e308, 5e-324])
@pytest.mark.parametrize("kind", OPENCVS)
def test_absurd_coefficients_neither_warn_nor_hang(kind: type[Distortion], huge: float) -> None:
    values = [huge / 3**i for i in range(14)]
    lens = kind(**{n: 0.3 if n.startswith("tau") else v for n, v in zip(kind.names(), values, strict=False)})
    assert lens.valid_radius() >= 0
    assert 0 <= lens.max_angle_rad() <= math.pi
    points = np.array([[0.0, 0.1], [1e-3, -2.0], [1e5, 3e5]])
    undistorted = lens.undistort(points)
    assert not (np.hypot(*undistorted.T) > lens.valid_radius()).any()
    lens.distort(points)
