"""Brown's model read from the measured point, and about a centre of its own: against the formula and OpenCV."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibrary.distortion import (
    BrownConrady,
    Distortion,
    InverseBrown,
    MetashapeFrame,
    NoDistortion,
    OffCentreBrown,
    distortion_from,
)
from calibrary.distortion.equivalence import exact
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
COEFFICIENTS = {
    **{f"k{i}": st.floats(-0.3, 0.3) for i in range(1, 6)},
    **{name: st.floats(-0.01, 0.01) for name in ("p1", "p2")},
    **{name: st.floats(-0.02, 0.02) for name in ("b1", "b2")},
    **{name: st.floats(-0.05, 0.05) for name in ("x0", "y0")},
}
OBSERVED = st.builds(InverseBrown, **COEFFICIENTS)
OFF_CENTRE = st.builds(OffCentreBrown, **COEFFICIENTS)
SOME = settings(max_examples=25, deadline=None)


def formula(lens: Distortion, xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """The polynomial of both models, in the direction each has for its own."""
    c = lens.coefficients
    x, y = (xy - [c["x0"], c["y0"]]).T
    r = np.hypot(x, y)
    radial = 1 + c["k1"] * r**2 + c["k2"] * r**4 + c["k3"] * r**6 + c["k4"] * r**8 + c["k5"] * r**10
    return np.stack(
        [
            c["x0"]
            + x * radial
            + 2 * c["p1"] * x * y
            + c["p2"] * (r**2 + 2 * x**2)
            + c["b1"] * x
            + c["b2"] * y,
            c["y0"] + y * radial + c["p1"] * (r**2 + 2 * y**2) + 2 * c["p2"] * x * y,
        ],
        axis=1,
    )


def disc(radius: float, rings: int = 30) -> NDArray[np.float64]:
    r, angle = np.meshgrid(np.linspace(1 / rings, 1, rings) * radius, np.linspace(0, 2 * np.pi, 61))
    return np.column_stack([(r * np.cos(angle)).ravel(), (r * np.sin(angle)).ravel()])


def by_opencv(D: list[float], xy: NDArray[np.float64]) -> NDArray[np.float64]:
    points = np.column_stack([xy, np.ones(len(xy))])
    return np.asarray(
        cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), np.array(D))[0].reshape(-1, 2)
    )


def test_opencvs_polynomial_corrects_the_observed_point() -> None:
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


@SOME
@given(lens=OBSERVED)
def test_the_observed_point_is_corrected_by_the_formula(lens: InverseBrown) -> None:
    undistorted = 0.99 * min(lens.valid_radius(), 2.0)
    distorted = lens.distort(disc(undistorted))
    assert np.isfinite(distorted).all()
    np.testing.assert_allclose(formula(lens, distorted), disc(undistorted), rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(lens.undistort(distorted), disc(undistorted), rtol=1e-11, atol=1e-13)


@SOME
@given(lens=OFF_CENTRE)
def test_off_centre_the_ideal_point_is_distorted_by_the_formula(lens: OffCentreBrown) -> None:
    undistorted = disc(0.99 * min(lens.valid_radius(), 2.0))
    distorted = lens.distort(undistorted)
    np.testing.assert_allclose(distorted, formula(lens, undistorted), rtol=1e-12, atol=1e-14)
    near = disc(0.9 * min(lens.valid_radius(), 2.0))
    np.testing.assert_allclose(lens.undistort(lens.distort(near)), near, rtol=0, atol=1e-11)


@SOME
@given(lens=st.one_of(OBSERVED, OFF_CENTRE))
def test_from_the_valid_radius_on_there_is_nothing(lens: Distortion) -> None:
    radius = lens.valid_radius()
    if radius > 1e3:
        return
    angle = np.linspace(0, 2 * np.pi, 361)
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    assert np.isnan(lens.distort(1.0001 * radius * rim)).all()
    assert np.isfinite(lens.distort(0.999 * radius * rim)).all()


@SOME
@given(lens=st.one_of(OBSERVED, OFF_CENTRE))
def test_inside_the_valid_radius_no_two_points_change_places(lens: Distortion) -> None:
    undistorted = disc(0.99 * min(lens.valid_radius(), 2.0))
    step = 1e-6 * np.eye(2)
    with np.errstate(all="ignore"):
        along_x = lens.distort(undistorted * 0.99 + step[0]) - lens.distort(undistorted * 0.99 - step[0])
        along_y = lens.distort(undistorted * 0.99 + step[1]) - lens.distort(undistorted * 0.99 - step[1])
    determinant = along_x[:, 0] * along_y[:, 1] - along_x[:, 1] * along_y[:, 0]
    assert (determinant[np.isfinite(determinant)] > 0).all()


def test_a_radial_correction_that_folds_ends_where_its_rim_is_corrected_to() -> None:
    lens = InverseBrown(k1=-1.0, k2=0.0, p1=0.0, p2=0.0)
    observed_fold = 1 / math.sqrt(3)
    assert lens.valid_radius() == pytest.approx(observed_fold * (1 - observed_fold**2), rel=1e-14)


def test_a_centre_moves_the_whole_map() -> None:
    moved = OffCentreBrown(k1=-0.09, k2=0.02, p1=4e-4, p2=-7e-4, x0=0.05, y0=-0.02)
    about_axis = BrownConrady(k1=-0.09, k2=0.02, p1=4e-4, p2=-7e-4)
    shift = np.array([0.05, -0.02])
    np.testing.assert_allclose(
        moved.distort(disc(0.5)), about_axis.distort(disc(0.5) - shift) + shift, rtol=0, atol=1e-15
    )


def test_a_centre_outside_everything_leaves_nothing_visible() -> None:
    far = {"k1": -1.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, "x0": 5.0}
    for model in ("observed-brown", "off-centre-brown"):
        lens = distortion_from(model, far)
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


@pytest.mark.parametrize("lens", [BARREL, STRANGE], ids=["observed-brown", "off-centre-brown"])
def test_files_and_reports_know_them_by_name(lens: Distortion) -> None:
    assert distortion_from(lens.model, lens.coefficients) == lens
