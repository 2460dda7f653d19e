"""The family of models: what they are called, what they hold, what they refuse."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibrary.distortion import (
    MODELS,
    BrownConrady,
    Distortion,
    KannalaBrandt,
    NoDistortion,
    Rational,
    ThinPrism,
    Tilted,
    distortion_from,
)
from calibrary.errors import InputError, UnsupportedModelError
from tests.strategies import any_distortions

OPENCVS = (BrownConrady, Rational, ThinPrism, Tilted, KannalaBrandt)
OPENCV_ORDER = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")


def test_the_family_is_known_by_these_names() -> None:
    assert (
        dict(MODELS).items()
        >= {
            "none": NoDistortion,
            "brown": BrownConrady,
            "rational": Rational,
            "thin-prism": ThinPrism,
            "tilted": Tilted,
            "kannala-brandt": KannalaBrandt,
        }.items()
    )


@pytest.mark.parametrize(("kind", "count"), [(BrownConrady, 5), (Rational, 8), (ThinPrism, 12), (Tilted, 14)])
def test_coefficients_stand_in_opencvs_order(kind: type[Distortion], count: int) -> None:
    assert kind.names() == OPENCV_ORDER[:count]


def test_coefficients_are_given_back_by_name() -> None:
    assert KannalaBrandt(k1=1 / 3, k2=0.1, k3=0, k4=-0.2).coefficients == {
        "k1": 1 / 3,
        "k2": 0.1,
        "k3": 0.0,
        "k4": -0.2,
    }


@given(any_distortions())
def test_a_model_is_rebuilt_from_its_name_and_coefficients(lens: Distortion) -> None:
    assert distortion_from(lens.model, lens.coefficients) == lens


@given(any_distortions())
def test_a_model_survives_pickling(lens: Distortion) -> None:
    assert pickle.loads(pickle.dumps(lens)) == lens  # noqa: S301 - our own bytes


def test_four_brown_coefficients_are_five_with_k3_zero() -> None:
    four = {"k1": -0.1, "k2": 0.02, "p1": 1e-3, "p2": -1e-3}
    assert distortion_from("brown", four) == BrownConrady(**four, k3=0.0)


@pytest.mark.parametrize("model", ["rational", "thin-prism", "tilted", "kannala-brandt"])
def test_no_other_model_takes_a_missing_coefficient_for_zero(model: str) -> None:
    some = dict.fromkeys(MODELS[model].names()[:-1], 0.0)
    with pytest.raises(InputError, match=f"lacks {MODELS[model].names()[-1]}"):
        distortion_from(model, some)


def test_a_coefficient_the_model_has_not_got_is_refused() -> None:
    with pytest.raises(InputError, match="no coefficient k7, b1; it has k1, k2, p1, p2, k3"):
        distortion_from("brown", {"k1": 0, "k2": 0, "p1": 0, "p2": 0, "k7": 0, "b1": 0})


def test_an_unknown_model_is_refused_by_name() -> None:
    with pytest.raises(UnsupportedModelError, match=r"'plumb_bob' is not known.*brown, rational"):
        distortion_from("plumb_bob", {})


@pytest.mark.parametrize("value", [math.nan, math.inf, "0.1", None, True, 10**400, 1j, [0.1]])
def test_a_coefficient_that_is_no_finite_number_is_refused(value: object) -> None:
    with pytest.raises(InputError, match="k2 of the brown model is") as caught:
        BrownConrady(k1=0.0, k2=value, p1=0.0, p2=0.0)  # type: ignore[arg-type] # that is the point
    assert caught.value.place == "k2"


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


@settings(max_examples=40)
@given(any_distortions())
def test_what_is_not_a_number_stays_none_without_a_warning(lens: Distortion) -> None:
    bad = np.array([[math.nan, 0.1], [0.1, math.nan], [math.inf, 0.1], [-0.1, -math.inf], [1e200, -1e308]])
    for answer in (lens.distort(bad), lens.undistort(bad)):
        assert np.isnan(answer[:4]).all()
        assert np.isnan(answer[4]).all() or np.isfinite(answer[4]).all()


@settings(max_examples=40)
@given(any_distortions())
def test_no_points_give_no_points(lens: Distortion) -> None:
    none = np.empty((0, 2))
    assert lens.distort(none).shape == lens.undistort(none).shape == (0, 2)
    assert lens.undistort_to_rays(none).shape == (0, 3)
    assert lens.distort_rays(np.empty((0, 3))).shape == (0, 2)


@settings(max_examples=40)
@given(any_distortions())
def test_the_axis_is_not_moved(lens: Distortion) -> None:
    axis = np.zeros((1, 2))
    assert np.abs(lens.distort(axis)).max() <= 1e-16
    assert np.abs(lens.undistort(axis)).max() <= 1e-16


@settings(max_examples=40)
@given(any_distortions(), st.integers(1, 2))
def test_points_given_are_left_as_they_were(lens: Distortion, count: int) -> None:
    # One row transposed is contiguous as it is, so that a careless copy is none.
    points = np.array([[math.inf, 0.2], [math.nan, 0.0]])[:count]
    rays = np.array([[0.1, 0.2, -1.0], [math.nan, 0.0, 1.0]])[:count]
    kept = points.copy(), rays.copy()
    lens.distort(points)
    lens.undistort(points)
    lens.undistort_to_rays(points)
    lens.distort_rays(rays)
    assert np.array_equal(points, kept[0], equal_nan=True)
    assert np.array_equal(rays, kept[1], equal_nan=True)


def test_an_array_of_another_shape_is_named() -> None:
    with pytest.raises(InputError, match=r"shape \(2, 3\), wanted \(N, 2\)"):
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
