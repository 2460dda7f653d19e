"""vikit's cameras, against OpenCV and vikit's own formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import FieldOfView, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample

FILE = """cam_model: Pinhole
cam_d0: -0.0931
cam_d1: 0.0947
cam_d2: -0.0080
cam_d3: 8.1e-05 # the last
cam_fx: 431.2
cam_fy: 431.5
cam_cx: 310.8
cam_cy: 266.9
cam_height: 512
cam_width: 640
"""
RIG = """cam_num: 1
img_topic_0: /camera/rgb
cam_0:
  cam_model: FishPoly
  image_width: 1600  # 1920
  image_height: 1296
  k2: -1.2e-03
  k3: -2.9e-02
  k4: 5.4e-03
  A11: 734.5
  A12: -0.19
  A22: 734.3
  u0: 849.3
  v0: 629.1
"""
OPENCV = (431.2, 431.5, 310.8, 266.9)
SAMPLES = {"vikit": Sample(FILE.encode())}


def read(text: str) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="camera.yaml")
    return calibration


def test_pinhole_has_opencvs_first_four() -> None:
    assert_projects_as_opencv(read(FILE), OPENCV, (-0.0931, 0.0947, -0.0080, 0.000081))


@pytest.mark.parametrize(
    ("model", "fisheye"), [("PinholeRadialTangential", False), ("PinholeEquidistant", True)]
)
def test_svo_pro_has_its_cameras_below_their_names(model: str, fisheye: bool) -> None:
    body = "".join(f"  {line}\n" for line in FILE.replace("Pinhole", model).splitlines())
    item = read(f"cam0:\n{body}")
    assert_projects_as_opencv(item, OPENCV, (-0.0931, 0.0947, -0.0080, 0.000081), fisheye=fisheye)
    assert item.intrinsics.image_size == (640, 512)


def test_equidistant_is_opencvs_fisheye() -> None:
    text = FILE.replace("Pinhole", "EquidistantCamera")
    for index in range(4):
        text = text.replace(f"cam_d{index}", f"k{index + 1}")
    assert_projects_as_opencv(read(text), OPENCV, (-0.0931, 0.0947, -0.0080, 0.000081), fisheye=True)


def test_a_coefficient_left_out_is_zero() -> None:
    text = "".join(line + "\n" for line in FILE.splitlines() if not line.startswith("cam_d"))
    assert read(text).distortion == NoDistortion()


def test_atan_counts_in_fractions_from_the_corner() -> None:
    text = FILE.replace("Pinhole", "ATAN").replace("-0.0931", "0.93")
    for old, new in (("431.2", "0.67"), ("431.5", "0.84"), ("310.8", "0.49"), ("266.9", "0.52")):
        text = text.replace(old, new)
    item = read(text)
    assert item.distortion == FieldOfView(omega=0.93)
    K = item.intrinsics
    # vikit: cx_ = cx·width − 0.5 from the pixel's centre, which is cx·width from its corner.
    assert (K.fx, K.fy, K.cx, K.cy) == pytest.approx((0.67 * 640, 0.84 * 512, 0.49 * 640, 0.52 * 512))


def test_a_polynomial_projects_as_vikit_does() -> None:
    X, Y, Z = 0.4, -0.3, 0.7
    theta = math.acos(Z / math.hypot(X, Y, Z))
    scale = theta * (1 - 1.2e-3 * theta - 2.9e-2 * theta**2 + 5.4e-3 * theta**3) / math.hypot(X, Y)
    u, v = read(RIG).project(np.array([[X, Y, Z]]))[0]
    assert u == pytest.approx(734.5 * X * scale - 0.19 * Y * scale + 849.3 + 0.5, abs=1e-9)
    assert v == pytest.approx(734.3 * Y * scale + 629.1 + 0.5, abs=1e-9)


def test_higher_powers_are_refused_with_a_way_out() -> None:
    with pytest.raises(UnsupportedModelError, match="EquidistantCamera"):
        read(RIG + "  k5: 0.01\n")
    with pytest.raises(UnsupportedModelError, match="Ocam"):
        read(FILE.replace("Pinhole", "Ocam"))


def test_the_scale_leaves_k_alone_and_is_told() -> None:
    item = read(FILE + "scale: 0.5\n")
    assert item.intrinsics == read(FILE).intrinsics
    assert "shrinks the images by the file's scale, 0.5" in item.notes[0]


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (FILE.replace("cam_cx: 310.8\n", ""), "cam_cx"),
        (FILE.replace("-0.0931", "true"), "yes or no"),
        (RIG.replace("cam_num: 1", "cam_num: 2"), "cam_1"),
        (RIG.replace("cam_num: 1", "cam_num: 999999999"), "expected 1 to 1000"),
        (RIG.replace("  A12: -0.19\n", ""), "cam_skew"),
    ],
)
def test_a_broken_file_names_what_is_wrong(text: str, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        read(text)
