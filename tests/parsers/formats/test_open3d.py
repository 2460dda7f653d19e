"""Open3D's cameras: a matrix by columns, and trajectories of them."""

from __future__ import annotations

import json

import pytest

from calibrary import parsers
from calibrary.calibration import Grade
from calibrary.distortion import BrownConrady
from calibrary.errors import ParseError
from tests.parsers.samples import Sample

CAMERA = {"width": 640, "height": 480, "intrinsic_matrix": [621.4, 0, 0, 0.5, 621.3, 0, 313.7, 240.2, 1]}
SAMPLES = {"open3d": Sample(json.dumps(CAMERA).encode())}


def decoded(document: object) -> list[tuple[float, ...]]:
    found = parsers.decode(json.dumps(document).encode(), name="camera.json")
    assert all(item.distortion is None and item.grade is Grade.DERIVED for item in found)
    K = [item.intrinsics for item in found]
    return [(one.fx, one.fy, one.cx, one.cy, one.skew, *one.image_size) for one in K]


def test_the_matrix_is_read_by_columns_from_the_pixels_centre() -> None:
    assert decoded(CAMERA) == [(621.4, 621.3, 314.2, 240.7, 0.5, 640, 480)]


def test_a_trajectory_has_each_camera_once() -> None:
    other = {**CAMERA, "width": 1280}
    images = [{"class_name": "PinholeCameraParameters", "intrinsic": one} for one in (CAMERA, CAMERA, other)]
    found = decoded({"class_name": "PinholeCameraTrajectory", "parameters": images})
    assert [one[5] for one in found] == [640, 1280]


def test_the_parameters_of_one_image_are_its_camera() -> None:
    document = {"class_name": "PinholeCameraParameters", "extrinsic": [1, 0, 0, 0], "intrinsic": CAMERA}
    assert decoded(document) == decoded(CAMERA)


def test_coefficients_beside_the_matrix_are_opencvs() -> None:
    document = {**CAMERA, "distortion_coeffs": [0.12, -0.25, 0.001, -0.0005, 0.08]}
    [item] = parsers.decode(json.dumps(document).encode(), name="camera.json")
    assert item.distortion == BrownConrady(k1=0.12, k2=-0.25, p1=0.001, p2=-0.0005, k3=0.08)
    assert "distortion_coeffs was read in OpenCV's order" in item.notes[-1]


def test_a_matrix_by_rows_is_refused() -> None:
    rows = {**CAMERA, "intrinsic_matrix": [621.4, 0, 313.7, 0, 621.3, 240.2, 0, 0, 1]}
    with pytest.raises(ParseError, match="not a camera matrix"):
        parsers.decode(json.dumps(rows).encode(), name="camera.json", format="open3d")
