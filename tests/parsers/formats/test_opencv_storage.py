"""OpenCV's files, against cv2.FileStorage and cv2.projectPoints themselves."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Grade, Quality
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    KannalaBrandt,
    NoDistortion,
    Rational,
    ThinPrism,
    Tilted,
    Unified,
)
from calibrary.errors import InputError, MissingTagError, ParseError
from calibrary.parsers.format import Fidelity
from calibrary.records import replace
from tests.parsers.cameras import BROWN, SIZE, camera
from tests.parsers.formats.opencv_storages import D14, K_CV, READ, SYNTAXES, YAML, by_opencv, read


def rays() -> NDArray[np.float64]:
    u, v = np.meshgrid(np.linspace(-0.7, 0.7, 25), np.linspace(-0.48, 0.48, 25))
    return np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])


@pytest.mark.parametrize("suffix", SYNTAXES)
@pytest.mark.parametrize(
    ("count", "model"), [(4, BrownConrady), (5, BrownConrady), (8, Rational), (12, ThinPrism), (14, Tilted)]
)
def test_what_opencv_writes_projects_as_opencv_projects(
    suffix: str, count: int, model: type[Distortion]
) -> None:
    D = np.array(D14[:count])
    data = by_opencv(
        suffix, image_width=5472, image_height=3648, camera_matrix=K_CV, distortion_coefficients=D
    )
    [calibration] = read(data)
    assert type(calibration.distortion) is model
    expected = cv2.projectPoints(rays(), np.zeros(3), np.zeros(3), K_CV, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(calibration.project(rays()) - 0.5, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("suffix", SYNTAXES)
def test_what_opencv_calls_fisheye_projects_as_its_fisheye(suffix: str) -> None:
    D = np.array([0.0313, -0.0072, 0.0041, -0.0011])
    data = by_opencv(
        suffix,
        image_width=5472,
        image_height=3648,
        fisheye_model=1,
        camera_matrix=K_CV,
        distortion_coefficients=D,
    )
    [calibration] = read(data)
    assert isinstance(calibration.distortion, KannalaBrandt)
    points = rays().reshape(-1, 1, 3)
    expected = cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), K_CV, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(calibration.project(rays()) - 0.5, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("suffix", [*SYNTAXES, ".yaml"])
@pytest.mark.parametrize(
    "lens",
    [
        NoDistortion(),
        BROWN,
        Rational(**dict(zip(Rational.names(), D14, strict=False))),
        ThinPrism(**dict(zip(ThinPrism.names(), D14, strict=False))),
        Tilted(**dict(zip(Tilted.names(), D14, strict=False))),
    ],
    ids=lambda lens: lens.model,
)
def test_what_we_write_opencv_reads_and_projects_the_same(suffix: str, lens: Distortion) -> None:
    original = camera(lens)
    data, verdict = parsers.encode([original], "opencv_storage", name=f"camera{suffix}")
    storage = cv2.FileStorage(data.decode(), READ)
    K, D = storage.getNode("camera_matrix").mat(), storage.getNode("distortion_coefficients").mat()
    assert verdict.outcome is Fidelity.EXACT
    assert (storage.getNode("image_width").real(), storage.getNode("image_height").real()) == SIZE
    expected = cv2.projectPoints(rays(), np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(original.project(rays()) - 0.5, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("suffix", SYNTAXES)
def test_opencv_reads_the_very_same_numbers(suffix: str) -> None:
    original = replace(camera(), quality=Quality(rms_px=0.1 + 0.2, views=31))
    data, _ = parsers.encode([original], "opencv_storage", name=f"camera{suffix}")
    storage = cv2.FileStorage(data.decode(), READ)
    assert storage.getNode("camera_matrix").mat().tolist() == [
        [3650.1, 0.0, 2741.3 - 0.5],
        [0.0, 3648.7, 1815.9 - 0.5],
        [0.0, 0.0, 1.0],
    ]
    assert storage.getNode("distortion_coefficients").mat().tolist() == [[*BROWN.coefficients.values()]]
    assert storage.getNode("avg_reprojection_error").real() == 0.1 + 0.2
    assert storage.getNode("nframes").real() == 31


def test_the_principal_point_moves_by_half_a_pixel() -> None:
    [calibration] = read(YAML)
    assert (calibration.intrinsics.cx, calibration.intrinsics.cy) == (2736.7, 1825.2)
    assert calibration.grade is Grade.CALIBRATED


@pytest.mark.parametrize("head", ["%YAML:1.0\n---\n", "%YAML:1.0\n", "%YAML 1.2\n---\n", "---\n", ""])
def test_every_head_of_the_yaml_dialect_is_read(head: str) -> None:
    assert read(head + YAML.partition("---\n")[2])[0].distortion == BrownConrady(
        k1=-0.0125, k2=0.0231, p1=-0.0004, p2=0.0008, k3=-0.0172
    )


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_windows_line_ends_and_byte_order_marks_are_read(encoding: str) -> None:
    [calibration] = read(YAML.replace("\n", "\r\n").encode(encoding))
    assert calibration.intrinsics.fx == 3650.1


@pytest.mark.parametrize(
    ("matrix", "coefficients"),
    [
        ("camera_matrix", "distortion_coefficients"),
        ("Camera_Matrix", "Distortion_Coefficients"),
        ("cameraMatrix", "distCoeffs"),
        ("camera_matrix", "dist_coeffs"),
        ("CameraMat", "DistCoeff"),
        ("K", "D"),
        ("M1", "D1"),
        ("K1", "D1"),
        ("cameraMatrix1", "distCoeffs1"),
        ("camera_matrix_left", "distortion_coefficients_left"),
        ("LEFT.K", "LEFT.D"),
        ("K_l", "D_l"),
        ("mtx", "dist"),
        ("intrinsic", "distortion"),
    ],
)
def test_the_spellings_of_many_programs_are_known(matrix: str, coefficients: str) -> None:
    text = YAML.replace("camera_matrix", matrix).replace("distortion_coefficients", coefficients)
    [calibration] = read(text)
    assert calibration.intrinsics.fy == 3649.8
    assert calibration.distortion is not None
    assert calibration.provenance.tag == f"{matrix}, {coefficients}"


@pytest.mark.parametrize(
    "size",
    ["image_Width: 5472\nimage_Height: 3648", "width: 5472\nheight: 3648.0", "ImageSize: [ 5472, 3648 ]"],
)
def test_the_image_size_has_many_spellings(size: str) -> None:
    text = YAML.replace("image_width: 5472\nimage_height: 3648", size)
    assert read(text)[0].intrinsics.image_size == SIZE


def test_a_stereo_file_gives_both_cameras_in_order() -> None:
    D = np.array(D14[:5])
    right = K_CV + np.array([[0, 0, 7.7], [0, 0, 0], [0, 0, 0]])
    data = by_opencv(".yml", M1=K_CV, D1=D, M2=right, D2=2 * D)
    first, second = read(data, image_size=SIZE)
    assert (first.camera.sub_camera, second.camera.sub_camera) == ("1", "2")
    assert (first.provenance.tag, second.provenance.tag) == ("M1, D1", "M2, D2")
    assert second.intrinsics.cx - first.intrinsics.cx == pytest.approx(7.7)
    assert second.distortion is not None
    assert second.distortion.coefficients["k1"] == -0.025


def test_a_stereo_file_does_not_say_its_image_size() -> None:
    with pytest.raises(MissingTagError, match=r"--image-size"):
        read(by_opencv(".yml", M1=K_CV, D1=np.zeros(5)))


def test_an_image_size_that_contradicts_the_file_is_refused() -> None:
    with pytest.raises(InputError, match=r"5472×3648.*4000×3000"):
        read(YAML, image_size=(4000, 3000))


@pytest.mark.parametrize(("matrix_key", "coefficients_key"), [("K", "D"), ("cameraMatrix", "distCoeffs")])
def test_four_coefficients_under_other_keys_need_a_word(matrix_key: str, coefficients_key: str) -> None:
    values = {matrix_key: K_CV, coefficients_key: np.array(D14[:4])}
    data = by_opencv(".yml", image_width=5472, image_height=3648, **values)
    with pytest.raises(ParseError, match="--set distortion=brown"):
        read(data)
    assert isinstance(read(data, options={"distortion": "brown"})[0].distortion, BrownConrady)
    assert isinstance(read(data, options={"distortion": "fisheye"})[0].distortion, KannalaBrandt)


@pytest.mark.parametrize(
    ("matrix_key", "coefficients_key"), [("camera_matrix", "distortion_coefficients"), ("M1", "D1")]
)
def test_four_coefficients_under_opencvs_own_keys_are_browns(matrix_key: str, coefficients_key: str) -> None:
    values = {matrix_key: K_CV, coefficients_key: np.array(D14[:4])}
    [calibration] = read(by_opencv(".yml", image_width=5472, image_height=3648, **values))
    assert calibration.distortion == BrownConrady(k1=D14[0], k2=D14[1], p1=D14[2], p2=D14[3])


def test_five_coefficients_are_no_fisheye_whatever_is_said() -> None:
    with pytest.raises(ParseError, match="5 coefficients of a fisheye"):
        read(YAML, options={"distortion": "fisheye"})


def test_a_count_that_opencv_does_not_know_is_refused() -> None:
    text = YAML.replace("rows: 5", "rows: 6").replace("-0.0172 ]", "-0.0172, 0.1 ]")
    with pytest.raises(
        ParseError, match="distortion_coefficients: 6 distortion coefficients, expected 4, 5, 8"
    ):
        read(text)


def test_a_header_that_disagrees_with_its_data_is_refused() -> None:
    with pytest.raises(ParseError, match="its header says 4×1, but there are 5 numbers"):
        read(YAML.replace("rows: 5", "rows: 4"))


MIRROR = {"xi": 1.31, "k1": -0.21, "k2": 0.037, "p1": 0.0012, "p2": -0.0007}
K_MIRROR = np.array([[2131.7, 0.9, 2745.31], [0.0, 2129.3, 1819.87], [0.0, 0.0, 1.0]])


def omnidir_pixels(rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """``cv::omnidir::projectPoints`` line by line; px from the first pixel's centre.

    Source: opencv_contrib, modules/ccalib/src/omnidir.cpp.
    """
    xi, k1, k2, p1, p2 = MIRROR.values()
    x, y, z = (rays / np.linalg.norm(rays, axis=1, keepdims=True)).T
    xu, yu = x / (z + xi), y / (z + xi)
    r2 = xu**2 + yu**2
    r4 = r2**2
    xd = xu * (1 + k1 * r2 + k2 * r4) + 2 * p1 * xu * yu + p2 * (r2 + 2 * xu**2)
    yd = yu * (1 + k1 * r2 + k2 * r4) + p1 * (r2 + 2 * yu**2) + 2 * p2 * xu * yu
    (fx, s, cx), (_, fy, cy), _ = K_MIRROR
    return np.column_stack([fx * xd + s * yd + cx, fy * yd + cy])


@pytest.mark.parametrize("xi", [MIRROR["xi"], np.array([[MIRROR["xi"]]])], ids=["number", "matrix"])
def test_the_mirror_model_is_omnidirs(xi: float | NDArray[np.float64]) -> None:
    D = np.array([[MIRROR[name] for name in ("k1", "k2", "p1", "p2")]])
    data = by_opencv(
        ".yml",
        image_width=5472,
        image_height=3648,
        camera_matrix=K_MIRROR,
        distortion_coefficients=D,
        xi=xi,
    )
    [calibration] = read(data)
    angles = np.radians([[a, b] for a in (5, 40, 80, 95) for b in range(0, 360, 30)])
    rays = np.column_stack(
        [
            np.sin(angles[:, 0]) * np.cos(angles[:, 1]),
            np.sin(angles[:, 0]) * np.sin(angles[:, 1]),
            np.cos(angles[:, 0]),
        ]
    )
    assert calibration.distortion == Unified(**MIRROR)
    assert np.abs(calibration.project(rays) - 0.5 - omnidir_pixels(rays)).max() <= 1e-9
    assert any("fx/(1 + xi)" in note for note in calibration.notes)


@pytest.mark.parametrize("syntax", SYNTAXES)
def test_the_mirror_model_is_written_as_omnidir_reads_it(syntax: str) -> None:
    data, verdict = parsers.encode([camera(Unified(**MIRROR))], "opencv_storage", name=f"camera{syntax}")
    storage = cv2.FileStorage(data.decode(), READ)
    assert verdict.outcome is Fidelity.EXACT
    assert storage.getNode("xi").real() == MIRROR["xi"]
    assert storage.getNode("distortion_coefficients").mat().ravel().tolist() == [
        -0.21,
        0.037,
        0.0012,
        -0.0007,
    ]


def test_each_camera_of_a_mirror_pair_has_its_own_xi() -> None:
    pair = [camera(Unified(**MIRROR | {"xi": xi})) for xi in (0.7, 1.3)]
    data, _ = parsers.encode(pair, "opencv_storage", name="pair.yml")
    again = parsers.decode(data, name="pair.yml")
    assert [item.distortion for item in again] == [item.distortion for item in pair]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("xi: 0.9\n", "5 distortion coefficients beside xi, expected cv2.omnidir's four"),
        ("xi: -1.0\n", "xi is -1, expected one number above −1"),
        ("xi2: 0.9\n", "there is no camera matrix beside this xi"),
        ("xi: [ 0.9, 0.8 ]\n", "xi is 0.9, 0.8, expected one number"),
    ],
)
def test_an_xi_that_makes_no_mirror_is_refused(more: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(YAML + more)


def test_an_xi_without_coefficients_is_refused() -> None:
    with pytest.raises(ParseError, match="no distortion coefficients beside this xi"):
        read(by_opencv(".yml", image_width=5472, image_height=3648, camera_matrix=K_CV, xi=0.9))
