"""KITTI's files, against OpenCV, with which the raw recordings were calibrated."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.errors import InputError, MissingTagError, ParseError, UnknownFormatError
from tests.parsers.samples import Sample

RAW = """calib_time: 09-Jan-2021 13:57:47
corner_dist: 9.950000e-02
S_00: 1.392000e+03 5.120000e+02
K_00: 9.742e+02 0.000000e+00 6.914e+02 0.0 9.708e+02 2.347e+02 0.0 0.0 1.0
D_00: -3.628e-01 1.937e-01 2.1e-03 1.4e-03 -7.2e-02
R_00: 1 0 0 0 1 0 0 0 1
T_00: 0 0 0
S_rect_00: 1.242000e+03 3.750000e+02
R_rect_00: 1 0 0 0 1 0 0 0 1
P_rect_00: 7.115e+02 0 6.085e+02 4.5e+01 0 7.115e+02 1.718e+02 -0.3 0 0 1 0.003
S_01: 1.392000e+03 5.120000e+02
K_01: 9.8e+02 0 7.02e+02 0 9.79e+02 2.45e+02 0 0 1
D_01: 0 0 0 0 0
R_01: 1 0 0 0 1 0 0 0 1
"""
BENCHMARK = """P0: 711.5 0 608.5 0 0 711.5 171.8 0 0 0 1 0
P1: 711.5 0 608.5 -386.1 0 711.5 171.8 0 0 0 1 0
R0_rect: 1 0 0 0 1 0 0 0 1
Tr_velo_to_cam: 0 -1 0 0 0 0 -1 0 1 0 0 0

"""


def read(text: str, size: tuple[int, int] | None = None, **options: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="calib_cam_to_cam.txt", image_size=size, options=options)


SAMPLES = {"kitti": Sample(RAW.encode())}


def test_the_raw_cameras_project_as_opencv() -> None:
    first, second = read(RAW)
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 25), np.linspace(-0.2, 0.2, 25))
    rays = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])
    K = np.array([[974.2, 0, 691.4], [0, 970.8, 234.7], [0, 0, 1]])
    D = np.array([-0.3628, 0.1937, 0.0021, 0.0014, -0.072])
    expected = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(first.project(rays) - 0.5, expected, rtol=0, atol=1e-9)
    assert isinstance(first.distortion, BrownConrady)
    assert second.distortion == NoDistortion()
    assert [item.camera.sub_camera for item in (first, second)] == ["00", "01"]
    assert first.intrinsics.image_size == (1392, 512)
    assert "rectified" in first.notes[1]


def test_the_rectified_cameras_are_there_for_the_asking() -> None:
    only_first = RAW.partition("S_01")[0]
    [camera] = read(only_first, images="rectified")
    K = camera.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy, K.image_size) == (711.5, 711.5, 609.0, 172.3, (1242, 375))
    assert camera.distortion == NoDistortion()
    with pytest.raises(ParseError, match="P_rect_01"):
        read(RAW, images="rectified")


def test_the_benchmarks_projections_need_the_size() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        read(BENCHMARK)
    cameras = read(BENCHMARK, size=(1242, 375))
    assert [item.camera.sub_camera for item in cameras] == ["0", "1"]
    assert {(item.intrinsics.fx, item.intrinsics.cx) for item in cameras} == {(711.5, 609.0)}
    assert "does not document" in cameras[0].notes[0]
    with pytest.raises(InputError, match="calib_cam_to_cam"):
        read(BENCHMARK, size=(1242, 375), images="raw")


def test_a_file_of_transforms_alone_is_not_claimed() -> None:
    with pytest.raises(UnknownFormatError):
        read("calib_time: 1\nR: 1 0 0 0 1 0 0 0 1\nT: 0 0 0\n")


def test_a_missing_end_of_line_matters_only_where_numbers_are_read() -> None:
    assert len(read(RAW.rstrip("\n"))) == 2
    with pytest.raises(ParseError, match="not ended"):
        read(RAW.partition("\nR_01")[0])


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("9.742e+02", "9,742e+02", "decimal point"),
        ("-7.2e-02", "", "4 numbers, expected 5"),
        ("S_00: 1.392000e+03", "S_00: 1392.5", "image size"),
        (
            "K_00: 9.742e+02 0.000000e+00 6.914e+02 0.0",
            "K_00: 9.742e+02 0 6.914e+02 0.1",
            "not a camera matrix",
        ),
        ("K_01:", "K_00:", "K_00: it is a duplicate key"),
        ("T_00: 0 0 0", "nonsense", "line 7.*expected a key, ':'"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: str, new: str, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        read(RAW.replace(old, new, 1))
