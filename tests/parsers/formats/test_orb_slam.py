"""ORB-SLAM's settings, against OpenCV, which ORB-SLAM itself undistorts with."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion
from calibrary.errors import MissingTagError, ParseError, UnsupportedModelError
from tests.parsers.samples import Sample

OLD = """%YAML:1.0

#----------
Camera.fx: 433.2
Camera.fy: 432.9
Camera.cx: 371.6
Camera.cy: 238.3

Camera.k1: -0.2131
Camera.k2: 4.47e-02
Camera.p1: -0.00037
Camera.p2: 0.00081
Camera.k3: -0.0172

Camera.width: 752
Camera.height: 480
Camera.fps: 30.0
Camera.RGB: 1
Viewer.PointSize:2
"""
NEW = """%YAML:1.0
File.version: "1.0"
Camera.type: "KannalaBrandt8"
Camera1.fx: 190.9
Camera1.fy: 190.8
Camera1.cx: 254.9
Camera1.cy: 256.9
Camera1.k1: 0.0034
Camera1.k2: 0.0007
Camera1.k3: -0.0020
Camera1.k4: 0.0002
Camera2.fx: 190.4
Camera2.fy: 190.4
Camera2.cx: 252.5
Camera2.cy: 254.9
Camera2.k1: 0.0034
Camera2.k2: 0.0017
Camera2.k3: -0.0026
Camera2.k4: 0.0004
Stereo.T_c1_c2: !!opencv-matrix
  rows: 1
  cols: 2
  dt: f
  data: [1.0, 2.0]
Camera.width: 512
Camera.height: 512
Camera.newWidth: 256
"""
SIDES = """LEFT.height: 480
LEFT.width: 752
LEFT.D: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data:[-0.2834, 0.0739, 0.0002, 1.76e-05, 0.0]
LEFT.K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [458.6, 0.0, 367.2, 0.0, 457.3, 248.4, 0.0, 0.0, 1.0]
"""


def read(text: str, size: tuple[int, int] | None = None) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="EuRoC.yaml", image_size=size)


def rays() -> NDArray[np.float64]:
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 25), np.linspace(-0.6, 0.6, 25))
    return np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])


SAMPLES = {"orb_slam": Sample(OLD.encode())}


def test_a_pinhole_projects_as_opencv() -> None:
    [calibration] = read(OLD)
    K = np.array([[433.2, 0, 371.6], [0, 432.9, 238.3], [0, 0, 1]])
    D = np.array([-0.2131, 0.0447, -0.00037, 0.00081, -0.0172])
    expected = cv2.projectPoints(rays(), np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(calibration.project(rays()) - 0.5, expected, rtol=0, atol=1e-9)
    assert calibration.intrinsics.image_size == (752, 480)


def test_the_newer_keys_hold_two_fisheyes() -> None:
    first, second = read(NEW)
    K = np.array([[190.9, 0, 254.9], [0, 190.8, 256.9], [0, 0, 1]])
    D = np.array([0.0034, 0.0007, -0.0020, 0.0002])
    points = rays().reshape(-1, 1, 3)
    expected = cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(first.project(rays()) - 0.5, expected, rtol=0, atol=1e-9)
    assert [item.camera.sub_camera for item in (first, second)] == ["Camera1", "Camera2"]
    assert isinstance(second.distortion, KannalaBrandt)
    assert "size before" in first.notes[0]


def test_older_settings_may_lack_the_size_and_k3() -> None:
    text = OLD.replace("Camera.width: 752\nCamera.height: 480\n", "").replace("Camera.k3: -0.0172\n", "")
    with pytest.raises(MissingTagError, match="--image-size"):
        read(text)
    [calibration] = read(text, (752, 480))
    assert calibration.distortion == BrownConrady(k1=-0.2131, k2=0.0447, p1=-0.00037, p2=0.00081)


def test_the_raw_cameras_of_older_stereo_settings_follow_the_rectified_one() -> None:
    rectified, left = read(OLD + SIDES)
    assert [item.camera.sub_camera for item in (rectified, left)] == ["Camera", "LEFT"]
    assert left.intrinsics.fx == 458.6
    assert left.intrinsics.cx == 367.2 + 0.5
    assert left.distortion == BrownConrady(k1=-0.2834, k2=0.0739, p1=0.0002, p2=1.76e-05)
    assert "rectified camera" in rectified.notes[0]


def test_rectified_images_have_no_distortion() -> None:
    for text in (
        OLD + 'Camera.type: "Rectified"\n',
        "".join(row + "\n" for row in OLD.splitlines() if not row.startswith(("Camera.k", "Camera.p"))),
    ):
        assert read(text)[0].distortion == NoDistortion()


def test_a_key_that_says_the_same_again_is_no_contradiction() -> None:
    [line] = [line for line in OLD.splitlines() if line.startswith("Camera.fx:")]
    assert read(f"{OLD}{line}   # as above\n")[0].intrinsics == read(OLD)[0].intrinsics


def test_another_model_is_refused_by_name() -> None:
    with pytest.raises(UnsupportedModelError, match="Fisheye624"):
        read(OLD + 'Camera.type: "Fisheye624"\n')


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (OLD.replace("Camera.cy: 238.3\n", ""), "Camera: there is no 'cy'"),
        (OLD.replace("Camera.k2: 4.47e-02\n", ""), "Camera: there is no 'k2'"),
        (OLD.replace("433.2", "433,2"), "decimal point"),
        (OLD + "Camera.fx: 1\n", "duplicate key"),
        (NEW.replace("Camera2.k4: 0.0004\n", ""), "Camera2: there is no 'k4'"),
        (OLD + SIDES.replace("457.3", "0.0"), "focal"),
        (OLD + SIDES.replace("cols: 5", "cols: 4"), "header"),
    ],
)
def test_a_broken_file_names_what_is_wrong(text: str, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        read(text)
