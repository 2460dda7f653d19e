"""The sphere models and the field-of-view model, against their papers' formulas and against COLMAP."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibrary.distortion import (
    BrownConrady,
    Distortion,
    DoubleSphere,
    ExtendedUnified,
    FieldOfView,
    NoDistortion,
    Unified,
    exact,
)
from calibrary.errors import InputError
from tests.core.lens_models import LENS_MODELS
from tests.strategies import DISTORTIONS
from tests.thorough import examples

Array = NDArray[np.float64]

QUICK = settings(max_examples=examples(24), deadline=None)


def rays(lens: Distortion, share: float = 1.0) -> Array:
    """Directions up to a share of the model's own field of view, of many lengths."""
    angle, around = np.meshgrid(
        np.linspace(0, share, 41) * lens.max_angle_rad(), np.linspace(0, 2 * np.pi, 37)
    )
    length = 0.1 + np.arange(angle.size) % 7
    unit = [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)]
    return np.stack([c.ravel() * length for c in unit], axis=1)


def unit(directions: Array) -> Array:
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


@QUICK
@given(lens=st.one_of(DISTORTIONS["extended-unified"], DISTORTIONS["double-sphere"]))
def test_the_image_grows_up_to_the_widest_angle_and_no_further(lens: Distortion) -> None:
    widest = lens.max_angle_rad()
    angle = np.linspace(1e-3, 1.0, 4000) * widest * (1 - 1e-6)

    projects = LENS_MODELS[lens.model].projects
    assert projects is not None

    def formula(rays: Array) -> Array:
        return projects(SimpleNamespace(**lens.coefficients), rays)

    along = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=1)
    assert (np.diff(formula(along)[:, 0]) > 0).all()
    if widest < math.pi * 0.999:
        at, beyond = (
            formula(np.array([[math.sin(a), 0.0, math.cos(a)]]))[0, 0]
            for a in (widest * (1 - 1e-4), widest * (1 + 1e-4))
        )
        # It turns back, runs to infinity and comes from the other side, or stands there.
        assert beyond <= at * (1 + 1e-7)


def test_a_ray_past_ninety_degrees_has_no_plane_coordinates() -> None:
    lens = DoubleSphere(xi=-0.2, alpha=0.6)
    behind = np.array([[1.0, 0.3, -0.2]])
    distorted = lens.distort_rays(behind)
    assert np.isfinite(distorted).all()
    assert np.isnan(lens.undistort(distorted)).all()
    assert lens.valid_radius() == math.inf


def test_a_pixel_outside_the_image_circle_sees_nothing() -> None:
    lens = ExtendedUnified(alpha=0.6, beta=1.1)
    edge = 1 / math.sqrt((2 * 0.6 - 1) * 1.1)
    assert np.isfinite(lens.undistort_to_rays(np.array([[0.999 * edge, 0.0]]))).all()
    assert np.isnan(
        lens.undistort_to_rays(np.array([[1.001 * edge, 0.0], [np.nan, 0.0], [np.inf, 0.0]]))
    ).all()


def test_seen_from_outside_the_sphere_its_outline_is_the_edge() -> None:
    assert Unified(xi=2.0).max_angle_rad() == pytest.approx(math.radians(120))
    assert Unified(xi=0.5).max_angle_rad() == pytest.approx(math.radians(120))
    assert Unified(xi=1.0).max_angle_rad() == pytest.approx(math.pi)


@pytest.mark.parametrize(
    "lens",
    [DoubleSphere(xi=-1.0, alpha=0.5), Unified(xi=-1.3), ExtendedUnified(alpha=0.4, beta=-0.1)],
    ids=repr,
)
def test_coefficients_that_make_no_camera_see_nothing(lens: Distortion) -> None:
    assert lens.max_angle_rad() == 0.0
    assert lens.valid_radius() == 0.0
    assert np.isnan(lens.distort_rays(np.array([[0.0, 0.1, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, -1.0]]))).all()
    assert np.isnan(lens.undistort_to_rays(np.array([[0.0, 0.0], [0.1, 0.1]]))).all()


@QUICK
@given(omega=st.floats(-3.1, 3.1))
def test_the_field_of_view_model_is_its_formula_and_its_inverse(omega: float) -> None:
    lens = FieldOfView(omega=omega)
    r = np.geomspace(1e-6, 20.0, 60)
    distorted = lens.distort(np.column_stack([0.6 * r, 0.8 * r]))
    expected = np.arctan(2 * r * math.tan(omega / 2)) / omega if abs(omega) > 1e-10 else r
    np.testing.assert_allclose(np.hypot(*distorted.T), expected, rtol=1e-12)
    back = lens.undistort(distorted)
    # Towards 90° the image hardly grows any more.
    np.testing.assert_allclose(back, np.column_stack([0.6 * r, 0.8 * r]), rtol=1e-10 * (1 + 2e3 * abs(omega)))


def test_the_field_of_view_model_ends_at_the_image_of_ninety_degrees() -> None:
    lens = FieldOfView(omega=1.2)
    edge = math.pi / 2 / 1.2
    assert np.isfinite(lens.undistort(np.array([[0.999 * edge, 0.0]]))).all()
    assert np.isnan(lens.undistort(np.array([[1.001 * edge, 0.0], [np.nan, 0.0]]))).all()
    np.testing.assert_array_equal(lens.distort(np.zeros((1, 2))), np.zeros((1, 2)))


def test_an_angle_in_degrees_is_refused() -> None:
    with pytest.raises(InputError, match="degrees"):
        FieldOfView(omega=53.0)


@pytest.mark.parametrize(
    ("lens", "same"),
    [
        (DoubleSphere(xi=0.0, alpha=0.55), ExtendedUnified(alpha=0.55, beta=1.0)),
        (DoubleSphere(xi=0.7, alpha=0.0), Unified(xi=0.7)),
        (DoubleSphere(xi=0.0, alpha=0.0), NoDistortion()),
        (
            Unified(xi=0.0, k1=-0.1, k2=0.02, p1=1e-3, p2=2e-3),
            BrownConrady(k1=-0.1, k2=0.02, p1=1e-3, p2=2e-3),
        ),
        (ExtendedUnified(alpha=0.0, beta=1.0), NoDistortion()),
        (FieldOfView(omega=0.0), NoDistortion()),
    ],
    ids=repr,
)
def test_a_special_case_is_another_model_exactly_both_ways(lens: Distortion, same: Distortion) -> None:
    assert exact(lens, type(same)) == same
    assert exact(same, type(lens)) == lens
    seen = rays(same, 0.8)[:300]
    np.testing.assert_allclose(lens.distort_rays(seen), same.distort_rays(seen), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(
    "lens",
    [
        DoubleSphere(xi=-0.2, alpha=0.55),
        ExtendedUnified(alpha=0.5, beta=1.2),
        Unified(xi=0.7, k1=-0.1, k2=0.02, p1=1e-3, p2=2e-3),
        FieldOfView(omega=0.9),
    ],
    ids=repr,
)
def test_a_general_one_is_no_other_model(lens: Distortion) -> None:
    others = (NoDistortion, BrownConrady, DoubleSphere, ExtendedUnified, Unified, FieldOfView)
    assert [exact(lens, kind) for kind in others if kind is not type(lens)] == [None] * 5
