"""maplab's rigs, against OpenCV and the formulas of aslam_cv2."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import FieldOfView, NoDistortion, Unified
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample

FILE = """label: "our rig"
id: 412eab8e4058621f7036b5e765dfe812
cameras:
- camera:
    label: cam0
    line-delay-nanoseconds: 0
    image_height: 480
    image_width: 752
    type: pinhole
    intrinsics:
      cols: 1
      rows: 4
      data: [433.2, 432.9, 371.6, 238.3]
    distortion:
      type: radial-tangential
      parameters:
        cols: 1
        rows: 4
        data: [-0.2131, 0.0447, -0.00037,
    8.1e-04]
  T_B_C:
    cols: 4
    rows: 4
    data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
"""
SENSORS = """sensors:
  - id: 5d2fcf479caf7592b35518478a2fe08f
    sensor_type: IMU
    sigmas:
      gyro_noise_density: 0.005
  - sensor_type: NCAMERA
    topic: ""
    cameras:
      - camera:
          sensor_type: CAMERA
          image_height: 480
          image_width: 752
          type: pinhole
          intrinsics:
            rows: 4
            cols: 1
            data:
              - 433.2
              - 432.9
              - 371.6
              - 238.3
          distortion:
            type: equidistant
            parameters:
              rows: 4
              cols: 1
              data: [-0.0292, 0.0208, -0.0319, 0.0166]
"""
OPENCV = (433.2, 432.9, 371.6, 238.3)
SAMPLES = {"maplab": Sample(FILE.encode())}


def read(text: str) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="ncamera.yaml")
    return calibration


def test_radial_tangential_is_opencvs_first_four() -> None:
    assert_projects_as_opencv(read(FILE), OPENCV, (-0.2131, 0.0447, -0.00037, 0.00081))
    assert read(FILE).intrinsics.image_size == (752, 480)


def test_a_rig_among_other_sensors_is_read() -> None:
    assert_projects_as_opencv(read(SENSORS), OPENCV, (-0.0292, 0.0208, -0.0319, 0.0166), fisheye=True)


def test_fisheye_is_the_field_of_view_model() -> None:
    text = SENSORS.replace("equidistant", "fisheye").replace(
        "rows: 4\n              cols", "rows: 1\n              cols"
    )
    assert read(text.replace("[-0.0292, 0.0208, -0.0319, 0.0166]", "[0.92]")).distortion == FieldOfView(
        omega=0.92
    )
    assert read(SENSORS.replace("equidistant", "none")).distortion == NoDistortion()


def test_a_unified_projection_has_xi_first() -> None:
    text = (
        FILE.replace("pinhole", "unified-projection")
        .replace("[433.2,", "[0.87, 433.2,")
        .replace("rows: 4\n      data", "rows: 5\n      data")
    )
    item = read(text)
    assert item.distortion == Unified(xi=0.87, k1=-0.2131, k2=0.0447, p1=-0.00037, p2=0.00081)
    assert item.intrinsics.fx == 433.2
    with pytest.raises(ParseError, match="above"):
        read(text.replace("0.87", "-1.5"))


@pytest.mark.parametrize(
    ("old", "new", "kind", "match"),
    [
        ("radial-tangential", "thin-prism", UnsupportedModelError, "thin-prism"),
        ("type: pinhole", "type: lidar-3d", UnsupportedModelError, "lidar-3d"),
        ("rows: 4\n      data: [433.2, ", "rows: 3\n      data: [", ParseError, "3 numbers"),
        ("    image_width: 752\n", "", ParseError, "image_width"),
        ("433.2", "-433.2", ParseError, "focal"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: str, new: str, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        read(FILE.replace(old, new))
