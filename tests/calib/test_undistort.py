"""Undistorted pictures: maps against OpenCV's own, straight lines straight, and what a K is chosen to keep."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibrary.calib.undistort import Interpolation, Undistorter
from calibrary.calib.undistort_plan import plan
from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    KannalaBrandt,
    NoDistortion,
    Rational,
    Unified,
)
from calibrary.errors import FrameError, InputError, UnsupportedModelError
from tests.thorough import examples

SIZE = (480, 320)
BROWN = BrownConrady(k1=-0.28, k2=0.09, p1=0.0011, p2=-0.0007, k3=-0.012)
FISHEYE = KannalaBrandt(k1=-0.03, k2=0.004, k3=-0.001, k4=0.0002)
BEYOND_180 = KannalaBrandt(k1=-0.02, k2=0.003, k3=-0.001, k4=0.0)


def camera(
    distortion: Distortion | None,
    *,
    focal: float = 310.0,
    size: ImageSize = SIZE,
    skew: float = 0.0,
    centre: tuple[float, float] | None = None,
) -> Calibration:
    cx, cy = centre or (size[0] / 2 + 3.25, size[1] / 2 - 4.5)
    return Calibration(
        camera=CameraKey(model="made up"),
        intrinsics=Intrinsics(fx=focal, fy=focal * 1.002, cx=cx, cy=cy, skew=skew, image_size=size),
        distortion=distortion,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="test"),
    )


def opencv_k(K: Intrinsics) -> NDArray[np.float64]:
    """The same K counted from the first pixel's centre."""
    matrix = K.matrix.copy()
    matrix[:2, 2] -= 0.5
    return matrix


def opencv_maps(calibration: Calibration, K: Intrinsics) -> tuple[NDArray[Any], ...]:
    old, new = opencv_k(calibration.intrinsics), opencv_k(K)
    assert calibration.distortion is not None
    coefficients = np.array(list(calibration.distortion.coefficients.values()))
    make = (
        cv2.fisheye.initUndistortRectifyMap
        if isinstance(calibration.distortion, KannalaBrandt)
        else cv2.initUndistortRectifyMap
    )
    first, second = make(old, coefficients, np.eye(3), new, K.image_size, cv2.CV_32FC1)
    return np.asarray(first), np.asarray(second)


def noise(size: ImageSize = SIZE, *, channels: int = 3, depth: type = np.uint8) -> NDArray[Any]:
    """Smooth noise, as a picture is."""
    width, height = size
    grain = np.random.default_rng(5).random((height, width, channels)).astype(np.float32)
    smooth = cv2.GaussianBlur(grain, (0, 0), 2.5).reshape(height, width, channels)
    smooth = (smooth - smooth.min()) / (smooth.max() - smooth.min())
    top = np.iinfo(depth).max if np.issubdtype(depth, np.integer) else 1.0
    image: NDArray[Any] = (smooth * top).astype(depth)
    return image[..., 0] if channels == 1 else image


@pytest.mark.parametrize("alpha", [None, 0.0, 1.0])
@pytest.mark.parametrize(
    "distortion",
    [BROWN, Rational(k1=0.3, k2=-0.2, p1=1e-3, p2=2e-3, k3=0.01, k4=0.5, k5=-0.1, k6=0.02), FISHEYE],
    ids=lambda d: d.model,
)
def test_the_maps_are_opencvs(distortion: Distortion, alpha: float | None) -> None:
    calibration = camera(distortion)
    made = plan(calibration, alpha=alpha)
    undistorter = Undistorter(made)
    ours, theirs = undistorter.maps(), opencv_maps(calibration, made.intrinsics)
    seen = undistorter.mask() > 0
    assert seen.mean() > 0.5
    for mine, peer in zip(ours, theirs, strict=True):
        assert np.abs(mine - peer)[seen].max() <= 1e-3


@pytest.mark.parametrize("alpha", [None, 0.0, 1.0])
@pytest.mark.parametrize("distortion", [BROWN, FISHEYE, BEYOND_180, Unified(xi=0.8)], ids=lambda d: d.model)
def test_the_maps_are_the_models_own_projection(distortion: Distortion, alpha: float | None) -> None:
    """OpenCV makes some of the maps; the model, which knows nothing of OpenCV, says what must be in them."""
    calibration = camera(distortion)
    made = plan(calibration, alpha=alpha)
    undistorter = Undistorter(made)
    x, y = undistorter.maps()
    K = made.intrinsics
    rows, columns = np.nonzero(undistorter.mask())
    rays = np.column_stack(
        [(columns + 0.5 - K.cx) / K.fx, (rows + 0.5 - K.cy) / K.fy, np.ones(len(rows))],
    )
    wanted = calibration.project(rays) - 0.5
    assert np.abs(np.column_stack([x[rows, columns], y[rows, columns]]) - wanted).max() < 2e-4


def test_the_picture_is_what_opencv_makes_of_it() -> None:
    calibration, image = camera(BROWN), noise()
    undistorter = Undistorter(plan(calibration), interpolation=Interpolation.LINEAR)
    ours = undistorter(image).astype(int)
    coefficients = np.array(list(BROWN.coefficients.values()))
    theirs = cv2.undistort(image, opencv_k(calibration.intrinsics), coefficients).astype(int)
    inside = cv2.erode(undistorter.mask(), np.ones((5, 5), np.uint8)) > 0
    assert np.abs(ours - theirs)[inside].max() <= 1


def test_a_fisheye_picture_is_what_opencv_makes_of_it() -> None:
    calibration, image = camera(FISHEYE), noise()
    K = opencv_k(calibration.intrinsics)
    undistorter = Undistorter(plan(calibration), interpolation=Interpolation.LINEAR)
    coefficients = np.array(list(FISHEYE.coefficients.values()))
    theirs = cv2.fisheye.undistortImage(image, K, coefficients, Knew=K).astype(int)
    inside = cv2.erode(undistorter.mask(), np.ones((5, 5), np.uint8)) > 0
    assert np.abs(undistorter(image).astype(int) - theirs)[inside].max() <= 1


def opencv_undistorted(pixels: NDArray[np.float64], calibration: Calibration) -> NDArray[np.float64]:
    """x/z, y/z at pixels counted from the first one's centre: the fixed point of OpenCV's own projection."""
    assert calibration.distortion is not None
    K, coefficients = (
        opencv_k(calibration.intrinsics),
        np.array(list(calibration.distortion.coefficients.values())),
    )
    ideal = target = (pixels - K[:2, 2]) / K[[0, 1], [0, 1]]
    for _ in range(15):
        points = np.column_stack([ideal, np.ones(len(ideal))])
        seen, _jacobian = cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), coefficients)
        ideal = ideal + target - seen.reshape(-1, 2)
    return ideal


def line_positions(profile: NDArray[np.float64]) -> float:
    """Where a dark line crosses a profile, in px from the first sample's edge."""
    weight = profile.max() - profile
    return float((weight * (np.arange(len(profile)) + 0.5)).sum() / weight.sum())


def test_straight_lines_become_straight() -> None:
    """A line of the plane y = 0.3 z, drawn through OpenCV's own undistortion, bent by 7 px."""
    calibration = camera(BROWN)
    K = calibration.intrinsics
    y, x = np.mgrid[: SIZE[1], : SIZE[0]].astype(np.float64)
    pixels = np.column_stack([x.ravel(), y.ravel()])
    ideal_y = opencv_undistorted(pixels, calibration)[:, 1].reshape(SIZE[1], SIZE[0])
    distance_px = (ideal_y - 0.3) * K.fy
    picture = 255 * (1 - np.exp(-((distance_px / 2) ** 2)))

    def heights(image: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = range(20, SIZE[0] - 20, 10)
        around = (int(np.argmin(image[:, column])) for column in columns)
        return np.array(
            [
                row - 8 + line_positions(image[row - 8 : row + 9, c])
                for row, c in zip(around, columns, strict=True)
            ]
        )

    straight = Undistorter(plan(calibration))(picture.astype(np.float64))
    assert np.ptp(heights(picture)) > 6
    assert np.ptp(heights(straight)) < 0.1
    assert np.abs(heights(straight) - (K.cy + 0.3 * K.fy)).max() < 0.1


def test_a_lens_without_distortion_leaves_every_pixel_as_it_is() -> None:
    image = noise()
    for alpha in (None, 0.0, 0.5, 1.0):
        made = plan(camera(NoDistortion()), alpha=alpha)
        assert made.intrinsics == camera(NoDistortion()).intrinsics
        assert np.array_equal(Undistorter(made)(image), image)


@pytest.mark.parametrize(
    ("channels", "depth"), [(1, np.uint8), (3, np.uint16), (4, np.uint8), (1, np.float32)]
)
def test_pixels_of_any_kind_keep_it(channels: int, depth: type) -> None:
    image = noise(channels=channels, depth=depth)
    result = Undistorter(plan(camera(BROWN), alpha=1.0))(image)
    assert (result.shape, result.dtype) == (image.shape, image.dtype)
    assert not result[0, 0].any()
    middle = result[150:170, 230:250].astype(float)
    assert np.abs(middle.mean() / image[150:170, 230:250].astype(float).mean() - 1) < 0.1


def test_the_cameras_own_k_stays_but_for_skew() -> None:
    K = plan(camera(BROWN, skew=0.8)).intrinsics
    assert camera(BROWN).intrinsics == K


def test_alpha_1_keeps_every_pixel_and_not_more_than_it_must() -> None:
    calibration = camera(BROWN)
    made = plan(calibration, alpha=1.0)
    assert made.kept == 1.0
    assert made.empty > 0.02
    x, y = camera_edge(calibration, made.intrinsics).T
    width, height = SIZE
    assert x.min() >= -1e-6
    assert x.max() <= width + 1e-6
    assert min(x.min(), width - x.max(), y.min(), height - y.max()) == pytest.approx(0, abs=1e-6)


def camera_edge(calibration: Calibration, K: Intrinsics) -> NDArray[np.float64]:
    """Where the new picture shows the edge of the old one."""
    width, height = calibration.intrinsics.image_size
    steps = np.linspace(0, 1, 401)
    edge = np.vstack(
        [
            np.column_stack([steps * width, 0 * steps]),
            np.column_stack([steps * width, 0 * steps + height]),
            np.column_stack([0 * steps, steps * height]),
            np.column_stack([0 * steps + width, steps * height]),
        ]
    )
    rays = calibration.unproject(edge)
    return np.column_stack([K.fx * rays[:, 0] / rays[:, 2] + K.cx, K.fy * rays[:, 1] / rays[:, 2] + K.cy])


def test_alpha_0_leaves_no_pixel_empty_and_hardly_loses_more_than_it_must() -> None:
    calibration = camera(BROWN)
    made = plan(calibration, alpha=0.0)
    assert Undistorter(made).mask().all()
    K = made.intrinsics
    wider = Intrinsics(fx=K.fx * 0.999, fy=K.fy * 0.999, cx=K.cx, cy=K.cy, image_size=K.image_size)
    x, y = camera_edge(calibration, wider).T
    # A thousandth less zoom and the old picture's edge comes into view.
    assert ((x > 0) & (x < SIZE[0]) & (y > 0) & (y < SIZE[1])).any()


@settings(max_examples=examples(12))
@given(k1=st.floats(-0.2, 0.3), k2=st.floats(0, 0.1), p1=st.floats(-2e-3, 2e-3), alpha=st.floats(0, 1))
def test_more_alpha_keeps_more_and_leaves_more_empty(k1: float, k2: float, p1: float, alpha: float) -> None:
    calibration = camera(BrownConrady(k1=k1, k2=k2, p1=p1, p2=0.0, k3=0.0))
    least, some, most = (plan(calibration, alpha=a) for a in (0.0, alpha, 1.0))
    assert least.kept <= some.kept <= most.kept
    assert least.empty <= some.empty <= most.empty
    assert most.kept == 1.0
    assert least.empty == 0.0


@pytest.mark.parametrize("alpha", [0.0, 1.0])
def test_the_size_may_follow_from_the_focal_length(alpha: float) -> None:
    calibration = camera(BROWN)
    by_zoom, by_size = plan(calibration, alpha=alpha), plan(calibration, alpha=alpha, same_focal=True)
    K = by_size.intrinsics
    assert (K.fx, K.fy) == (calibration.intrinsics.fx, calibration.intrinsics.fy)
    assert by_size.kept == pytest.approx(by_zoom.kept, abs=0.01)
    assert by_size.empty == pytest.approx(by_zoom.empty, abs=0.01)
    zoom = by_zoom.intrinsics.fx / K.fx
    assert K.image_size[0] == pytest.approx(SIZE[0] / zoom, abs=1)


def test_another_shape_keeps_pixels_square() -> None:
    calibration = camera(BROWN)
    made = plan(calibration, alpha=0.0, size=(200, 200))
    assert made.intrinsics.image_size == (200, 200)
    assert made.intrinsics.fy / made.intrinsics.fx == pytest.approx(1.002)
    assert Undistorter(made).mask().all()


def test_the_same_k_in_a_frame_of_another_shape_is_refused() -> None:
    with pytest.raises(FrameError, match="aspect ratios"):
        plan(camera(BROWN), size=(200, 200))


def test_a_much_smaller_picture_is_the_mean_of_its_pixels_and_no_sample() -> None:
    stripes = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    stripes[:, ::2] = 200
    made = plan(camera(NoDistortion()), size=(120, 80))
    assert np.abs(Undistorter(made)(stripes).astype(int) - 100).max() <= 1


def test_nearest_makes_no_value_that_was_not_there() -> None:
    labels = np.random.default_rng(1).choice(np.array([0, 7, 200], np.uint8), (SIZE[1], SIZE[0]))
    made = plan(camera(BROWN), size=(120, 80))
    assert set(np.unique(Undistorter(made, interpolation=Interpolation.NEAREST)(labels))) <= {0, 7, 200}


@pytest.mark.parametrize("alpha", [0.0, 1.0])
def test_a_lens_that_sees_behind_itself_is_cropped_to_what_a_plane_shows(alpha: float) -> None:
    calibration = camera(BEYOND_180, focal=140.0, size=(500, 500), centre=(251.0, 248.0))
    made = plan(calibration, alpha=alpha, max_angle_deg=75)
    assert made.cropped_to_deg == 150
    assert 0.1 < made.kept < 0.8
    K = made.intrinsics
    sides = np.array([K.cx, K.image_size[0] - K.cx]) / K.fx
    if alpha == 1.0:
        assert sides.min() == pytest.approx(math.tan(math.radians(75)), rel=0.02)
    else:
        assert made.empty == 0
        assert np.hypot(sides.max(), 0) < math.tan(math.radians(75))


def test_a_lens_that_folds_back_inside_the_frame_is_kept_up_to_there() -> None:
    folding = BrownConrady(k1=-0.5, k2=0.0, p1=0.0, p2=0.0, k3=0.0)
    calibration = camera(folding, focal=200.0)
    assert not np.isfinite(calibration.unproject(np.array([[0.0, 0.0]]))).any()
    made = plan(calibration, alpha=1.0)
    image = np.full((SIZE[1], SIZE[0]), 255, np.uint8)
    assert made.kept == pytest.approx(math.pi * (200 * 0.5443) ** 2 / (480 * 320), abs=0.01)
    assert Undistorter(made)(image).max() == 255
    assert not Undistorter(made)(image)[0, 0]


def test_any_model_of_the_library_will_do() -> None:
    calibration = camera(Unified(xi=1.2, k1=-0.1, k2=0.02, p1=1e-3, p2=-1e-3), focal=600.0)
    made = plan(calibration, alpha=0.0)
    u, v = Undistorter(made).maps()
    K = made.intrinsics
    ray = np.array([[(100.5 - K.cx) / K.fx, (40.5 - K.cy) / K.fy, 1.0]])
    assert np.abs(calibration.project(ray)[0] - 0.5 - [u[40, 100], v[40, 100]]).max() < 1e-3


def test_unknown_distortion_is_refused() -> None:
    with pytest.raises(UnsupportedModelError, match="is unknown"):
        plan(camera(None))


def test_a_principal_point_outside_the_frame_leaves_only_its_own_k() -> None:
    calibration = camera(BROWN, centre=(-20.0, 100.0))
    assert plan(calibration).kept > 0.2
    with pytest.raises(FrameError, match="outside the 480×320 frame"):
        plan(calibration, alpha=1.0)


def test_a_picture_of_another_size_is_refused() -> None:
    with pytest.raises(FrameError, match="240×160 px, expected 480×320"):
        Undistorter(plan(camera(BROWN)))(noise((240, 160)))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"alpha": 1.5}, "alpha is 1.5"),
        ({"alpha": math.nan}, "alpha is nan"),
        ({"alpha": 1.0, "max_angle_deg": 90.0}, "below 90"),
        ({"alpha": 1.0, "same_focal": True, "size": (10, 10)}, "give one of them"),
        ({"size": (48_000, 32_000)}, "at most 32766 a side"),
    ],
)
def test_an_impossible_wish_is_named(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        plan(camera(BROWN), **wrong)
