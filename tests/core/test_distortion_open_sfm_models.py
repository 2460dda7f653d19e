"""The division model and the fisheyes with tangential and prism terms, against COLMAP and their formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest
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
    exact,
)

Array = NDArray[np.float64]
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


def cone(widest_rad: float) -> Array:
    """Directions of many lengths up to an angle from the axis."""
    angle, around = np.meshgrid(np.linspace(0, widest_rad, 41), np.linspace(0, 2 * np.pi, 37))
    length = 0.1 + np.arange(angle.size) % 7
    unit = [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)]
    return np.stack([c.ravel() * length for c in unit], axis=1)


def unit(directions: Array) -> Array:
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def test_opensfms_and_arias_fisheye_of_the_same_name_are_two_models() -> None:
    swapped = {"p1": ARIA.p1, "p2": ARIA.p0, **{f"k{i + 1}": getattr(ARIA, f"k{i}") for i in range(6)}}
    twin = Fisheye624(**swapped, s0=ARIA.s0, s1=ARIA.s1, s2=ARIA.s2, s3=ARIA.s3)
    points = cone(1.2)
    missed_px = K.fx * np.abs(twin.distort_rays(points) - ARIA.distort_rays(points)).max()
    assert 0.05 < missed_px < 5


def test_a_fisheye_ends_where_its_first_map_does() -> None:
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
