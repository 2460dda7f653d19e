"""ROS camera_info YAML, against OpenCV, to which ROS hands K and D as they stand."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion, Rational, ThinPrism
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.parsers.format import Fidelity
from calibrary.records import replace
from tests.parsers.cameras import BROWN, camera

K = (1733.2, 0.0, 971.6, 0.0, 1731.9, 588.3, 0.0, 0.0, 1.0)
FILE = """image_width: 1920
image_height: 1200
camera_name: front
camera_matrix:
  rows: 3
  cols: 3
  data: [{K}]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {cols}
  data: [{D}]
rectification_matrix:
  rows: 3
  cols: 3
  data: [ 1., 0., 0.,
          0., 1., 0., 0., 0., 1.]
projection_matrix:
  rows: 3
  cols: 4
  data: [1602.0, 0.0, 975.5, -144.2, 0.0, 1602.0, 590.1, 0.0, 0.0, 0.0, 1.0, 0.0]
"""
BROWN5 = (-0.1131, 0.0247, -0.00037, 0.00081, -6.2e-03)
MESSAGE = """header:
  stamp: {{secs: 1, nsecs: 2}}
  frame_id: front
height: 1200
width: 1920
distortion_model: equidistant
{d}: [0.0313, -0.0072, 0.0041, -0.0011]
{k}: [{K}]
{r}: [1, 0, 0, 0, 1, 0, 0, 0, 1]
{p}: [1733.2, 0, 971.6, 0, 0, 1731.9, 588.3, 0, 0, 0, 1, 0]
binning_x: {binning}
binning_y: 0
roi: {{x_offset: 0, y_offset: 0, height: 0, width: {roi}, do_rectify: False}}
---
"""


def listed(values: tuple[float, ...]) -> str:
    return ", ".join(map(repr, values))


def file(
    model: str = "plumb_bob", D: tuple[float, ...] = BROWN5, k: tuple[float, ...] = K, cols: int | None = None
) -> str:
    return FILE.format(model=model, K=listed(k), D=listed(D), cols=len(D) if cols is None else cols)


def message(letters: str = "dkrp", binning: int = 0, roi: int = 0) -> str:
    d, k, r, p = tuple(letters)
    return MESSAGE.format(d=d, k=k, r=r, p=p, K=listed(K), binning=binning, roi=roi)


def read(text: str) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="front.yaml")
    return calibration


def rays() -> NDArray[np.float64]:
    u, v = np.meshgrid(np.linspace(-0.55, 0.55, 25), np.linspace(-0.35, 0.35, 25))
    return np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])


@pytest.mark.parametrize(
    ("model", "D"),
    [
        ("plumb_bob", BROWN5),
        ("plumb_bob", BROWN5[:4]),
        ("rational_polynomial", (*BROWN5, 0.0083, -0.0061, 0.0042)),
        ("rational_polynomial", (*BROWN5, 0.0083, -0.0061, 0.0042, 1e-4, -2e-5, -7e-5, 2e-5)),
    ],
)
def test_it_projects_as_opencv_does_with_the_same_vector(model: str, D: tuple[float, ...]) -> None:
    matrix = np.array(K).reshape(3, 3)
    expected = cv2.projectPoints(rays(), np.zeros(3), np.zeros(3), matrix, np.array(D))[0].reshape(-1, 2)
    np.testing.assert_allclose(read(file(model, D)).project(rays()) - 0.5, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("text", [message("dkrp"), message("DKRP")], ids=["ROS 2", "ROS 1"])
def test_a_message_as_rostopic_prints_it_is_read(text: str) -> None:
    calibration = read(text)
    D = np.array([0.0313, -0.0072, 0.0041, -0.0011])
    matrix = np.array(K).reshape(3, 3)
    points = rays().reshape(-1, 1, 3)
    expected = cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), matrix, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(calibration.project(rays()) - 0.5, expected, rtol=0, atol=1e-9)
    assert calibration.intrinsics.image_size == (1920, 1200)
    assert calibration.grade is Grade.CALIBRATED


def test_the_projection_matrix_is_never_k() -> None:
    assert read(file()).intrinsics.fx == 1733.2
    assert read(file()).intrinsics.cx == 971.6 + 0.5


def test_fisheye_is_another_word_for_equidistant() -> None:
    D = (0.0313, -0.0072, 0.0041, -0.0011)
    lens = KannalaBrandt(k1=0.0313, k2=-0.0072, k3=0.0041, k4=-0.0011)
    assert read(file("equidistant", D)).distortion == read(file("fisheye", D)).distortion == lens


@pytest.mark.parametrize("word", ["equidistant", "fisheye"])
def test_a_lens_may_be_named_as_the_cameras_model(word: str) -> None:
    D = (0.0313, -0.0072, 0.0041, -0.0011)
    text = file("equidistant", D).replace("distortion_model: equidistant", f"camera_model: {word}")
    assert read(text).distortion == read(file("equidistant", D)).distortion


def test_a_camera_model_that_is_no_lens_is_none() -> None:
    assert (
        read(file().replace("distortion_model: plumb_bob", "camera_model: pinhole")).distortion
        == read(file()).distortion
    )


def test_zeros_behind_five_coefficients_of_plumb_bob_are_no_other_model() -> None:
    assert read(file(D=(*BROWN5, 0.0, 0.0, 0.0))).distortion == read(file()).distortion
    with pytest.raises(ParseError, match="8 coefficients for plumb_bob"):
        read(file(D=(*BROWN5, 0.0, 0.0, 0.1)))


def test_a_message_that_was_sent_again_is_one_camera() -> None:
    assert read(message() + message().replace("secs: 1", "secs: 2")).intrinsics == read(message()).intrinsics


def test_messages_of_several_cameras_are_named_by_their_frames() -> None:
    other = message().replace("1733.2", "1740.1").replace("front", "rear")
    cameras = parsers.decode((message() + other + message()).encode(), name="front.yaml")
    assert [(item.camera.sub_camera, item.intrinsics.fx) for item in cameras] == [
        ("front", 1733.2),
        ("rear", 1740.1),
    ]


def test_the_first_line_of_an_opencv_file_is_passed_over() -> None:
    assert read("%YAML:1.0\n---\n" + file()).intrinsics == read(file()).intrinsics
    with pytest.raises(ParseError, match="line 23"):
        read("%YAML:1.0\n" + file() + "camera_name: again\n")


@pytest.mark.parametrize("D", [(), (0.0,) * 5, (0.0,) * 4])
def test_coefficients_that_are_all_zero_or_absent_are_no_distortion(D: tuple[float, ...]) -> None:
    assert read(file(D=D)).distortion == NoDistortion()


def test_skew_is_kept_and_said() -> None:
    calibration = read(file(k=(K[0], 4.26, *K[2:])))
    assert calibration.intrinsics.skew == 4.26
    assert "skew" in calibration.notes[0]


def test_without_a_model_plumb_bob_is_assumed_and_said() -> None:
    calibration = read(file().replace("distortion_model: plumb_bob\n", ""))
    assert calibration.distortion == BrownConrady(k1=-0.1131, k2=0.0247, p1=-0.00037, p2=0.00081, k3=-0.0062)
    assert "plumb_bob" in calibration.provenance.assumptions[0]


def test_a_header_that_says_five_of_eight_coefficients_loses_none() -> None:
    calibration = read(file("rational_polynomial", (*BROWN5, 0.01, 0.02, 0.03), cols=5))
    assert isinstance(calibration.distortion, Rational)
    assert "ROS itself" in calibration.notes[0]


@pytest.mark.parametrize(("binning", "roi"), [(2, 0), (0, 640)])
def test_a_binned_or_cropped_camera_says_which_frame_k_counts_in(binning: int, roi: int) -> None:
    assert "whole frame" in read(message(binning=binning, roi=roi)).notes[0]
    assert read(message()).notes == ()


def test_another_model_is_refused_by_name() -> None:
    with pytest.raises(UnsupportedModelError, match="cylindrical"):
        read(file("cylindrical"))
    with pytest.raises(UnsupportedModelError, match="taylor"):
        read(file("taylor", k=(1.002, 0.002, 354.5, 0.001, 1.0, 230.3, 0.0, 0.0, 0.0)))


@pytest.mark.parametrize(
    ("text", "error", "match"),
    [
        (file(k=(0.0,) * 9), ParseError, "not calibrated"),
        (file(k=(*K[:3], 1.0, *K[4:])), ParseError, "not a camera matrix"),
        (file(k=K[:8]), ParseError, "8 numbers, expected 9"),
        (file(D=BROWN5[:3]), ParseError, "3 coefficients"),
        (file("equidistant"), ParseError, "5 coefficients for equidistant, expected 4"),
        (file().replace("1920", "1920.5"), ParseError, "image size"),
        (file().replace("971.6", ".nan"), ParseError, "finite"),
        (file() + "camera_name: again\n", ParseError, "duplicate key"),
        ("distortion_model: plumb_bob\nprojection_matrix: 1\n", InputError, "no format claims it"),
    ],
)
def test_a_broken_file_names_what_is_wrong(text: str, error: type[InputError], match: str) -> None:
    with pytest.raises(error, match=match):
        read(text)


def test_a_file_without_a_size_names_the_key() -> None:
    text = file().replace("image_width: 1920\n", "")
    with pytest.raises(ParseError, match="image_width"):
        parsers.decode(text.encode(), name="front.yaml", format="ros_camera_info")


def test_numbers_are_written_so_that_yaml_1_1_reads_them_as_numbers() -> None:
    lens = BrownConrady(k1=1e-05, k2=-2.5e-07, p1=1e-300, p2=-3e-4, k3=1e16)
    data, verdict = parsers.encode(
        [replace(camera(lens), grade=Grade.CALIBRATED)], "ros_camera_info", max_error_px=1e9
    )
    document = yaml.safe_load(data)
    assert document["distortion_coefficients"]["data"] == [1e-05, -2.5e-07, 1e-300, -3e-4, 1e16]
    assert verdict.outcome is Fidelity.EXACT


def test_what_ros_needs_is_written_in_its_order() -> None:
    data, verdict = parsers.encode([camera(BROWN)], "ros_camera_info")
    document = yaml.safe_load(data)
    assert list(document) == [
        "image_width", "image_height", "camera_name", "camera_matrix", "distortion_model",
        "distortion_coefficients", "rectification_matrix", "projection_matrix",
    ]  # fmt: skip
    assert document["distortion_model"] == "plumb_bob"
    assert document["camera_matrix"] == {
        "rows": 3, "cols": 3, "data": [3650.1, 0.0, 2741.3 - 0.5, 0.0, 3648.7, 1815.9 - 0.5, 0.0, 0.0, 1.0],
    }  # fmt: skip
    assert document["rectification_matrix"]["data"] == np.eye(3).ravel().tolist()
    assert (
        np.array(document["projection_matrix"]["data"]).reshape(3, 4)[:, :3].ravel().tolist()
        == document["camera_matrix"]["data"]
    )
    assert verdict.dropped == ()


def test_a_rectification_goes_back_beside_its_own_k_only() -> None:
    original = read(file())
    data, verdict = parsers.encode([original], "ros_camera_info")
    assert yaml.safe_load(data)["projection_matrix"]["data"][:4] == [1602.0, 0.0, 975.5, -144.2]
    assert yaml.safe_load(data)["camera_name"] == "front"
    assert verdict.dropped == ()
    smaller = original.scaled((960, 600))
    data, verdict = parsers.encode([smaller], "ros_camera_info")
    assert yaml.safe_load(data)["projection_matrix"]["data"][0] == 1733.2 / 2
    assert "ros_camera_info/projection_matrix" in verdict.dropped


def test_what_else_a_message_said_survives() -> None:
    original = read(message())
    data, _ = parsers.encode([original], "ros_camera_info")
    assert yaml.safe_load(data)["header"] == {"stamp": {"secs": 1, "nsecs": 2}, "frame_id": "front"}
    again = parsers.decode(data, name="front.yaml")[0]
    assert dict(again.extras).items() >= dict(original.extras).items()


def test_a_thin_prism_is_refitted_or_refused() -> None:
    lens = ThinPrism(
        k1=-0.11, k2=0.02, p1=0.0, p2=0.0, k3=0.0, k4=0.0, k5=0.0, k6=0.0, s1=1e-5, s2=0.0, s3=0.0, s4=0.0
    )
    with pytest.raises(UnsupportedModelError, match="--max-error-px"):
        parsers.encode([camera(lens)], "ros_camera_info", max_error_px=1e-6)
