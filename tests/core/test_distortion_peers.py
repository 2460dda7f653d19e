"""Agreement with OpenCV and COLMAP over a 20 MP frame, half a pixel of origin apart."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pycolmap
import pytest

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, Intrinsics, Origin, file_from_canonical
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    KannalaBrandt,
    NoDistortion,
    Rational,
    ThinPrism,
    Tilted,
)
from tests.strategies import calibration, grid

SIZE = (5472, 3648)
K = Intrinsics(fx=3651.13, fy=3648.79, cx=2719.61, cy=1851.37, image_size=SIZE)
PIXELS = grid(SIZE, columns=115, rows=77)
TOLERANCE_PX = 1e-9

RADIAL = {"k1": -0.2613, "k2": 0.1071}
BROWN = {**RADIAL, "p1": 0.00079, "p2": -0.00013, "k3": -0.0321}
RATIONAL = {
    "k1": 11.9,
    "k2": 6.3,
    "p1": 0.00031,
    "p2": -0.00047,
    "k3": 0.41,
    "k4": 12.2,
    "k5": 9.7,
    "k6": 1.93,
}
PRISM = {"s1": 0.0011, "s2": -0.00053, "s3": -0.0019, "s4": 0.00031}
FISHEYE = KannalaBrandt(k1=0.0213, k2=-0.0097, k3=0.0041, k4=-0.00083)

PERSPECTIVE = {
    "0": NoDistortion(),
    "4": BrownConrady(**RADIAL, p1=0.00079, p2=-0.00013),
    "5": BrownConrady(**BROWN),
    "5, k1 = -0.3": BrownConrady(k1=-0.3, k2=0.12, p1=0, p2=0),
    "8": Rational(**RATIONAL),
    "12": ThinPrism(**RATIONAL, **PRISM),
    "14": Tilted(**RATIONAL, **PRISM, tau_x=0.0113, tau_y=-0.0207),
}


def opencv_matrix(intrinsics: Intrinsics) -> FloatArray:
    """K counted from the centre of the top-left pixel."""
    matrix = intrinsics.matrix
    matrix[:2, 2] = file_from_canonical((intrinsics.cx, intrinsics.cy), Origin.PIXEL_CENTRE, SIZE)
    return matrix


def opencv_pixels(camera: Calibration, rays: FloatArray) -> FloatArray:
    """What OpenCV projects, in the canonical origin."""
    lens = camera.distortion or NoDistortion()
    coefficients = np.array(list(lens.coefficients.values()) or [0.0] * 4)
    project = cv2.fisheye.projectPoints if isinstance(lens, KannalaBrandt) else cv2.projectPoints
    points, still = np.ascontiguousarray(rays[:, None, :]), np.zeros(3)
    seen, _ = project(points, still, still, opencv_matrix(camera.intrinsics), coefficients)
    return np.asarray(seen[:, 0], dtype=np.float64) + 0.5


def worst(a: FloatArray, b: FloatArray) -> float:
    """The largest distance, NaN if there is one."""
    return float(np.max(np.abs(a - b)))


@pytest.mark.parametrize("lens", PERSPECTIVE.values(), ids=PERSPECTIVE.keys())
def test_projection_is_opencvs_over_the_whole_frame(lens: Distortion) -> None:
    camera = calibration(K, lens)
    rays = camera.unproject(PIXELS)
    assert worst(camera.project(rays), opencv_pixels(camera, rays)) <= TOLERANCE_PX


@pytest.mark.parametrize("lens", PERSPECTIVE.values(), ids=PERSPECTIVE.keys())
def test_opencv_sees_our_rays_at_the_pixels_they_came_from(lens: Distortion) -> None:
    camera = calibration(K, lens)
    assert worst(opencv_pixels(camera, camera.unproject(PIXELS)), PIXELS) <= TOLERANCE_PX


def test_fisheye_projection_is_opencvs_over_the_whole_frame() -> None:
    camera = calibration(Intrinsics(fx=2100.3, fy=2098.1, cx=2719.6, cy=1851.4, image_size=SIZE), FISHEYE)
    rays = camera.unproject(PIXELS)
    front = rays[:, 2] > math.cos(math.radians(89))
    assert front.sum() > 8000
    assert worst(camera.project(rays)[front], opencv_pixels(camera, rays[front])) <= TOLERANCE_PX


def test_fisheye_distortion_is_opencvs() -> None:
    undistorted = grid((4, 4)) - 2.0
    seen = cv2.fisheye.distortPoints(
        undistorted[:, None], np.eye(3), np.array(list(FISHEYE.coefficients.values()))
    )
    assert worst(FISHEYE.distort(undistorted), np.asarray(seen[:, 0])) <= 1e-14


def test_opencvs_own_inverse_agrees_when_it_is_given_the_iterations() -> None:
    camera = calibration(K, PERSPECTIVE["5, k1 = -0.3"])
    patient = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-15)
    matrix, coefficients = opencv_matrix(K), np.array([-0.3, 0.12, 0.0, 0.0])
    theirs = cv2.undistortImagePoints(PIXELS[:, None] - 0.5, matrix, coefficients, None, patient)
    ours = calibration(K, None).project(camera.unproject(PIXELS))
    assert worst(ours, np.asarray(theirs[:, 0], dtype=np.float64) + 0.5) <= TOLERANCE_PX


def test_the_round_trip_holds_where_opencvs_default_inverse_misses() -> None:
    camera = calibration(K, PERSPECTIVE["5, k1 = -0.3"])
    assert worst(camera.project(camera.unproject(PIXELS)), PIXELS) <= TOLERANCE_PX
    theirs = cv2.undistortPoints(PIXELS[:, None] - 0.5, opencv_matrix(K), np.array([-0.3, 0.12, 0.0, 0.0]))
    back = camera.project(np.column_stack([theirs[:, 0], np.ones(len(theirs))]))
    assert worst(back, PIXELS) > 0.1


COLMAP = {
    "PINHOLE": (NoDistortion(), []),
    "OPENCV": (PERSPECTIVE["4"], ["k1", "k2", "p1", "p2"]),
    "FULL_OPENCV": (PERSPECTIVE["8"], list(Rational.names())),
    "OPENCV_FISHEYE": (FISHEYE, list(KannalaBrandt.names())),
}


@pytest.mark.parametrize("model", COLMAP)
def test_projection_is_colmaps_with_the_same_principal_point(model: str) -> None:
    lens, names = COLMAP[model]
    camera = calibration(K, lens)
    theirs = pycolmap.Camera.create_from_model_name(1, model, K.fx, *SIZE)
    theirs.params = [K.fx, K.fy, K.cx, K.cy, *(lens.coefficients[name] for name in names)]
    rays = camera.unproject(PIXELS)
    seen = np.asarray(theirs.img_from_cam(rays))
    assert worst(camera.project(rays), seen) <= TOLERANCE_PX
    assert worst(seen, PIXELS) <= TOLERANCE_PX


def test_forgetting_the_half_pixel_would_show() -> None:
    camera = calibration(K, PERSPECTIVE["5"])
    rays = camera.unproject(PIXELS)
    assert worst(camera.project(rays), opencv_pixels(camera, rays) - 0.5) == pytest.approx(0.5)


def test_past_90_degrees_a_fisheye_follows_the_published_formula() -> None:
    # OpenCV and COLMAP stop at 90°; this is the paper's own definition, with the angle from the dot product.
    k1, k2, k3, k4 = FISHEYE.coefficients.values()
    for degrees in (89.9, 90.0, 90.1, 95.0, 107.5, 119.0):
        theta = math.radians(degrees)
        ray = (math.sin(theta) * 0.6, -math.sin(theta) * 0.8, math.cos(theta))
        angle = math.acos(ray[2] / math.hypot(*ray))
        image = angle + k1 * angle**3 + k2 * angle**5 + k3 * angle**7 + k4 * angle**9
        seen = FISHEYE.distort_rays(np.array([ray]))[0]
        assert seen == pytest.approx((0.6 * image, -0.8 * image), abs=1e-14)
        assert FISHEYE.undistort_to_rays(seen[None])[0] == pytest.approx(ray, abs=1e-14)


def test_scaling_moves_opencvs_principal_point_by_more_than_the_scale() -> None:
    # From pixel centres c' = (c + 0.5)·s − 0.5; a corner origin makes it a plain product.
    half = calibration(K, PERSPECTIVE["5"]).scaled((2736, 1824))
    matrix = opencv_matrix(K)
    expected = (matrix[:2, 2] + 0.5) * 0.5 - 0.5
    assert opencv_matrix(half.intrinsics)[:2, 2] == pytest.approx(expected, abs=1e-12)
    rays = half.unproject(grid((2736, 1824)))
    assert worst(opencv_pixels(half, rays), grid((2736, 1824))) <= TOLERANCE_PX


def test_a_resized_image_shows_what_the_scaled_camera_says() -> None:
    # A spot drawn where OpenCV projects a point, then the image resized by OpenCV: its centroid, not our formula,
    # says where the point went.
    camera = calibration(Intrinsics(fx=700.0, fy=700.0, cx=401.3, cy=297.9, image_size=(800, 600)), None)
    ray = np.array([[-0.21, 0.17, 1.0]])
    x, y = opencv_pixels(camera, ray)[0] - 0.5
    columns, rows = np.meshgrid(np.arange(800), np.arange(600))
    spot = np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 12.0**2))
    small = cv2.resize(spot, (400, 300), interpolation=cv2.INTER_AREA)
    columns, rows = np.meshgrid(np.arange(400), np.arange(300))
    centroid = np.array([[(columns * small).sum(), (rows * small).sum()]]) / small.sum()
    assert camera.scaled((400, 300)).project(ray) == pytest.approx(centroid + 0.5, abs=1e-6)


def test_cropping_shifts_opencvs_principal_point_by_the_corner() -> None:
    left, top = 304, 17
    cut = calibration(K, PERSPECTIVE["12"]).cropped((left, top, 4864, 3600))
    rays = cut.unproject(grid((4864, 3600)))
    whole = opencv_pixels(calibration(K, PERSPECTIVE["12"]), rays)
    assert opencv_matrix(K)[:2, 2] - opencv_matrix(cut.intrinsics)[:2, 2] == pytest.approx([left, top])
    assert worst(cut.project(rays), whole - [left, top]) <= TOLERANCE_PX
