"""The division model and the fisheyes with tangential and prism terms, against COLMAP and their formulas."""

from __future__ import annotations

import math

import numpy as np
import pycolmap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibrary.calibration import Intrinsics
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    Division,
    Fisheye624,
    KannalaBrandt,
    NoDistortion,
    RadTanThinPrismFisheye,
    ThinPrismFisheye,
    distortion_from,
)
from calibrary.distortion.equivalence import exact
from tests.strategies import calibration

Array = NDArray[np.float64]
QUICK = settings(max_examples=30, deadline=None)
SIZE = (5472, 3648)
K = Intrinsics(fx=1650.1, fy=1648.7, cx=2741.3, cy=1815.9, image_size=SIZE)

THIN_PRISM = ThinPrismFisheye(
    k1=0.031, k2=-0.0072, p1=0.00031, p2=-0.00087, k3=0.0041, k4=-0.0011, sx1=0.0012, sy1=-0.0007
)
ARIA = RadTanThinPrismFisheye(
    k0=0.031, k1=-0.0072, k2=0.0041, k3=-0.0011, k4=0.00031, k5=-0.00007,
    p0=0.00031, p1=-0.00087, s0=0.0012, s1=-0.00021, s2=-0.0007, s3=0.00017,
)  # fmt: skip
OPENSFM = Fisheye624(
    k1=0.031, k2=-0.0072, k3=0.0041, k4=-0.0011, k5=0.00031, k6=-0.00007,
    p1=0.00031, p2=-0.00087, s0=0.0012, s1=-0.00021, s2=-0.0007, s3=0.00017,
)  # fmt: skip
FISHEYES = (THIN_PRISM, ARIA, OPENSFM)
DIVISIONS = (Division(k=-0.117), Division(k=0.083), Division(k=0.0))


def small(kind: type[Distortion]) -> st.SearchStrategy[Distortion]:
    limits = {name: 0.004 if name[0] in "ps" else 0.03 / (2 + int(name[1])) for name in kind.names()}
    return st.builds(kind, **{name: st.floats(-limit, limit) for name, limit in limits.items()})


WEAK = st.floats(-0.5, 0.5).filter(lambda k: not 0 < abs(k) < 1e-100)
LENSES = st.one_of(
    st.builds(Division, k=WEAK),
    *(small(type(fisheye)) for fisheye in FISHEYES),
)


def cone(widest_rad: float) -> Array:
    """Directions of many lengths up to an angle from the axis."""
    angle, around = np.meshgrid(np.linspace(0, widest_rad, 41), np.linspace(0, 2 * np.pi, 37))
    length = 0.1 + np.arange(angle.size) % 7
    unit = [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)]
    return np.stack([c.ravel() * length for c in unit], axis=1)


def unit(directions: Array) -> Array:
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def colmap(lens: Distortion) -> pycolmap.Camera:
    model = {"division": "DIVISION"}.get(lens.model, lens.model.upper().replace("-", "_"))
    camera = pycolmap.Camera.create_from_model_name(1, model, K.fx, *SIZE)
    camera.params = [K.fx, K.fy, K.cx, K.cy, *lens.coefficients.values()]
    return camera


@pytest.mark.parametrize("lens", [*DIVISIONS[:2], THIN_PRISM, ARIA], ids=lambda lens: lens.model)
def test_it_projects_as_colmap_does(lens: Distortion) -> None:
    points = cone(min(1.4, 0.95 * lens.max_angle_rad()))
    pixels = calibration(K, lens).project(points)
    np.testing.assert_allclose(pixels, np.asarray(colmap(lens).img_from_cam(points)), rtol=0, atol=1e-9)


def opensfm(c: dict[str, float], rays: Array) -> Array:
    """OpenSfM's Disto624 on its FisheyeProjection, term by term."""
    X, Y, Z = rays.T
    r = np.hypot(X, Y)
    theta_over_r = np.arctan2(r, Z) / np.where(r == 0, 1, r)
    x, y = theta_over_r * X, theta_over_r * Y
    r2 = x**2 + y**2
    radial = 1 + r2 * (
        c["k1"] + r2 * (c["k2"] + r2 * (c["k3"] + r2 * (c["k4"] + r2 * (c["k5"] + r2 * c["k6"]))))
    )
    dx = 2 * c["p1"] * x * y + c["p2"] * (r2 + 2 * x**2) + c["s0"] * r2 + c["s1"] * r2**2
    dy = 2 * c["p2"] * x * y + c["p1"] * (r2 + 2 * y**2) + c["s2"] * r2 + c["s3"] * r2**2
    return np.stack([x * radial + dx, y * radial + dy], axis=1)


def test_opensfms_fisheye_follows_its_source_past_ninety_degrees() -> None:
    points = cone(0.99 * OPENSFM.max_angle_rad())
    assert points[:, 2].min() < 0
    np.testing.assert_allclose(
        OPENSFM.distort_rays(points), opensfm(OPENSFM.coefficients, points), atol=1e-13
    )


def test_opensfms_and_arias_fisheye_of_the_same_name_are_two_models() -> None:
    swapped = {"p1": ARIA.p1, "p2": ARIA.p0, **{f"k{i + 1}": getattr(ARIA, f"k{i}") for i in range(6)}}
    twin = Fisheye624(**swapped, s0=ARIA.s0, s1=ARIA.s1, s2=ARIA.s2, s3=ARIA.s3)
    points = cone(1.2)
    missed_px = K.fx * np.abs(twin.distort_rays(points) - ARIA.distort_rays(points)).max()
    assert 0.05 < missed_px < 5


@QUICK
@given(lens=LENSES)
def test_every_ray_comes_back_from_where_it_is_seen(lens: Distortion) -> None:
    seen = cone(0.9 * lens.max_angle_rad())
    np.testing.assert_allclose(
        lens.undistort_to_rays(lens.distort_rays(seen)), unit(seen), rtol=0, atol=1e-11
    )


@QUICK
@given(lens=LENSES)
def test_nothing_is_seen_past_the_widest_angle(lens: Distortion) -> None:
    widest = lens.max_angle_rad()
    assert 0 < widest <= math.pi
    angle = np.linspace(widest * (1 + 1e-9), math.pi, 20)
    beyond = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=1)
    if widest < math.pi * 0.999:
        assert np.isnan(lens.distort_rays(beyond)).all()
    assert np.isnan(
        lens.distort_rays(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [np.nan, 0.0, 1.0]]))
    ).all()
    distorted = lens.distort_rays(cone(widest * (1 - 1e-6)))
    assert np.isfinite(distorted).all()


@QUICK
@given(lens=LENSES)
def test_the_image_is_one_to_one_up_to_the_widest_angle(lens: Distortion) -> None:
    angle, around = np.meshgrid(
        np.linspace(1e-3, 1 - 1e-4, 200) * min(lens.max_angle_rad(), 3.0), np.linspace(0, 2 * np.pi, 17)
    )

    def seen(angle: Array, around: Array) -> Array:
        rays = [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)]
        return lens.distort_rays(np.stack([c.ravel() for c in rays], axis=1))

    h = 1e-6
    outward = seen(angle * (1 + h), around) - seen(angle * (1 - h), around)
    onward = seen(angle, around + h) - seen(angle, around - h)
    # A turn from outward to onward that never changes its sense: the Jacobian determinant is positive.
    turn = outward[:, 0] * onward[:, 1] - outward[:, 1] * onward[:, 0]
    assert (turn > -1e-7 * np.hypot(*outward.T) * np.hypot(*onward.T)).all()


def test_a_fisheye_folds_where_its_first_map_does() -> None:
    strong = dict.fromkeys(RadTanThinPrismFisheye.names(), 0.0)
    radial = RadTanThinPrismFisheye(**{**strong, "k0": -0.3})
    assert radial.max_angle_rad() == pytest.approx(math.sqrt(1 / 0.9), rel=1e-12)
    # s·θd² turns back at θd = 1/(2s); the radial part brings θ = 1.25 there.
    prism = RadTanThinPrismFisheye(**{**strong, "k0": 0.1, "s0": 0.5 / (1.25 * (1 + 0.1 * 1.25**2))})
    assert prism.max_angle_rad() == pytest.approx(1.25, rel=1e-12)
    both = RadTanThinPrismFisheye(**{**strong, "k0": -0.3, "s0": 0.01})
    assert both.max_angle_rad() == pytest.approx(math.sqrt(1 / 0.9), rel=1e-12)


def test_a_division_ends_where_its_square_root_does_or_behind_the_camera() -> None:
    assert Division(k=0.25).max_angle_rad() == pytest.approx(math.atan(1.0))
    assert Division(k=-0.25).max_angle_rad() == math.pi
    assert Division(k=0.0).max_angle_rad() == pytest.approx(math.pi / 2)
    assert np.isnan(
        Division(k=0.25).undistort_to_rays(np.array([[2.0, 0.0], [np.inf, 0.0], [np.nan, 0.0]]))
    ).all()


def test_a_barrel_by_division_sees_behind_itself() -> None:
    lens = Division(k=-0.25)
    behind = cone(3.1)
    np.testing.assert_allclose(lens.undistort_to_rays(lens.distort_rays(behind)), unit(behind), atol=1e-12)


@pytest.mark.parametrize(
    ("lens", "same"),
    [
        (KannalaBrandt(k1=0.03, k2=-0.007, k3=0.004, k4=-0.001), ThinPrismFisheye),
        (KannalaBrandt(k1=0.03, k2=-0.007, k3=0.004, k4=-0.001), Fisheye624),
        (KannalaBrandt(k1=0.03, k2=-0.007, k3=0.004, k4=-0.001), RadTanThinPrismFisheye),
        (THIN_PRISM, Fisheye624),
        (
            Fisheye624(k1=0.03, k2=-0.007, k3=0.004, k4=-0.001, k5=1e-4, k6=-1e-5, p1=0, p2=0),
            RadTanThinPrismFisheye,
        ),
        (NoDistortion(), Division),
    ],
    ids=lambda value: value.model,
)
def test_a_larger_model_holds_a_smaller_one_exactly_and_gives_it_back(
    lens: Distortion, same: type[Distortion]
) -> None:
    larger = exact(lens, same)
    assert larger is not None
    points = cone(1.2)
    np.testing.assert_allclose(larger.distort_rays(points), lens.distort_rays(points), rtol=0, atol=1e-14)
    assert exact(larger, type(lens)) == lens


@pytest.mark.parametrize("lens", FISHEYES, ids=lambda lens: lens.model)
def test_a_model_is_no_smaller_one_while_its_own_terms_are_at_work(lens: Distortion) -> None:
    assert exact(lens, KannalaBrandt) is None
    assert all(exact(lens, type(other)) is None for other in FISHEYES if other not in (lens, OPENSFM))


@pytest.mark.parametrize("kind", [type(lens) for lens in (*FISHEYES, DIVISIONS[0])])
def test_a_perspective_lens_is_none_of_them(kind: type[Distortion]) -> None:
    assert exact(BrownConrady(k1=0.1, k2=0, p1=0, p2=0), kind) is None


@pytest.mark.parametrize("lens", [*FISHEYES, *DIVISIONS], ids=repr)
def test_it_is_rebuilt_from_its_name_and_coefficients(lens: Distortion) -> None:
    assert distortion_from(lens.model, lens.coefficients) == lens
