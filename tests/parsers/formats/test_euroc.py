"""EuRoC's sensor.yaml, against OpenCV, whose two lens models it has under other names."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError, UnknownFormatError, UnsupportedModelError
from tests.parsers.cameras import camera

FILE = """# General sensor definitions.
sensor_type: camera
comment: front, 5 mm
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.1, 0.0, 1.0, 0.0, 0.2,
         0.0, 0.0, 1.0, 0.3, 0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [433.2, 432.9, 371.6, 238.3] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.2131, 0.0447, -0.00037, 8.1e-04]
"""
EQUIDISTANT = FILE.replace("radial-tangential", "equidistant").replace(
    "-0.2131, 0.0447, -0.00037, 8.1e-04", "-0.0292, 0.0208, -0.0319, 0.0166"
)
K = np.array([[433.2, 0, 371.6], [0, 432.9, 238.3], [0, 0, 1]])


def read(text: str) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="sensor.yaml")
    return calibration


def rays() -> NDArray[np.float64]:
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 25), np.linspace(-0.6, 0.6, 25))
    return np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])


KIMERA = FILE.replace("sensor_type: camera\ncomment: front, 5 mm", "camera_id: left_cam").replace(
    "radial-tangential", "radtan"
)


def test_radial_tangential_is_opencvs_first_four() -> None:
    D = np.array([-0.2131, 0.0447, -0.00037, 0.00081])
    expected = cv2.projectPoints(rays(), np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(read(FILE).project(rays()) - 0.5, expected, rtol=0, atol=1e-9)
    assert read(FILE).intrinsics.image_size == (752, 480)


def test_kimeras_files_are_the_same_without_a_sensor_type() -> None:
    assert read(KIMERA).distortion == read(FILE).distortion
    assert read(KIMERA).intrinsics == read(FILE).intrinsics


OMNI = (
    KIMERA.replace("pinhole", "omni")
    .replace("[433.2, 432.9, 371.6, 238.3]", "[]")
    .replace(
        "distortion_model: radtan\ndistortion_coefficients: [-0.2131, 0.0447, -0.00037, 8.1e-04]\n",
        "distortion_model: omni\ndistortion_coefficients: [341.5, 0.0, -7.1e-04, -6.4e-08, 1.3e-10]\n"
        "omni_affine: [0.0021, -0.0013, 0.9987]\nomni_distortion_center: [371.25, 238.5]\n",
    )
)


def test_kimeras_omni_is_the_polynomial_of_its_back_projection() -> None:
    u, v = (grid.ravel() for grid in np.meshgrid(np.linspace(20, 730, 30), np.linspace(15, 465, 30)))
    x, y = np.linalg.inv([[1.0, 0.0021], [-0.0013, 0.9987]]) @ np.vstack([u - 371.25, v - 238.5])
    rho = np.hypot(x, y)
    expected = np.column_stack([x, y, 341.5 - 7.1e-4 * rho**2 - 6.4e-8 * rho**3 + 1.3e-10 * rho**4])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    camera = read(OMNI)
    rays = camera.unproject(np.column_stack([u, v]) + 0.5)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    # K has an upper triangle, so the frame is turned about its axis, by the angle that the note states.
    turn = np.arctan2(-0.0013, 0.9987)
    turned = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    np.testing.assert_allclose(rays, expected @ turned.T, rtol=0, atol=1e-12)
    assert "turned about its axis by -0.0746°" in camera.notes[0]


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("341.5, 0.0", "341.5, 0.2", "linear term"),
        ("341.5, 0.0", "-341.5, 0.0", "above zero"),
        ("0.9987]", "-0.9987]", "make no image"),
        ("omni_distortion_center", "centre", "omni_distortion_center"),
    ],
)
def test_an_omni_that_is_no_such_lens_is_refused(old: str, new: str, match: str) -> None:
    with pytest.raises((ParseError, UnsupportedModelError), match=match):
        read(OMNI.replace(old, new))


def test_what_is_written_has_eurocs_keys_and_keeps_the_pose() -> None:
    data, verdict = parsers.encode([camera(NoDistortion())], "euroc", name="sensor.yaml")
    assert "sensor_type: " in data.decode()
    assert "distortion_coefficients: [0.0, 0.0, 0.0, 0.0]\n" in data.decode()
    assert verdict.dropped == ()
    again, _ = parsers.encode([read(FILE)], "euroc", name="sensor.yaml")
    assert read(again.decode()).extras == read(FILE).extras
    assert "T_BS: " in again.decode()


def test_equidistant_is_opencvs_fisheye() -> None:
    D = np.array([-0.0292, 0.0208, -0.0319, 0.0166])
    points = rays().reshape(-1, 1, 3)
    expected = cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(read(EQUIDISTANT).project(rays()) - 0.5, expected, rtol=0, atol=1e-9)


def test_none_is_no_distortion() -> None:
    text = FILE.replace("radial-tangential", "none").replace("-0.2131, 0.0447, -0.00037, 8.1e-04", "")
    assert read(text).distortion == NoDistortion()


@pytest.mark.parametrize(("old", "new"), [("pinhole", "spherical"), ("radial-tangential", "fov")])
def test_another_model_is_refused_by_name(old: str, new: str) -> None:
    with pytest.raises(UnsupportedModelError, match=new):
        read(FILE.replace(old, new))


def test_a_sensor_that_is_no_camera_is_not_claimed() -> None:
    with pytest.raises(UnknownFormatError):
        read("sensor_type: imu\nrate_hz: 200\n")


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("resolution: [752, 480]\n", "", "resolution"),
        ("[752, 480]", "[752]", "1 numbers"),
        ("8.1e-04]", "8.1e-04, 0.1]", "5 numbers, expected 4"),
        ("433.2", "-433.2", "focal"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: str, new: str, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        read(FILE.replace(old, new))
