"""One point is projected and unprojected in plain floats, and comes out as among others in an array."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    FisheyePolynomial,
    KannalaBrandt,
    MetashapeFrame,
    NoDistortion,
    OffCentreBrown,
    Rational,
    Tilted,
)
from calibrary.distortion.base import unit_rays

SIZE = (4000, 3000)
FOCAL_PX = 2000.0
LENSES: dict[str, Distortion | None] = {
    "unknown": None,
    "none": NoDistortion(),
    "brown": BrownConrady(k1=-0.26, k2=0.11, p1=0.0008, p2=-0.0001, k3=-0.03),
    "barrel that folds over inside the frame": BrownConrady(k1=-0.5, k2=0.0, p1=0.002, p2=0.001),
    "rational": Rational(k1=0.3, k2=-0.1, p1=0.001, p2=-0.002, k3=0.01, k4=0.2, k5=0.1, k6=0.01),
    "metashape": MetashapeFrame(k1=0.05, k2=-0.1, k3=0.02, p1=0.001, p2=-0.001),
    "about another centre": OffCentreBrown(k1=-0.2, k2=0.05, p1=0.0, p2=0.0, x0=0.01, y0=-0.02),
    "tilted": Tilted(
        **dict.fromkeys(("k2", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"), 0.0),
        k1=-0.1,
        p1=0.001,
        tau_x=0.02,
        tau_y=-0.01,
    ),
    "fisheye": KannalaBrandt(k1=0.01, k2=-0.003, k3=0.001, k4=0.0001),
    "fisheye that folds over": KannalaBrandt(k1=-0.1, k2=-0.02, k3=0.0, k4=0.0),
    "fisheye polynomial": FisheyePolynomial(k2=0.01, k3=-0.05, k4=0.01),
}


def camera(name: str) -> Calibration:
    return Calibration(
        camera=CameraKey(model="made up"),
        intrinsics=Intrinsics(fx=FOCAL_PX, fy=1990.0, cx=2011.0, cy=1489.0, skew=0.5, image_size=SIZE),
        distortion=LENSES[name],
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="test"),
    )


def assert_equal(alone: np.ndarray, among: np.ndarray, unit: float) -> None:
    """To 1e-12 of the unit, and lost where that is lost."""
    assert alone.shape == among.shape
    assert np.array_equal(np.isnan(alone), np.isnan(among))
    np.testing.assert_allclose(alone, among, rtol=1e-12, atol=1e-12 * unit)


@pytest.mark.parametrize("name", LENSES)
@given(px=st.tuples(st.floats(-2000, 6000), st.floats(-2000, 5000)))
def test_a_pixel_is_unprojected_alone_as_among_others(name: str, px: tuple[float, float]) -> None:
    seen_by = camera(name)
    assert_equal(seen_by.unproject([px]), seen_by.unproject([px, (2000.0, 1500.0)])[:1], 1.0)


@pytest.mark.parametrize("name", LENSES)
@given(ray=st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-1, 3)))
def test_a_point_is_projected_alone_as_among_others(name: str, ray: tuple[float, float, float]) -> None:
    seen_by = camera(name)
    assert_equal(seen_by.project([ray]), seen_by.project([ray, (0.0, 0.0, 1.0)])[:1], FOCAL_PX)


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize(
    "ray",
    [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, 0, 0), (math.nan, 0, 1), (math.inf, 0, 1), (1e300, 0, 1e-300)],
)
def test_odd_directions_come_out_alike(name: str, ray: tuple[float, float, float]) -> None:
    seen_by = camera(name)
    assert_equal(seen_by.project([ray]), seen_by.project([ray, (0.0, 0.0, 1.0)])[:1], FOCAL_PX)


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("px", [(2011.0, 1489.0), (math.nan, 0), (math.inf, 0), (1e300, -1e300)])
def test_odd_pixels_come_out_alike(name: str, px: tuple[float, float]) -> None:
    seen_by = camera(name)
    assert_equal(seen_by.unproject([px]), seen_by.unproject([px, (2000.0, 1500.0)])[:1], 1.0)


@pytest.mark.parametrize("name", ["fisheye", "fisheye that folds over", "fisheye polynomial"])
def test_rays_from_a_table_are_those_that_are_solved_for(name: str) -> None:
    """Half of the points lie inside the image of 90° off the axis, where undistort, which has no table, answers too."""
    lens = LENSES[name]
    assert lens is not None
    xy = np.random.default_rng(3).uniform(-1.1, 1.1, (2000, 2))
    rays, solved = lens.undistort_to_rays(xy), unit_rays(lens.undistort(xy))
    in_front = np.isfinite(solved[:, 0])
    assert in_front.sum() > 1000
    np.testing.assert_allclose(rays[in_front], solved[in_front], rtol=0, atol=4e-15)
    assert not (rays[~in_front, 2] > 0).any()


def test_a_frame_half_beyond_the_limit_is_lost_there_alone() -> None:
    lens = KannalaBrandt(k1=-0.1, k2=-0.02, k3=0.0, k4=0.0)
    rays = lens.undistort_to_rays(np.array([[0.0, 0.0], [0.5, 0.0], [0.9, 0.1], [1.5, 0.0], [math.nan, 0.0]]))
    assert np.isnan(rays[3:]).all()
    assert rays[0].tolist() == [0.0, 0.0, 1.0]
    np.testing.assert_allclose(np.linalg.norm(rays[:3], axis=1), 1.0, rtol=1e-15)
