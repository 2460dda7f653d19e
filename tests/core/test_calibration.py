"""The core types: K, what becomes of it, and points through a whole camera."""

from __future__ import annotations

import math
import pickle
import tracemalloc

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion
from calibrary.errors import FrameError, InputError
from calibrary.image_size import same_aspect
from calibrary.records import replace
from tests.strategies import DISTORTIONS, brown, calibration, cameras, grid
from tests.thorough import examples

K = Intrinsics(fx=3651.13, fy=3648.79, cx=2719.61, cy=1851.37, skew=0.7, image_size=(5472, 3648))
LENS = BrownConrady(k1=-0.2613, k2=0.1071, p1=0.00079, p2=-0.00013, k3=-0.0321)


def test_k_is_upper_triangular() -> None:
    assert K.matrix.tolist() == [[3651.13, 0.7, 2719.61], [0.0, 3648.79, 1851.37], [0.0, 0.0, 1.0]]


def test_k_gives_back_the_numbers_it_was_made_of() -> None:
    assert Intrinsics.from_matrix(K.matrix, K.image_size) == K


def test_a_k_that_is_scaled_as_a_whole_is_brought_to_one() -> None:
    assert Intrinsics.from_matrix(K.matrix * 4.0, K.image_size) == K


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.eye(4), r"shape \(4, 4\), expected \(3, 3\)"),
        (np.full((3, 3), math.nan), "NaN or infinity"),
        (K.matrix.T, "not upper triangular"),
        (np.zeros((3, 3)), "not upper triangular"),
        (np.diag([-100.0, 100.0, 1.0]), "expected positive ones"),
    ],
)
def test_what_is_no_intrinsic_matrix_is_refused(matrix: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Intrinsics.from_matrix(matrix, K.image_size)


@pytest.mark.parametrize("name", ["fx", "fy", "cx", "cy", "skew"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_number_of_pixels_is_finite(name: str, value: float) -> None:
    numbers = {"fx": 100.0, "fy": 100.0, "cx": 50.0, "cy": 50.0, "skew": 0.0, name: value}
    with pytest.raises(InputError, match=f"{name} is"):
        Intrinsics(**numbers, image_size=(100, 100))


@pytest.mark.parametrize("size", [(0, 100), (100, -1), (100.5, 100), (math.nan, 100), (100, math.inf)])
def test_an_image_has_whole_positive_sides(size: ImageSize) -> None:
    with pytest.raises(InputError, match="expected whole positive numbers"):
        Intrinsics(fx=100, fy=100, cx=50, cy=50, image_size=size)
    with pytest.raises(InputError, match="expected whole positive numbers"):
        K.scaled(size)


def test_scaling_multiplies_all_of_k() -> None:
    half = K.scaled((2736, 1824))
    assert (half.matrix[:2] == K.matrix[:2] * 0.5).all()
    assert half.image_size == (2736, 1824)


def test_scaling_there_and_back_is_the_same_camera() -> None:
    assert K.scaled((1368, 912)).scaled(K.image_size) == K


def test_another_aspect_is_a_crop_and_no_scale() -> None:
    with pytest.raises(FrameError, match="crop it first"):
        K.scaled((3840, 2160))


def test_a_pixel_of_rounding_is_no_other_aspect() -> None:
    assert same_aspect((5472, 3648), (60, 39))
    assert not same_aspect((4000, 3000), (4000, 2250))


@pytest.mark.parametrize("box", [(-1, 0, 10, 10), (0, 0, 5473, 10), (10, 0, 10, 3649), (0, 0, 0, 10)])
def test_a_crop_lies_inside_its_frame(box: tuple[float, float, int, int]) -> None:
    with pytest.raises(FrameError, match="expected a box inside the frame"):
        K.cropped(box)


def test_scaling_and_cropping_carry_the_frame_into_the_cameras_key() -> None:
    camera = calibration(K, LENS)
    assert camera.scaled((1368, 912)).camera.image_size == (1368, 912)
    assert camera.cropped((304, 0, 4864, 3648)).camera.image_size == (4864, 3648)
    assert camera.scaled((1368, 912)).distortion == LENS


@settings(max_examples=examples(24))
@given(cameras(), st.sampled_from([0.5, 0.25, 2.0, 3.0]))
def test_projecting_and_scaling_commute(camera: Calibration, scale: float) -> None:
    width, height = camera.intrinsics.image_size
    size = (round(width * scale), round(height * scale))
    assume(size == (width * scale, height * scale))
    rays = camera.unproject(grid(camera.intrinsics.image_size))
    scaled = camera.scaled(size).project(rays)
    assert np.allclose(scaled, camera.project(rays) * scale, rtol=0, atol=1e-10, equal_nan=True)


@settings(max_examples=examples(24))
@given(cameras(), st.integers(0, 100), st.integers(0, 100))
def test_projecting_and_cropping_commute(camera: Calibration, left: int, top: int) -> None:
    width, height = camera.intrinsics.image_size
    rays = camera.unproject(grid(camera.intrinsics.image_size))
    cut = camera.cropped((left, top, width - 200, height - 150)).project(rays)
    assert np.allclose(cut, camera.project(rays) - [left, top], rtol=0, atol=1e-10, equal_nan=True)


def in_view(camera: Calibration) -> np.ndarray:
    """Pixels well inside the part of the frame in which the lens shows anything."""
    pixels = grid(camera.intrinsics.image_size)
    return pixels[np.isfinite(camera.unproject(pixels)).all(axis=1)]


@settings(max_examples=examples(24))
@given(cameras())
def test_a_ray_is_seen_at_the_pixel_it_came_from(camera: Calibration) -> None:
    pixels = in_view(camera)
    seen = camera.project(camera.unproject(pixels))
    assert np.abs(seen - pixels).max(initial=0.0) <= 1e-9


@settings(max_examples=examples(24))
@given(cameras(), st.floats(0.02, 0.98), st.floats(0, 6.28))
def test_a_point_is_found_again_in_its_direction(camera: Calibration, part: float, turn: float) -> None:
    assert camera.distortion is not None
    angle = part * min(camera.distortion.max_angle_rad(), math.radians(80))
    ray = np.array([[math.sin(angle) * math.cos(turn), math.sin(angle) * math.sin(turn), math.cos(angle)]])
    back = camera.unproject(camera.project(ray * 123.4))
    assert np.abs(back - ray).max() <= 1e-11


@settings(max_examples=examples(24))
@given(cameras(brown(radial=0.05)))
def test_a_lens_that_folds_outside_the_frame_shows_something_everywhere(camera: Calibration) -> None:
    corner = np.abs(grid(camera.intrinsics.image_size) - [camera.intrinsics.cx, camera.intrinsics.cy]).max()
    assume(
        camera.distortion is not None and camera.distortion.valid_radius() > 3 * corner / camera.intrinsics.fx
    )
    assert np.isfinite(camera.unproject(grid(camera.intrinsics.image_size))).all()


@settings(max_examples=examples(24))
@given(cameras())
def test_rays_have_unit_length(camera: Calibration) -> None:
    rays = camera.unproject(in_view(camera))
    assert np.abs(np.linalg.norm(rays, axis=1) - 1.0).max(initial=0.0) <= 4e-16 * 4


@given(cameras(brown()))
def test_what_is_behind_a_perspective_camera_is_not_seen(camera: Calibration) -> None:
    behind = np.array([[0.1, 0.2, -1.0], [0.0, 0.0, -1.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.0]])
    assert np.isnan(camera.project(behind)).all()


@pytest.mark.parametrize("lens", [None, NoDistortion(), LENS, KannalaBrandt(k1=0.02, k2=0, k3=0, k4=0)])
def test_nan_in_is_nan_out(lens: BrownConrady | None) -> None:
    camera = calibration(K, lens)
    points = np.array(
        [[math.nan, 0.1, 1.0], [0.1, math.nan, 1.0], [0.1, 0.1, math.nan], [math.inf, 0.0, 1.0]]
    )
    assert np.isnan(camera.project(points)).all()
    assert np.isnan(camera.unproject(np.array([[math.nan, 5.0], [5.0, math.nan], [math.inf, 5.0]]))).all()


@pytest.mark.parametrize("lens", [None, NoDistortion(), LENS, KannalaBrandt(k1=0.02, k2=0, k3=0, k4=0)])
@pytest.mark.parametrize("unit", [1e-300, 1e-3, 1e6, 1e300])
def test_only_the_direction_of_a_point_matters(lens: BrownConrady | None, unit: float) -> None:
    camera = calibration(K, lens)
    point = np.array([[0.31, -0.17, 1.0]])
    assert camera.project(point * unit) == pytest.approx(camera.project(point), abs=1e-9)


def test_unknown_distortion_projects_as_a_pinhole() -> None:
    rays = calibration(K, NoDistortion()).unproject(grid(K.image_size))
    assert (calibration(K, None).unproject(grid(K.image_size)) == rays).all()
    assert (calibration(K, None).project(rays) == calibration(K, NoDistortion()).project(rays)).all()


def test_skew_leans_the_columns() -> None:
    seen = calibration(K, None).project(np.array([[0.0, 0.1, 1.0]]))
    assert seen[0] == pytest.approx([2719.61 + 0.07, 1851.37 + 364.879])


@settings(max_examples=examples(24))
@given(cameras(DISTORTIONS["kannala-brandt"]), st.floats(1.58, 3.1), st.floats(0, 6.28))
def test_a_fisheye_sees_behind_itself_up_to_its_fold(camera: Calibration, angle: float, turn: float) -> None:
    lens = camera.distortion
    assert lens is not None
    ray = np.array([[math.sin(angle) * math.cos(turn), math.sin(angle) * math.sin(turn), math.cos(angle)]])
    seen = camera.project(ray)
    if angle < 0.99 * lens.max_angle_rad():
        assert np.abs(camera.unproject(seen) - ray).max() <= 1e-11
    elif angle >= lens.max_angle_rad():
        assert np.isnan(seen).all()


def test_a_fisheye_sees_its_axis_at_the_principal_point_and_nothing_straight_back() -> None:
    camera = calibration(K, KannalaBrandt(k1=0.02, k2=0, k3=0, k4=0))
    seen = camera.project(np.array([[0.0, 0.0, 2.0], [0.0, 0.0, -2.0], [0.0, 0.0, 0.0]]))
    assert (seen[0] == [K.cx, K.cy]).all()
    assert np.isnan(seen[1:]).all()
    assert camera.unproject(np.array([[K.cx, K.cy]])).tolist() == [[0.0, 0.0, 1.0]]


@pytest.mark.parametrize("lens", [None, NoDistortion(), LENS])
def test_the_callers_points_are_never_written_to(lens: BrownConrady | None) -> None:
    points, pixels = np.array([[0.1, 0.2, -1.0]]), np.array([[math.inf, 5.0]])
    calibration(K, lens).project(points)
    calibration(K, lens).unproject(pixels)
    assert points.tolist() == [[0.1, 0.2, -1.0]]
    assert pixels.tolist() == [[math.inf, 5.0]]


def test_lists_of_points_will_do() -> None:
    assert calibration(K, None).project([[0, 0, 1]]).tolist() == [[K.cx, K.cy]]


@pytest.mark.parametrize(
    "points", [[0, 0, 1], [[0, 0]], [["a", "b", "c"]], [[1, 2, 3], [4, 5]], [[10**400, 0, 1]]]
)
def test_points_of_another_shape_are_refused(points: object) -> None:
    with pytest.raises(InputError, match=r"\(N, 3\)"):
        calibration(K, None).project(points)  # type: ignore[arg-type] # that is the point


def test_a_million_points_need_little_memory_beside_the_result() -> None:
    camera = calibration(K, LENS)
    pixels = np.random.default_rng(7).uniform((0, 0), K.image_size, (1_000_000, 2))
    tracemalloc.start()
    rays = camera.unproject(pixels)
    unprojecting = tracemalloc.get_traced_memory()[1] - rays.nbytes
    tracemalloc.reset_peak()
    seen = camera.project(rays)
    projecting = tracemalloc.get_traced_memory()[1] - rays.nbytes - seen.nbytes
    tracemalloc.stop()
    assert np.abs(seen - pixels).max() <= 1e-9
    assert max(unprojecting, projecting) < 50e6


def test_a_calibration_crosses_processes() -> None:
    camera = calibration(K, LENS)
    assert pickle.loads(pickle.dumps(camera)) == camera  # noqa: S301 - our own bytes


def test_grades_rank_from_measured_to_guessed() -> None:
    assert sorted(Grade, key=lambda grade: grade.rank) == [
        Grade.CALIBRATED,
        Grade.ADJUSTED,
        Grade.DESIGN,
        Grade.DERIVED,
        Grade.PRIOR,
        Grade.SEED,
    ]
    assert [grade.is_metric for grade in Grade] == [True, True, True, True, False, False]


def test_a_camera_is_named_without_saying_its_maker_twice() -> None:
    assert str(CameraKey(make="Canon", model="Canon EOS M")) == "Canon EOS M"
    assert str(CameraKey(make="DJI", model="FC6310R", focal_mm=8.8, image_size=(5472, 3648))) == (
        "DJI FC6310R 8.8 mm 5472×3648"
    )
    assert str(CameraKey()) == "unknown camera"


def test_k_and_dist_are_the_matrix_of_the_file_and_opencvs_coefficients() -> None:
    K = [[3650.0, 0.0, 2735.5], [0.0, 3650.0, 1823.5], [0.0, 0.0, 1.0]]
    camera = Calibration.from_opencv(K, [-0.1, 0.02, 0.001, -0.002, 0.03], image_size=(5472, 3648))
    assert camera.K.tolist() == camera.to_dict()["K"]
    assert camera.dist is not None
    assert camera.dist.tolist() == [-0.1, 0.02, 0.001, -0.002, 0.03]
    assert replace(camera, distortion=None).dist is None
    assert repr(camera) == (
        "<Calibration of unknown camera 5472×3648: fx 3650.00 fy 3650.00 cx 2736.00 cy 1824.00 px, brown, calibrated>"
    )
