"""The sphere models and the field-of-view model, against their papers' formulas and against COLMAP."""

from __future__ import annotations

import math

import numpy as np
import pycolmap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    DoubleSphere,
    ExtendedUnified,
    FieldOfView,
    NoDistortion,
    Unified,
    distortion_from,
)
from calibrary.distortion.equivalence import exact
from calibrary.errors import InputError

Array = NDArray[np.float64]

ALPHA = st.floats(0.0, 1.0)
BETA = st.floats(0.05, 3.0)
SMALL = st.floats(-0.2, 0.2)
TANGENTIAL = st.floats(-0.01, 0.01)
EXTENDED = st.builds(ExtendedUnified, alpha=ALPHA, beta=BETA)
DOUBLE = st.builds(DoubleSphere, xi=st.floats(-0.9, 1.5), alpha=ALPHA)
UNIFIED = st.builds(Unified, xi=st.floats(-0.8, 2.5), k1=SMALL, k2=SMALL, p1=TANGENTIAL, p2=TANGENTIAL)
LENSES = st.one_of(EXTENDED, DOUBLE, UNIFIED)
QUICK = settings(max_examples=60, deadline=None)


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


def formula(lens: Distortion, P: Array) -> Array:
    X, Y, Z = P.T
    d1 = np.sqrt(X**2 + Y**2 + Z**2)
    if isinstance(lens, ExtendedUnified):
        d = np.sqrt(lens.beta * (X**2 + Y**2) + Z**2)
        divisor = lens.alpha * d + (1 - lens.alpha) * Z
    elif isinstance(lens, DoubleSphere):
        k = lens.xi * d1 + Z
        d2 = np.sqrt(X**2 + Y**2 + k**2)
        divisor = lens.alpha * d2 + (1 - lens.alpha) * k
    else:
        assert isinstance(lens, Unified)
        x, y = X / (Z + lens.xi * d1), Y / (Z + lens.xi * d1)
        r2 = x**2 + y**2
        radial = 1 + lens.k1 * r2 + lens.k2 * r2**2
        return np.stack(
            [
                x * radial + 2 * lens.p1 * x * y + lens.p2 * (r2 + 2 * x**2),
                y * radial + lens.p1 * (r2 + 2 * y**2) + 2 * lens.p2 * x * y,
            ],
            axis=1,
        )
    return np.stack([X / divisor, Y / divisor], axis=1)


@QUICK
@given(lens=LENSES)
def test_it_observes_by_its_formula_inside_its_field_of_view(lens: Distortion) -> None:
    seen = rays(lens, 0.98)
    np.testing.assert_allclose(lens.distort_rays(seen), formula(lens, seen), rtol=1e-10, atol=1e-13)


@QUICK
@given(lens=LENSES)
def test_every_ray_comes_back_from_where_it_is_seen(lens: Distortion) -> None:
    seen = rays(lens, 0.9)
    np.testing.assert_allclose(
        lens.undistort_to_rays(lens.distort_rays(seen)), unit(seen), rtol=0, atol=1e-11
    )


@QUICK
@given(lens=st.one_of(EXTENDED, DOUBLE))
def test_the_image_grows_up_to_the_widest_angle_and_no_further(lens: Distortion) -> None:
    widest = lens.max_angle_rad()
    angle = np.linspace(1e-3, 1.0, 4000) * widest * (1 - 1e-6)
    along = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=1)
    assert (np.diff(formula(lens, along)[:, 0]) > 0).all()
    if widest < math.pi * 0.999:
        at, beyond = (
            formula(lens, np.array([[math.sin(a), 0.0, math.cos(a)]]))[0, 0]
            for a in (widest * (1 - 1e-4), widest * (1 + 1e-4))
        )
        # It turns back, runs to infinity and comes from the other side, or stands there.
        assert beyond <= at * (1 + 1e-7)


@QUICK
@given(lens=LENSES)
def test_beyond_the_widest_angle_nothing_is_seen(lens: Distortion) -> None:
    widest = lens.max_angle_rad()
    angle = np.linspace(widest * (1 + 1e-9), math.pi, 20)
    beyond = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=1)
    if widest < math.pi * 0.999:
        assert np.isnan(lens.distort_rays(beyond)).all()
    assert np.isnan(
        lens.distort_rays(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [np.nan, 0.0, 1.0]]))
    ).all()


@QUICK
@given(lens=LENSES)
def test_what_is_in_front_is_said_in_plane_coordinates_too(lens: Distortion) -> None:
    xy = rays(lens, 0.9)
    xy = xy[xy[:, 2] > 0.05]
    xy = xy[:, :2] / xy[:, 2:]
    xy = xy[np.hypot(*xy.T) < 0.9 * lens.valid_radius()]
    distorted = lens.distort(xy)
    np.testing.assert_allclose(distorted, lens.distort_rays(np.column_stack([xy, np.ones(len(xy))])))
    np.testing.assert_allclose(lens.undistort(distorted), xy, rtol=0, atol=1e-8)


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


def colmap(model: str, *parameters: float) -> pycolmap.Camera:
    camera = pycolmap.Camera.create_from_model_name(1, model, 3650.1, 5472, 3648)
    camera.params = [3650.1, 3648.7, 2741.3, 1815.9, *parameters]
    return camera


@pytest.mark.parametrize(
    ("lens", "peer"),
    [
        (ExtendedUnified(alpha=0.61, beta=1.13), colmap("EUCM", 0.61, 1.13)),
        (ExtendedUnified(alpha=0.31, beta=0.83), colmap("EUCM", 0.31, 0.83)),
        (FieldOfView(omega=0.93), colmap("FOV", 0.93)),
    ],
    ids=["eucm", "eucm below one half", "fov"],
)
def test_it_projects_as_colmap_does(lens: Distortion, peer: pycolmap.Camera) -> None:
    size = (5472, 3648)
    ours = Calibration(
        camera=CameraKey(image_size=size),
        intrinsics=Intrinsics(fx=3650.1, fy=3648.7, cx=2741.3, cy=1815.9, image_size=size),
        distortion=lens,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="test"),
    )
    x, y = np.meshgrid(np.linspace(-1.5, 1.5, 41), np.linspace(-1.2, 1.2, 41))
    points = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])
    pixels = ours.project(points)
    np.testing.assert_allclose(pixels, np.asarray(peer.img_from_cam(points)), rtol=0, atol=1e-9)
    back = ours.unproject(pixels)
    np.testing.assert_allclose(
        back[:, :2] / back[:, 2:], np.asarray(peer.cam_from_img(pixels)), rtol=0, atol=1e-12
    )


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
    assert distortion_from(lens.model, lens.coefficients) == lens
