"""blue-c's .rad, against OpenCV's projection with the same K and coefficients."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.errors import MissingTagError, ParseError, UnsupportedModelError
from tests.parsers.cameras import camera

SIZE = (640, 480)
RAD = """\
K11 = 531.7
K12 = 0.0
K13 = 317.9
K21 = 0.0
K22 = 533.1
K23 = 241.3
K31 = 0.0
K32 = 0.0
K33 = 1.0

kc1 = -0.2811
kc2 = 0.0749
kc3 = 0.00041
kc4 = -0.00013

"""


def read(text: str) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="cam1.rad", image_size=SIZE)
    return calibration


def test_a_camera_projects_as_opencv_does() -> None:
    calibration = read(RAD)
    u, v = np.meshgrid(np.linspace(-0.6, 0.6, 15), np.linspace(-0.45, 0.45, 15))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    K = np.array([[531.7, 0, 317.9], [0, 533.1, 241.3], [0, 0, 1]])
    D = np.array([-0.2811, 0.0749, 0.00041, -0.00013])
    seen = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(calibration.project(rays), seen + 0.5, rtol=0, atol=1e-9)


def test_a_fifth_coefficient_is_k3() -> None:
    lens = read(RAD + "kc5 = -0.0062\n").distortion
    assert lens == BrownConrady(k1=-0.2811, k2=0.0749, p1=0.00041, p2=-0.00013, k3=-0.0062)


def test_alpha_c_is_the_skew_as_a_part_of_fx() -> None:
    calibration = read(RAD + "alpha_c = 0.001\n")
    assert calibration.intrinsics.skew == pytest.approx(0.5317, rel=1e-15)
    assert "skew" in calibration.notes[0]


def test_the_skew_in_k_is_kept() -> None:
    assert read(RAD.replace("K12 = 0.0", "K12 = 0.31")).intrinsics.skew == 0.31


def test_zeros_are_no_distortion() -> None:
    text = RAD.partition("kc1")[0] + "".join(f"kc{index} = 0\n" for index in (1, 2, 3, 4))
    assert read(text).distortion == NoDistortion()


def test_the_image_size_is_asked_for() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(RAD.encode(), name="cam1.rad")


@pytest.mark.parametrize(
    ("was", "is_now", "error", "message"),
    [
        ("kc4 = -0.00013\n", "", ParseError, "no 'kc4'"),
        ("K23 = 241.3", "K13 = 241.3", ParseError, "K13: it is a duplicate key"),
        ("K21 = 0.0", "K21 = 0.1", ParseError, "not a camera matrix"),
        ("K33 = 1.0", "K33 = 2.0", ParseError, "not a camera matrix"),
        ("531.7", "531,7", ParseError, "decimal point"),
        ("531.7", "-531.7", ParseError, "focal lengths"),
        ("K33 = 1.0\n", "K33 = 1.0\nK34 = 1.0\n", ParseError, "none of K11"),
        ("-0.00013\n\n", "-0.0001", ParseError, "not ended"),
        ("K12 = 0.0", "K12 = 0.3\nalpha_c = 0.1", ParseError, "same skew"),
        ("kc1", "kc6 = 0.1\nkc1", UnsupportedModelError, "five"),
    ],
)
def test_a_broken_file_names_what_is_wrong(
    was: str, is_now: str, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        read(RAD.replace(was, is_now))


def test_it_is_written_line_by_line_where_the_programs_look() -> None:
    lens = BrownConrady(k1=-0.1131, k2=0.0247, p1=-0.00037, p2=0.00081)
    data, verdict = parsers.encode([camera(lens)], "bluec_rad")
    rows = data.decode().split("\n")
    K = np.array([float(row[6:]) for row in rows[:9]]).reshape(3, 3)
    np.testing.assert_array_equal(K, [[3650.1, 0, 2741.3 - 0.5], [0, 3648.7, 1815.9 - 0.5], [0, 0, 1]])
    assert rows[9] == ""
    assert [float(row[6:]) for row in rows[10:14]] == [-0.1131, 0.0247, -0.00037, 0.00081]
    assert str(verdict) == "exact (0.000 px); dropped: image size"


def test_k3_is_refitted_or_refused_but_never_dropped() -> None:
    with pytest.raises(UnsupportedModelError, match="--max-error-px"):
        parsers.encode([camera()], "bluec_rad")
