"""Pix4D's list of the images' cameras, against m = K [R|-Rt] X."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.samples import Sample

HEADING = """\
fileName imageWidth imageHeight
camera matrix K [3x3]
radial distortion [3x1]
tangential distortion [2x1]
camera position t [3x1]
camera rotation R [3x3]
camera model m = K [R|-Rt] X

"""
IMAGE = """\
{name} 5472 3648
{f} 0.7 2741.29
0 3648.70 1815.88
0 0 1
-0.0113 0.0247 -0.0062
-0.00037 0.00081
21.5 -29.5 30.8
1 0 0
0 1 0
0 0 1
"""


def image(name: str = "DJI_0001.JPG", f: str = "3650.1") -> str:
    return IMAGE.format(name=name, f=f)


def read(text: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="p_calibrated_camera_parameters.txt")


SAMPLES = {"pix4d_camera_parameters": Sample((HEADING + image()).encode())}


def test_a_camera_projects_by_k_in_pixels_from_the_corner() -> None:
    [calibration] = read(HEADING + image())
    u, v = np.meshgrid(np.linspace(-0.7, 0.7, 15), np.linspace(-0.48, 0.48, 15))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    D = np.array([-0.0113, 0.0247, -0.00037, 0.00081, -0.0062])
    observed = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), D)[0].reshape(-1, 2)
    K = np.array([[3650.1, 0.7, 2741.29], [0, 3648.7, 1815.88]])
    np.testing.assert_allclose(calibration.project(rays), observed @ K[:, :2].T + K[:, 2], rtol=0, atol=1e-9)
    assert calibration.grade is Grade.ADJUSTED


def test_images_that_share_a_camera_give_it_once() -> None:
    [calibration] = read(HEADING + image("a.jpg") + image("b.jpg") + "\n" + image("c d.jpg"))
    assert calibration.camera.sub_camera is None
    assert calibration.provenance.tag == "a.jpg"
    assert calibration.quality is not None
    assert calibration.quality.views == 3


def test_different_cameras_come_in_order_by_the_name_of_their_first_image() -> None:
    both = read(HEADING + image("wide 1.jpg") + image("tele 1.jpg", "9000") + image("wide 2.jpg"))
    assert [item.camera.sub_camera for item in both] == ["wide 1.jpg", "tele 1.jpg"]
    assert [item.intrinsics.fx for item in both] == [3650.1, 9000.0]


def test_zeros_are_no_distortion() -> None:
    plain = image().replace("-0.0113 0.0247 -0.0062", "0 0 0").replace("-0.00037 0.00081", "0 0")
    assert read(HEADING + plain)[0].distortion == NoDistortion()


def test_another_heading_is_refused() -> None:
    with pytest.raises(UnsupportedModelError, match="fisheye"):
        read(HEADING.replace("radial distortion [3x1]", "fisheye polynomial [4x1]") + image())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEADING, "no image"),
        (HEADING + image().rsplit("\n", 2)[0] + "\n", "line 9: 9 lines of an image, expected 10"),
        (HEADING + image().replace("0 0 1\n-", "0 0 2\n-"), "not a camera matrix"),
        (HEADING + image().replace("0 3648.70", "1 3648.70"), "not a camera matrix"),
        (HEADING + image().replace("-0.0062", ""), "line 13: 2 numbers, expected 3"),
        (HEADING + image().replace("5472 3648", "5472"), "not a file name"),
        (HEADING + image(f="-3"), "focal lengths"),
        (HEADING + image(f="inf"), "not finite"),
    ],
)
def test_a_broken_file_names_what_is_wrong(text: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(text)
