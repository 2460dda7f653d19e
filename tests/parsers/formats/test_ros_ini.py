"""ROS's INI, against OpenCV, to which ROS hands K and D as they stand."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion, Rational
from calibrary.errors import ParseError
from tests.parsers.cameras import BROWN, camera

IMAGE = """# oST version 5.0 parameters


[image]

# a comment
width
1920

; another
height
1200
"""
CAMERA = """
[{name}]

camera matrix
1733.2 0.000000 971.6
0.000000 1731.9 588.3
0.000000 0.000000 1.000000

distortion
{D}

rectification
1.000000 0.000000 0.000000
0.000000 1.000000 0.000000
0.000000 0.000000 1.000000

projection
1602.0 0.000000 975.5 -144.2
0.000000 1602.0 590.1 0.000000
0.000000 0.000000 1.000000 0.000000
"""
BROWN5 = "-0.1131 0.0247 -0.00037 0.00081 -0.0062"


def text(D: str = BROWN5, name: str = "narrow_stereo/left") -> str:
    return IMAGE + CAMERA.format(D=D, name=name)


def read(source: str, **options: str) -> Sequence[Calibration]:
    return parsers.decode(source.encode(), name="ost.txt", options=options)


PRINTED = """**** Calibrating ****
D = [-0.1131, 0.0247, -0.00037, 0.00081, -0.0062]
('K = ', [1733.2, 0.0, 971.6, 0.0, 1731.9, 588.3, 0.0, 0.0, 1.0])
P = [1602.0, 0.0, 975.5, 0.0, 0.0, 1602.0, 590.1, 0.0, 0.0, 0.0, 1.0, 0.0]
None
"""


def test_what_the_calibrator_prints_before_a_camera_may_be_pasted_along() -> None:
    left, right = read(PRINTED + text() + "Right:\n" + PRINTED + text(name="narrow_stereo/right"))
    assert left.intrinsics == right.intrinsics == read(text())[0].intrinsics
    assert [item.camera.sub_camera for item in (left, right)] == ["narrow_stereo/left", "narrow_stereo/right"]
    with pytest.raises(ParseError, match="expected one of"):
        read(text() + "\n[more]\nsome words\n")


@pytest.mark.parametrize(
    ("D", "model"), [(BROWN5, BrownConrady), (BROWN5 + " 0.0083 -0.0061 0.0042", Rational)]
)
def test_it_projects_as_opencv_does_with_the_same_vector(D: str, model: type) -> None:
    [calibration] = read(text(D))
    assert type(calibration.distortion) is model
    x, y = np.meshgrid(np.linspace(-0.55, 0.55, 25), np.linspace(-0.35, 0.35, 25))
    rays = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])
    matrix = np.array([[1733.2, 0, 971.6], [0, 1731.9, 588.3], [0, 0, 1]])
    vector = np.array(D.split(), dtype=float)
    expected = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, vector)[0].reshape(-1, 2)
    np.testing.assert_allclose(calibration.project(rays) - 0.5, expected, rtol=0, atol=1e-9)
    assert calibration.intrinsics.image_size == (1920, 1200)


def test_four_coefficients_are_asked_about() -> None:
    D = "0.0313 -0.0072 0.0041 -0.0011"
    with pytest.raises(ParseError, match="--set distortion"):
        read(text(D))
    assert read(text(D), distortion="brown")[0].distortion == BrownConrady(
        k1=0.0313, k2=-0.0072, p1=0.0041, p2=-0.0011
    )
    assert read(text(D), distortion="fisheye")[0].distortion == KannalaBrandt(
        k1=0.0313, k2=-0.0072, k3=0.0041, k4=-0.0011
    )
    assert read(text("0 0 0 0"))[0].distortion == NoDistortion()


def test_the_stereo_calibrators_two_cameras_are_both_read() -> None:
    both = read(text() + text("0 0 0 0 0", "narrow_stereo/right").replace("1920", "1600"))
    assert [item.camera.sub_camera for item in both] == ["narrow_stereo/left", "narrow_stereo/right"]
    assert [item.intrinsics.image_size for item in both] == [(1920, 1200), (1600, 1200)]
    assert both[1].distortion == NoDistortion()


def test_two_cameras_may_share_the_size_before_them() -> None:
    both = read(text() + CAMERA.format(D=BROWN5, name="right"))
    assert [item.intrinsics.image_size for item in both] == [(1920, 1200)] * 2


def test_a_missing_end_of_line_matters_only_where_numbers_could_be_missing() -> None:
    assert read(text().rstrip("\n"))[0].distortion == BROWN
    cut = text().partition("\n\nrectification")[0]
    with pytest.raises(ParseError, match="not ended"):
        read(cut)


def test_what_ros_reads_is_written_with_all_digits() -> None:
    data, verdict = parsers.encode([camera(BROWN)], "ros_ini")
    lines = data.decode().splitlines()
    assert lines[lines.index("width") + 1] == "5472"
    assert lines[lines.index("camera matrix") + 1] == f"3650.1 0.0 {2741.3 - 0.5!r}"
    assert lines[lines.index("distortion") + 1] == "-0.1131 0.0247 -0.00037 0.00081 -0.0062"
    assert lines[lines.index("projection") + 1].split()[3] == "0.0"
    assert verdict.dropped == ()


def test_a_rectification_goes_back_beside_its_own_k_only() -> None:
    externals = "[externals]\n\ntranslation\n1 2 3\n\nrotation\n0 0 0.1\n"
    [original] = read(IMAGE + externals + CAMERA.format(D=BROWN5, name="front"))
    data, verdict = parsers.encode([original], "ros_ini")
    assert "1602.0 0.0 975.5 -144.2" in data.decode()
    assert "[front]" in data.decode()
    assert "translation\n1.0 2.0 3.0\n" in data.decode()
    assert verdict.dropped == ()
    data, verdict = parsers.encode([original.scaled((960, 600))], "ros_ini")
    assert "1602.0" not in data.decode()
    assert "ros_ini/projection" in verdict.dropped


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("1733.2 0.000000 971.6\n", "1733.2 0.000000\n", "8 numbers, expected 9"),
        ("0.000000 1731.9", "0.5 1731.9", "not a camera matrix"),
        ("width\n1920\n", "", "no 'width'"),
        ("[image]", "[picture]", "no \\[image\\]"),
        (BROWN5, "", "0 numbers"),
        ("1733.2", "1733,2", "decimal point"),
        ("rectification\n", "distortion\n", "duplicate"),
        ("rectification\n", "R\n", "'R' is not a number"),
        ("[narrow_stereo/left]\n", "[narrow_stereo/left]\nabc\n", "expected one of"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: str, new: str, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        parsers.decode(text().replace(old, new).encode(), name="ost.txt", format="ros_ini")
