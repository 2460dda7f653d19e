"""Brown's model read from the measured point, and about a centre of its own: against the formula and OpenCV."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary.distortion import (
    BrownConrady,
    InverseBrown,
    MetashapeFrame,
    NoDistortion,
    OffCentreBrown,
    exact,
)
from calibrary.errors import InputError

BARREL = InverseBrown(k1=0.1131, k2=-0.0247, p1=-3.7e-4, p2=8.1e-4, k3=0.0062, k4=-0.0011, k5=0.0004)
STRANGE = OffCentreBrown(
    k1=-0.09,
    k2=0.02,
    p1=4e-4,
    p2=-7e-4,
    k3=-0.004,
    k4=0.001,
    k5=2e-4,
    b1=2.2e-4,
    b2=-5.6e-4,
    x0=0.01,
    y0=-0.03,
)


def disc(radius: float, rings: int = 30) -> NDArray[np.float64]:
    r, angle = np.meshgrid(np.linspace(1 / rings, 1, rings) * radius, np.linspace(0, 2 * np.pi, 61))
    return np.column_stack([(r * np.cos(angle)).ravel(), (r * np.sin(angle)).ravel()])


def by_opencv(D: list[float], xy: NDArray[np.float64]) -> NDArray[np.float64]:
    points = np.column_stack([xy, np.ones(len(xy))])
    return np.asarray(
        cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), np.array(D))[0].reshape(-1, 2)
    )


def test_opencvs_polynomial_corrects_the_distorted_point() -> None:
    lens = InverseBrown(k1=0.1131, k2=-0.0247, p1=-3.7e-4, p2=8.1e-4, k3=0.0062)
    distorted = disc(0.8)
    undistorted = by_opencv([0.1131, -0.0247, -3.7e-4, 8.1e-4, 0.0062], distorted)
    np.testing.assert_allclose(lens.undistort(distorted), undistorted, rtol=0, atol=1e-14)
    np.testing.assert_allclose(lens.distort(undistorted), distorted, rtol=0, atol=1e-13)


def test_about_the_principal_point_the_other_direction_is_opencvs_model() -> None:
    lens = OffCentreBrown(k1=-0.1131, k2=0.0247, p1=-3.7e-4, p2=8.1e-4, k3=-0.0062)
    np.testing.assert_allclose(
        lens.distort(disc(0.8)), by_opencv([-0.1131, 0.0247, -3.7e-4, 8.1e-4, -0.0062], disc(0.8)), atol=1e-14
    )


def test_a_radial_correction_that_ends_ends_where_its_rim_is_corrected_to() -> None:
    lens = InverseBrown(k1=-1.0, k2=0.0, p1=0.0, p2=0.0)
    distorted_limit = 1 / math.sqrt(3)
    assert lens.valid_radius() == pytest.approx(distorted_limit * (1 - distorted_limit**2), rel=1e-14)


def test_a_centre_moves_the_whole_map() -> None:
    moved = OffCentreBrown(k1=-0.09, k2=0.02, p1=4e-4, p2=-7e-4, x0=0.05, y0=-0.02)
    about_axis = BrownConrady(k1=-0.09, k2=0.02, p1=4e-4, p2=-7e-4)
    shift = np.array([0.05, -0.02])
    np.testing.assert_allclose(
        moved.distort(disc(0.5)), about_axis.distort(disc(0.5) - shift) + shift, rtol=0, atol=1e-15
    )


def test_a_centre_outside_everything_leaves_nothing_visible() -> None:
    far = {"k1": -1.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, "x0": 5.0}
    for kind in (InverseBrown, OffCentreBrown):
        lens = kind(**far)
        assert lens.valid_radius() == 0.0
        assert np.isnan(lens.distort(np.zeros((1, 2)))).all()


@pytest.mark.parametrize("kind", [InverseBrown, OffCentreBrown])
def test_an_affinity_beyond_a_tenth_is_refused(kind: type[InverseBrown] | type[OffCentreBrown]) -> None:
    with pytest.raises(InputError, match=r"b2 is -0\.2"):
        kind(k1=0.0, k2=0.0, p1=0.0, p2=0.0, b2=-0.2)


def test_a_sign_flip_is_no_equivalent() -> None:
    assert exact(BARREL, BrownConrady) is None
    assert exact(BrownConrady(k1=-0.1, k2=0.0, p1=0.0, p2=0.0), InverseBrown) is None


def test_models_that_hold_one_another_say_so() -> None:
    brown = BrownConrady(k1=-0.1, k2=0.02, p1=4e-4, p2=-7e-4, k3=-0.004)
    off_centre = exact(brown, OffCentreBrown)
    assert off_centre is not None
    assert exact(off_centre, BrownConrady) == brown
    frame = MetashapeFrame(k1=-0.1, k2=0.02, k3=-0.004, k4=0.001, p1=-7e-4, p2=4e-4)
    off_centre = exact(frame, OffCentreBrown)
    assert off_centre is not None
    assert exact(off_centre, MetashapeFrame) == frame
    assert exact(off_centre, BrownConrady) is None
    assert exact(STRANGE, MetashapeFrame) is None
    nothing = InverseBrown(k1=0.0, k2=0.0, p1=0.0, p2=0.0, x0=0.1)
    assert exact(nothing, BrownConrady) == BrownConrady(k1=0.0, k2=0.0, p1=0.0, p2=0.0)
    assert exact(NoDistortion(), InverseBrown) == InverseBrown(k1=0.0, k2=0.0, p1=0.0, p2=0.0)
