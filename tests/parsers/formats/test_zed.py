"""ZED's factory calibration, against OpenCV, whose models Stereolabs names."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, KannalaBrandt
from calibrary.errors import InputError, ParseError, UnknownFormatError
from tests.parsers.samples import Sample

OLD = """[LEFT_CAM_2K]
fx=1058.5
fy=1058.1
cx=1106.1
cy=640.0
k1=-0.0592
k2=0.0358
p1=-0.0003
p2=-8.9e-05
k3=-0.0145

[RIGHT_CAM_2K]
fx=1067.0
fy=1066.6
cx=1089.0
cy=647.8
k1=-0.0643
k2=0.0436

[LEFT_CAM_VGA]
fx=264.6
fy=264.5
cx=336.2
cy=193.1
k1=-0.0592
k2=0.0358

[STEREO]
BaseLine=120.14
RX_2K=0.0036"""
NEW = """[LEFT_CAM_FHD1200]
fx = 733.1
fy = 732.9
cx = 960.4
cy = 601.7

[LEFT_CAM_SVGA]
fx = 366.55
fy = 366.45
cx = 480.2
cy = 300.85

[LEFT_DISTO]
k1 = 0.31
k2 = 0.02
p1 = 0.0001
p2 = -0.0002
k3 = -0.001
k4 = 0.35
k5 = 0.03
k6 = -0.002
"""


def read(text: str, size: tuple[int, int] | None = None) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="SN1.conf", image_size=size)


def rays() -> NDArray[np.float64]:
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 25), np.linspace(-0.5, 0.5, 25))
    return np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])


SAMPLES = {"zed": Sample(NEW.encode())}


def test_every_resolution_of_both_sides_is_a_camera() -> None:
    cameras = read(OLD)
    assert [(item.camera.sub_camera, item.intrinsics.image_size) for item in cameras] == [
        ("LEFT_CAM_2K", (2208, 1242)),
        ("RIGHT_CAM_2K", (2208, 1242)),
        ("LEFT_CAM_VGA", (672, 376)),
    ]
    assert cameras[1].distortion == BrownConrady(k1=-0.0643, k2=0.0436, p1=0.0, p2=0.0)
    assert "raw images" in cameras[0].notes[0]


def test_a_size_selects_its_cameras() -> None:
    assert [item.camera.sub_camera for item in read(OLD, (672, 376))] == ["LEFT_CAM_VGA"]
    with pytest.raises(InputError, match="2208×1242, 672×376"):
        read(OLD, (1280, 720))


@pytest.mark.parametrize(
    ("text", "K", "D"),
    [
        (OLD, (1058.5, 1058.1, 1106.1, 640.0), (-0.0592, 0.0358, -0.0003, -8.9e-05, -0.0145)),
        (NEW, (733.1, 732.9, 960.4, 601.7), (0.31, 0.02, 0.0001, -0.0002, -0.001, 0.35, 0.03, -0.002)),
    ],
    ids=["in the section", "for all resolutions"],
)
def test_it_projects_as_opencv(text: str, K: tuple[float, ...], D: tuple[float, ...]) -> None:
    fx, fy, cx, cy = K
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    expected = cv2.projectPoints(rays(), np.zeros(3), np.zeros(3), matrix, np.array(D))[0].reshape(-1, 2)
    np.testing.assert_allclose(read(text)[0].project(rays()) - 0.5, expected, rtol=0, atol=1e-9)


def test_four_k_without_tangential_terms_are_a_fisheye() -> None:
    text = (
        NEW.partition("[LEFT_DISTO]")[0] + "[LEFT_DISTO]\nk1 = 0.03\nk2 = -0.007\nk3 = 0.004\nk4 = -0.001\n"
    )
    assert read(text)[0].distortion == KannalaBrandt(k1=0.03, k2=-0.007, k3=0.004, k4=-0.001)


def test_a_resolution_that_is_not_known_is_left_out_and_named() -> None:
    cameras = read(OLD.replace("LEFT_CAM_VGA", "LEFT_CAM_9K"))
    assert len(cameras) == 2
    assert "LEFT_CAM_9K" in cameras[0].notes[1]
    with pytest.raises(InputError, match="none that is known"):
        read("[LEFT_CAM_9K]\nfx=1\n")


def test_a_missing_end_of_line_matters_only_in_a_cameras_numbers() -> None:
    assert not OLD.endswith("\n")
    with pytest.raises(ParseError, match="not ended"):
        read(NEW.rstrip("\n"))


@pytest.mark.parametrize("text", [NEW.partition("p1 =")[0], OLD.partition("[LEFT_CAM_VGA]")[0]])
def test_coefficients_that_end_the_file_are_all_there(text: str) -> None:
    with pytest.raises(ParseError, match="may be cut short"):
        read(text)


def test_another_ini_is_not_claimed() -> None:
    with pytest.raises(UnknownFormatError):
        read("[STEREO]\nBaseline=120\n")


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("fy=1058.1\n", "", r"LEFT_CAM_2K: there is no 'fy'"),
        ("fy=1058.1", "fx=1058.1", "fx: it is a duplicate key"),
        ("[RIGHT_CAM_2K]", "[LEFT_CAM_2K]", "is a duplicate key"),
        ("fx=1058.5", "fx=1058,5", "decimal point"),
        ("fx=1058.5", "fx 1058.5", "expected a key, '=' and a value"),
        ("k1=-0.0643\n", "", "RIGHT_CAM_2K: there is no 'k1'"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: str, new: str, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        read(OLD.replace(old, new, 1))
