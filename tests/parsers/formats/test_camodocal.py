"""camodocal's cameras, against OpenCV where it has the model and against Mei's formula where not."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.samples import Sample

HEAD = "%YAML:1.0\n---\nmodel_type: {model}\ncamera_name: front\nimage_width: 752\nimage_height: 480\n"
PINHOLE = HEAD.format(model="PINHOLE") + (
    "distortion_parameters:\n   k1: -2.131e-01\n   k2: 0.0447\n   p1: -0.00037\n   p2: 8.1e-04\n"
    "projection_parameters:\n   fx: 4.332e+02\n   fy: 432.9\n   cx: 371.6\n   cy: 238.3\n"
)
FULL = PINHOLE.replace("PINHOLE", "pinhole_full").replace(
    "projection", "   k3: -0.0172\n   k4: 0.0083\n   k5: -0.0061\n   k6: 0.0042\nprojection"
)
FISHEYE = HEAD.format(model="KANNALA_BRANDT") + (
    "projection_parameters:\n   k2: -0.0292\n   k3: 0.0208\n   k4: -0.0319\n   k5: 0.0166\n"
    "   mu: 433.2\n   mv: 432.9\n   u0: 371.6\n   v0: 238.3\n"
)
MEI = HEAD.format(model="MEI") + (
    "mirror_parameters:\n   xi: 1.12\ndistortion_parameters:\n   k1: -0.1524\n   k2: 0.0421\n   p1: 0.0004\n"
    "   p2: 0.001\nprojection_parameters:\n   gamma1: 433.2\n   gamma2: 432.9\n   u0: 371.6\n   v0: 238.3\n"
)
K = np.array([[433.2, 0, 371.6], [0, 432.9, 238.3], [0, 0, 1]])
D8 = (-0.2131, 0.0447, -0.00037, 0.00081, -0.0172, 0.0083, -0.0061, 0.0042)


def read(text: str) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="cam0.yaml")
    return calibration


def rays() -> NDArray[np.float64]:
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 25), np.linspace(-0.6, 0.6, 25))
    return np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])


SAMPLES = {"camodocal": Sample(PINHOLE.encode())}


@pytest.mark.parametrize(("text", "count"), [(PINHOLE, 4), (FULL, 8)], ids=["PINHOLE", "PINHOLE_FULL"])
def test_a_pinhole_projects_as_opencv(text: str, count: int) -> None:
    D = np.array(D8[:count])
    expected = cv2.projectPoints(rays(), np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(read(text).project(rays()) - 0.5, expected, rtol=0, atol=1e-9)


def test_kannala_brandt_counts_its_coefficients_from_two() -> None:
    D = np.array([-0.0292, 0.0208, -0.0319, 0.0166])
    points = rays().reshape(-1, 1, 3)
    expected = cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(read(FISHEYE).project(rays()) - 0.5, expected, rtol=0, atol=1e-9)


def test_mei_projects_through_the_mirror_and_then_the_plane() -> None:
    P = np.vstack([rays(), [[1.0, 0.2, -0.1], [0.0, -1.0, 0.0]]])
    x, y = (P[:, :2] / (P[:, 2:] + 1.12 * np.linalg.norm(P, axis=1, keepdims=True))).T
    r2 = x * x + y * y
    radial = 1 - 0.1524 * r2 + 0.0421 * r2 * r2
    xd = x * radial + 2 * 0.0004 * x * y + 0.001 * (r2 + 2 * x * x)
    yd = y * radial + 0.0004 * (r2 + 2 * y * y) + 2 * 0.001 * x * y
    expected = np.stack([433.2 * xd + 371.6, 432.9 * yd + 238.3], axis=1)
    calibration = read(MEI)
    np.testing.assert_allclose(calibration.project(P) - 0.5, expected, rtol=0, atol=1e-9)
    assert "gamma1/(1 + xi)" in calibration.notes[0]


def test_zeros_are_no_distortion() -> None:
    text = PINHOLE
    for value in ("-2.131e-01", "0.0447", "-0.00037", "8.1e-04"):
        text = text.replace(f": {value}", ": 0")
    assert read(text).distortion == NoDistortion()


def test_a_configuration_of_vins_that_holds_a_camera_is_one() -> None:
    matrix = "!!opencv-matrix\n   rows: 1\n   cols: 1\n   dt: d\n   data: [1.]\n"
    settings = f'\nimu_topic: "/imu0"\nextrinsicRotation: {matrix}'
    assert read(PINHOLE + settings).intrinsics == read(PINHOLE).intrinsics


def test_a_configuration_of_vins_that_names_its_cameras_is_all_of_them(tmp_path: Path) -> None:
    (tmp_path / "left.yaml").write_text(PINHOLE)
    (tmp_path / "right.yaml").write_text(MEI)
    config = tmp_path / "config.yaml"
    config.write_text('%YAML:1.0\nnum_of_cam: 2\ncam0_calib: "left.yaml"\ncam1_calib: "right.yaml"\n')
    cameras = parsers.read(config)
    assert [(item.camera.sub_camera, item.provenance.tag) for item in cameras] == [
        ("cam0", "left.yaml"),
        ("cam1", "right.yaml"),
    ]
    assert [item.distortion for item in cameras] == [read(PINHOLE).distortion, read(MEI).distortion]
    (tmp_path / "right.yaml").unlink()
    with pytest.raises(ParseError, match=r"right\.yaml.*not beside it"):
        parsers.read(config)


def test_scaramuzza_is_refused_by_name_with_the_way_out() -> None:
    text = HEAD.format(model="SCARAMUZZA") + "poly_parameters:\n   p0: -200.0\n"
    with pytest.raises(UnsupportedModelError, match=r"SCARAMUZZA.*KANNALA_BRANDT"):
        read(text)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (PINHOLE.replace("   k2: 0.0447\n", ""), "distortion_parameters: there is no 'k2'"),
        (PINHOLE.replace("image_width: 752\n", ""), "image_width"),
        (PINHOLE.replace("4.332e+02", "0"), "focal"),
        (PINHOLE.replace("432.9", ".nan"), "finite"),
        (MEI.replace("1.12", "-1"), "xi"),
        ("%YAML:1.0\ncam0_calib: 3\n", "expected text"),
    ],
)
def test_a_broken_file_names_what_is_wrong(text: str, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        read(text)


def test_a_last_number_without_its_end_of_line_may_be_cut_short() -> None:
    assert read(PINHOLE[:-1] + " # px").intrinsics.cy == 238.8
    with pytest.raises(ParseError, match=r"not ended.*'238.3'"):
        read(PINHOLE[:-1])
    assert read(PINHOLE[:-1] + "e+00").intrinsics.cy == 238.8  # two digits, and no third behind a 0
