"""Kalibr's printed results, held against the camera chain that Kalibr writes beside them."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.errors import MissingTagError, ParseError, UnsupportedModelError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample

FILE = """Calibration results
====================
Camera-system parameters:
cam0 (/cam0/image_raw):
    type: <class 'aslam_cv.libaslam_cv_python.DistortedPinholeCameraGeometry'>
    distortion: [-0.2131  0.0447 -0.00037  0.00081] +- [0.0012 0.0011 0.0001 0.0001]
    projection: [433.2 432.9 371.6 238.3] +- [0.13 0.12 0.22 0.24]
    reprojection error: [0.000012, -0.000003] +- [0.120000, 0.090000]

cam1 (/cam1/image_raw):
    type: <class 'aslam_cv.libaslam_cv_python.DoubleSphereCameraGeometry'>
    distortion: [] +- []
    projection: [ -0.27 0.55 433.2 432.9 371.6 238.3] +- [0.01 0.02 0.13 0.12 0.22 0.24]
    reprojection error: [0.000012, -0.000003] +- [0.120000, 0.090000]

baseline T_1_0:
    q: [0.0 0.0 0.0 1.0] +- [0.0 0.0 0.0]

Target configuration
====================
  Type: aprilgrid
"""
SIZE = (752, 480)
CHAIN = """cam0:
  camera_model: ds
  intrinsics: [-0.27, 0.55, 433.2, 432.9, 371.6, 238.3]
  distortion_model: none
  distortion_coeffs: []
  resolution: [752, 480]
"""
SAMPLES = {"kalibr_results": Sample(FILE.encode())}


def read(text: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="results-cam.txt", image_size=SIZE)


def test_every_camera_is_that_of_the_chain() -> None:
    first, second = read(FILE)
    assert_projects_as_opencv(first, (433.2, 432.9, 371.6, 238.3), (-0.2131, 0.0447, -0.00037, 0.00081))
    [chain] = parsers.decode(CHAIN.encode(), name="camchain.yaml")
    assert (second.intrinsics, second.distortion) == (chain.intrinsics, chain.distortion)
    assert [item.camera.sub_camera for item in (first, second)] == ["cam0", "cam1"]


def test_the_deviations_are_of_k_and_the_lens() -> None:
    K = {"fx": 0.13, "fy": 0.12, "cx": 0.22, "cy": 0.24}
    stds = [dict(item.quality.std) for item in read(FILE) if item.quality is not None]
    assert stds == [
        K | {"k1": 0.0012, "k2": 0.0011, "p1": 0.0001, "p2": 0.0001},
        K | {"xi": 0.01, "alpha": 0.02},
    ]


def test_deviations_of_another_number_of_coefficients_are_a_fault() -> None:
    with pytest.raises(ParseError, match="distortion: 3 numbers, expected 4"):
        read(FILE.replace("0.0001 0.0001]", "0.0001]"))


def test_the_image_size_has_to_be_given() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(FILE.encode(), name="results-cam.txt")


@pytest.mark.parametrize(
    ("old", "new", "kind", "match"),
    [
        ("DistortedPinholeCameraGeometry", "DepthCameraGeometry", UnsupportedModelError, "camchain"),
        (" 0.00081]", "]", ParseError, "distortion: 4 numbers, expected 3"),
        ("[0.13 0.12 0.22 0.24]\n    reprojection error: [0.000012, -0.000003] +- [0.120000, 0.090000]\n\ncam1",
         "[0.13]\n\ncam1", ParseError, "1 numbers, expected 4"),
        ("    distortion: []", "    nothing: []", ParseError, "cam1: there is no distortion and projection"),
        ("type:", "kind:", ParseError, "no type"),
        ("433.2 432.9", "433.2 wide", ParseError, "not a number"),
    ],
)  # fmt: skip
def test_a_broken_file_names_what_is_wrong(old: str, new: str, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        parsers.decode(FILE.replace(old, new).encode(), name="x", format="kalibr_results", image_size=SIZE)


IMUCAM = """Calibration results
===================

Calibration configuration
=========================

cam0
-----
  Camera model: pinhole
  Focal length: [433.2, 432.9]
  Principal point: [371.6, 238.3]
  Distortion model: radtan
  Distortion coefficients: [-0.2131, 0.0447, -0.00037, 0.00081]
  Type: aprilgrid
  Tags:
    Rows: 6


cam1
-----
  Camera model: ds
  DS xi: -0.27
  DS alpha: 0.55
  Focal length: [433.2, 432.9]
  Principal point: [371.6, 238.3]
  Distortion model: none
  Distortion coefficients: []
"""


def test_the_cameras_beside_an_imu_are_read_by_the_names_of_their_numbers() -> None:
    first, second = read(IMUCAM)
    assert_projects_as_opencv(first, (433.2, 432.9, 371.6, 238.3), (-0.2131, 0.0447, -0.00037, 0.00081))
    [chain] = parsers.decode(CHAIN.encode(), name="camchain.yaml")
    assert (second.intrinsics, second.distortion) == (chain.intrinsics, chain.distortion)
    assert first.quality is None


def test_a_number_that_is_missing_is_named() -> None:
    with pytest.raises(ParseError, match="cam0: there is no Principal point"):
        read(IMUCAM.replace("  Principal point: [371.6, 238.3]\n", "", 1))
    with pytest.raises(ParseError, match="cam1: there is no alpha"):
        read(IMUCAM.replace("  DS alpha: 0.55\n", ""))
