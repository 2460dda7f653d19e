"""A camera to OpenCV and back: the same numbers to cv2's own functions, and no model that cv2 has not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary import Calibration, Grade
from calibrary.arrays import FloatArray
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    Division,
    KannalaBrandt,
    MetashapeFrame,
    NoDistortion,
    Rational,
    ThinPrism,
    Tilted,
    Unified,
)
from calibrary.errors import InputError, UnsupportedModelError
from calibrary.records import replace
from tests.parsers.cameras import SIZE, camera, rays
from tests.strategies import DISTORTIONS, cameras, perspective_distortions

UPRIGHT = cameras(perspective_distortions() | DISTORTIONS["kannala-brandt"]).map(
    lambda own: replace(own, intrinsics=replace(own.intrinsics, skew=0.0))
)

K_OPENCV = np.array([[3650.1, 0.0, 2740.8], [0.0, 3648.7, 1815.4], [0.0, 0.0, 1.0]])
TERMS = (
    -0.113,
    0.0247,
    -0.00037,
    0.00081,
    -0.0062,
    0.01,
    0.002,
    0.0003,
    1e-4,
    2e-5,
    -1e-4,
    1e-5,
    0.01,
    -0.02,
)
MODELS = {0: NoDistortion, 4: BrownConrady, 5: BrownConrady, 8: Rational, 12: ThinPrism, 14: Tilted}


def projected_by_cv2(own: Calibration, points: FloatArray) -> FloatArray:
    """(N, 2) px from the outer corner of the top-left pixel, by OpenCV's own function."""
    K, dist = own.to_opencv()
    still = np.zeros(3)
    if dist is not None and len(dist) == 4:
        pixels, _ = cv2.fisheye.projectPoints(points[:, None, :], still, still, K, dist)
    else:
        pixels, _ = cv2.projectPoints(points, still, still, K, dist)
    return np.asarray(pixels.reshape(-1, 2) + 0.5, dtype=np.float64)


@pytest.mark.parametrize("count", MODELS)
def test_so_many_coefficients_are_the_model_that_opencv_takes_them_for(count: int) -> None:
    own = Calibration.from_opencv(K_OPENCV, TERMS[:count], image_size=SIZE)
    assert type(own.distortion) is MODELS[count]
    points = np.column_stack([np.random.default_rng(1).uniform(-0.4, 0.4, (64, 2)), np.ones(64)])
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K_OPENCV, np.array(TERMS[:count]))
    np.testing.assert_allclose(own.project(points), theirs.reshape(-1, 2) + 0.5, rtol=0, atol=1e-9)


def test_four_coefficients_of_a_fisheye_are_said_to_be_so() -> None:
    own = Calibration.from_opencv(K_OPENCV, TERMS[:4], image_size=SIZE, fisheye=True)
    assert own.distortion == KannalaBrandt(k1=TERMS[0], k2=TERMS[1], k3=TERMS[2], k4=TERMS[3])


@given(own=UPRIGHT, points=rays())
def test_cv2_projects_where_the_camera_does(own: Calibration, points: FloatArray) -> None:
    ours = own.project(points)
    seen = np.isfinite(ours).all(axis=1)
    np.testing.assert_allclose(
        ours[seen],
        projected_by_cv2(own, points)[seen],
        rtol=0,
        atol=1e-6 + 1e-9 * np.abs(ours[seen]).max(initial=0),
    )


@given(own=UPRIGHT)
def test_there_and_back_is_the_same_camera(own: Calibration) -> None:
    K, dist = own.to_opencv()
    fisheye = isinstance(own.distortion, KannalaBrandt)
    back = Calibration.from_opencv(K, dist, image_size=own.intrinsics.image_size, fisheye=fisheye)
    for name in ("fx", "fy", "cx", "cy", "skew"):
        assert getattr(back.intrinsics, name) == pytest.approx(getattr(own.intrinsics, name), abs=1e-9)
    straight = own.distortion is not None and not any(own.distortion.coefficients.values()) and not fisheye
    assert back.distortion == (NoDistortion() if straight else own.distortion)


@pytest.mark.parametrize("shape", [(5,), (5, 1), (1, 5)])
def test_coefficients_may_lie_in_a_row_or_a_column(shape: tuple[int, ...]) -> None:
    own = Calibration.from_opencv(K_OPENCV, np.reshape(TERMS[:5], shape), image_size=SIZE)
    assert isinstance(own.distortion, BrownConrady)
    assert own.distortion.k3 == TERMS[4]


def test_unknown_is_not_zero_either_way() -> None:
    unknown = Calibration.from_opencv(K_OPENCV, image_size=SIZE)
    assert unknown.distortion is None
    assert unknown.to_opencv()[1] is None
    known = Calibration.from_opencv(K_OPENCV, np.zeros(5), image_size=SIZE)
    assert isinstance(known.distortion, NoDistortion)
    assert known.to_opencv()[1] == pytest.approx(np.zeros(5))


def test_what_is_said_of_the_camera_is_kept() -> None:
    own = Calibration.from_opencv(
        K_OPENCV, image_size=SIZE, make="DJI", model="FC6310R", rms_px=0.31, grade=Grade.ADJUSTED
    )
    assert (own.camera.make, own.camera.model, own.camera.image_size) == ("DJI", "FC6310R", SIZE)
    assert own.grade is Grade.ADJUSTED
    assert own.quality is not None
    assert own.quality.rms_px == 0.31
    assert own.provenance.date is None


def test_a_model_of_another_name_is_handed_over_where_it_is_the_same_map() -> None:
    frame = MetashapeFrame(k1=0.1, k2=0.01, k3=0.0, k4=0.0, p1=0.001, p2=-0.002)
    K, dist = camera(frame).to_opencv()
    assert dist is not None
    assert len(dist) == 5
    assert K[0, 2] == camera().intrinsics.cx - 0.5


@pytest.mark.parametrize(
    "lens",
    [Division(k=-0.1), Unified(xi=0.8, k1=0.0, k2=0.0, p1=0.0, p2=0.0)],
    ids=["division", "unified"],
)
def test_a_model_that_cv2_has_not_is_refused_with_a_way_out(lens: Distortion) -> None:
    with pytest.raises(UnsupportedModelError, match=r"calibrary\.refit\(camera.*camera\.project"):
        camera(lens).to_opencv()


def test_a_skew_that_cv2_would_ignore_is_refused() -> None:
    with pytest.raises(UnsupportedModelError, match=r"skew, this K has 0\.5 px; use camera\.project"):
        camera(skew=0.5).to_opencv()


@pytest.mark.parametrize(
    ("dist", "fisheye", "message"),
    [
        (TERMS[:3], False, "3 distortion coefficients, OpenCV has models of 0, 4, 5, 8, 12, 14"),
        (TERMS[:5], True, "5 coefficients of a fisheye"),
        (np.zeros((2, 4)), False, r"shape \(2, 4\)"),
        ([float("nan")] * 4, False, "finite"),
        (["k1"], False, "not an array of numbers"),
    ],
)
def test_coefficients_that_opencv_has_not_are_refused(dist: object, fisheye: bool, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Calibration.from_opencv(K_OPENCV, dist, image_size=SIZE, fisheye=fisheye)  # type: ignore[arg-type]


@given(size=st.tuples(st.integers(1, 9000), st.integers(1, 9000)))
def test_the_half_pixel_is_the_only_thing_between_the_two_k(size: tuple[int, int]) -> None:
    own = Calibration.from_opencv(K_OPENCV, image_size=size)
    assert (own.intrinsics.cx, own.intrinsics.cy) == (2741.3, 1815.9)
    np.testing.assert_array_equal(own.to_opencv()[0], K_OPENCV)
    assert replace(own.intrinsics, image_size=SIZE).matrix[0, 0] == K_OPENCV[0, 0]
