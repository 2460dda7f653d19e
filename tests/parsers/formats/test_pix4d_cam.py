"""Pix4D's .cam, against its own words: millimetres on a sensor of the size it assumes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.errors import FrameError, MissingTagError, ParseError, UnsupportedModelError
from calibrary.records import replace
from tests.parsers.cameras import SIZE, camera

CAM = """\
Pix4D camera calibration file 0
#Focal Length mm assuming a sensor width of 13.13280000000000030667x8.75520000000000031548mm
F 8.76023999999999957999
#Principal Point mm
Px 6.57910000000000038980
Py 4.35810000000000030695
#Symmetrical Lens Distortion Coeffs
K1 -0.0113
K2 0.0247
K3 -0.0062
#Tangential Lens Distortion Coeffs
T1 -0.00037
T2 0.00081
"""


def read(text: str, image_size: tuple[int, int] = SIZE) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="p_calib.cam", image_size=image_size)
    return calibration


def test_millimetres_become_pixels_of_the_sensor_that_the_file_assumes() -> None:
    K = read(CAM).intrinsics
    pitch_mm = 13.1328 / 5472
    assert K.fx == K.fy == pytest.approx(8.76024 / pitch_mm, rel=1e-15)
    assert (K.cx, K.cy) == pytest.approx((6.5791 / pitch_mm, 4.3581 / pitch_mm), rel=1e-14)


def test_a_camera_projects_as_opencv_does_with_t1_and_t2_as_p1_and_p2() -> None:
    calibration = read(CAM)
    u, v = np.meshgrid(np.linspace(-0.7, 0.7, 15), np.linspace(-0.48, 0.48, 15))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    D = np.array([-0.0113, 0.0247, -0.00037, 0.00081, -0.0062])
    observed = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), D)[0].reshape(-1, 2)
    mm = 8.76024 * observed + [6.5791, 4.3581]
    np.testing.assert_allclose(calibration.project(rays), mm / (13.1328 / 5472), rtol=0, atol=1e-9)


def test_it_comes_from_a_bundle_adjustment() -> None:
    assert read(CAM).grade is Grade.ADJUSTED


def test_the_older_name_and_line_ends_are_taken() -> None:
    assert read(CAM.replace("Pix4D", "Pix4UAV").replace("\n", "\r\n")).intrinsics == read(CAM).intrinsics


def test_coefficients_that_are_all_zero_are_no_distortion() -> None:
    zeros = "".join(f"{row.split()[0]} 0\n" if row[0] in "KT" else f"{row}\n" for row in CAM.splitlines())
    assert read(zeros).distortion == NoDistortion()


def test_the_image_size_is_asked_for() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(CAM.encode(), name="p.cam")


def test_a_size_of_another_shape_than_the_sensor_is_refused() -> None:
    with pytest.raises(FrameError, match="not square"):
        read(CAM, image_size=(5472, 3078))


@pytest.mark.parametrize(
    ("was", "is_now", "message"),
    [
        ("F 8.76023999999999957999\n", "", "there is no F"),
        ("T2 0.00081\n", "", "there is no T2"),
        ("K1 -0.0113", "K1 -0,0113", "decimal point"),
        ("K1 -0.0113", "K1", "not a number"),
        ("K2 0.0247", "K1 0.0247", "line 9: K1 is a duplicate key"),
        ("F 8.7", "F -8.7", "focal lengths"),
        (" assuming a sensor width", "", "assuming a sensor width"),
        ("x8.7552", "x0.0 8.7552", "assuming a sensor width"),
        ("13.13280000000000030667", "0", "expected positive"),
        ("T2 0.00081\n", "T2 0.00081", "cut short"),
    ],
)
def test_a_broken_file_names_what_is_wrong(was: str, is_now: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(CAM.replace(was, is_now))


def test_a_fisheyes_file_is_refused_with_the_way_out() -> None:
    with pytest.raises(UnsupportedModelError, match="OPF"):
        read(CAM + "P0 0\nP1 1\n")


def test_the_sensor_survives_and_is_taken_from_the_focal_length_otherwise() -> None:
    data, verdict = parsers.encode([read(CAM)], "pix4d_cam")
    assert verdict.dropped == ()
    assert read(data.decode()).extras == read(CAM).extras
    K = replace(camera().intrinsics, fy=3650.1)
    known = replace(camera(), intrinsics=K, camera=CameraKey(image_size=SIZE, focal_mm=8.8))
    focal = parsers.encode([known], "pix4d_cam")[0].decode().splitlines()[3]
    assert float(focal.removeprefix("F ")) == pytest.approx(8.8, rel=1e-15)


def test_pix4d_reads_its_own_terms() -> None:
    brown = BrownConrady(k1=-0.1, k2=0.02, p1=3e-4, p2=-7e-4, k3=0.001)
    K = replace(camera().intrinsics, fy=3650.1)
    data, _ = parsers.encode([replace(camera(brown), intrinsics=K)], "pix4d_cam")
    rows = data.decode().splitlines()
    assert [row.split()[0] for row in rows if not row.startswith("#")] == [
        "Pix4D", "F", "Px", "Py", "K1", "K2", "K3", "T1", "T2"
    ]  # fmt: skip
    assert rows[-2:] == ["T1 0.0003", "T2 -0.0007"]


def test_what_is_written_states_its_image_size_in_a_comment() -> None:
    data, verdict = parsers.encode([read(CAM)], "pix4d_cam")
    assert parsers.decode(data, name="camera.cam")[0].intrinsics.image_size == read(CAM).intrinsics.image_size
    assert "image size" not in verdict.dropped
