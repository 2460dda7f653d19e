"""OKVIS's configuration, against OpenCV."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample

FILE = """%YAML:1.0
cameras:
     - {T_SC:
        [ 1.0, 0.0, 0.0, 0.1, 0.0, 1.0, 0.0, 0.2,
          0.0, 0.0, 1.0, 0.3, 0.0, 0.0, 0.0, 1.0],
        image_dimension: [752, 480],
        distortion_coefficients: [-0.2131, 0.0447, -0.00037, 8.1e-04],
        distortion_type: radialtangential,
        focal_length: [433.2, 432.9],
        principal_point: [371.6, 238.3]}

     - {T_SC:
        [ 1.0, 0.0, 0.0, 0.1, 0.0, 1.0, 0.0, 0.2,
          0.0, 0.0, 1.0, 0.3, 0.0, 0.0, 0.0, 1.0],
        image_dimension: [640, 512],
        distortion_coefficients: [-0.0292, 0.0208, -0.0319, 0.0166],
        distortion_type: equidistant,
        focal_length: [402.2, 402.9],
        principal_point: [321.6, 248.3]}

camera_params:
    camera_rate: 20
imu_params:
    a_max: 176.0
"""
SAMPLES = {"okvis": Sample(FILE.encode())}


def read(text: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="config.yaml")


def test_every_camera_is_read_in_order() -> None:
    first, second = read(FILE)
    assert_projects_as_opencv(first, (433.2, 432.9, 371.6, 238.3), (-0.2131, 0.0447, -0.00037, 0.00081))
    assert_projects_as_opencv(
        second, (402.2, 402.9, 321.6, 248.3), (-0.0292, 0.0208, -0.0319, 0.0166), fisheye=True
    )
    assert [item.camera.sub_camera for item in (first, second)] == ["cam0", "cam1"]
    assert second.intrinsics.image_size == (640, 512)


@pytest.mark.parametrize("name", ["radialtangential8", "plumb_bob8"])
def test_eight_are_opencvs_rational_model(name: str) -> None:
    eight = "-0.2, 0.04, -0.0003, 0.0008, 0.01, 0.02, 0.003, 0.001"
    text = FILE.replace("radialtangential", name).replace("-0.2131, 0.0447, -0.00037, 8.1e-04", eight)
    assert_projects_as_opencv(
        read(text)[0], (433.2, 432.9, 371.6, 238.3), [float(k) for k in eight.split(",")]
    )


@pytest.mark.parametrize(
    ("old", "new", "kind", "match"),
    [
        ("radialtangential", "eucm", UnsupportedModelError, "eucm"),
        ("8.1e-04]", "8.1e-04, 0.1]", ParseError, r"cameras\[0\].*5 numbers, expected 4"),
        ("[752, 480]", "[752]", ParseError, "1 numbers"),
        ("433.2", "-433.2", ParseError, "focal"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: str, new: str, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        read(FILE.replace(old, new))


def test_cameras_without_number_are_refused() -> None:
    with pytest.raises(ParseError, match="over 1000 cameras, the most"):
        parsers.decode(("cameras: [" + "{}," * 1001 + "]\n").encode(), name="x", format="okvis")
