"""ARToolKitPlus's .cal, against OpenCV's projection of the same thirteen numbers."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError
from calibrary.records import replace
from tests.parsers.cameras import camera

CAL = """\
ARToolKitPlus_CamCal_Rev02
1280 960 631.3 483.9 1104.7 1103.1 -0.1131 0.0247 -0.00037 0.00081 -0.0062 0.0 10
"""


def read(text: str) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="camera.cal")
    return calibration


def test_a_camera_projects_as_opencv_does() -> None:
    calibration = read(CAL)
    u, v = np.meshgrid(np.linspace(-0.6, 0.6, 15), np.linspace(-0.45, 0.45, 15))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    K = np.array([[1104.7, 0, 631.3], [0, 1103.1, 483.9], [0, 0, 1]])
    D = np.array([-0.1131, 0.0247, -0.00037, 0.00081, -0.0062])
    seen = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(calibration.project(rays), seen + 0.5, rtol=0, atol=1e-9)
    assert calibration.intrinsics.image_size == (1280, 960)
    assert calibration.grade is Grade.CALIBRATED


def test_the_origin_that_nobody_documents_is_told() -> None:
    assert "counted from the centre" in read(CAL).notes[0]


def test_zeros_are_no_distortion() -> None:
    row = "640 480 320 240 1500.0 1500.0 0.0 0.0 0.0 0.0 0.0 0.0 0"
    assert read(f"ARToolKitPlus_CamCal_Rev02\r\n{row}").distortion == NoDistortion()


def test_what_stands_after_the_numbers_is_not_read() -> None:
    assert read(CAL + "#\n# Images used: 21\n") == replace(
        read(CAL), provenance=read(CAL + "#\n# Images used: 21\n").provenance
    )


def test_a_sixth_coefficient_is_told() -> None:
    assert "0.25" in read(CAL.replace(" 0.0 10", " 0.25 10")).notes[1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ARToolKitPlus_CamCal_Rev02\n", "no line of numbers"),
        (CAL.replace(" 10\n", "\n"), "12 numbers, expected 13"),
        (CAL.replace(" 10\n", " 0 10\n"), "14 numbers, expected 13"),
        (CAL.replace("631.3", "631,3"), "decimal point"),
        (CAL.replace("1104.7", "0"), "focal lengths"),
        (CAL.replace("1280", "1280.5"), "image size"),
        (CAL.replace("Rev02", "Rev03"), "Rev03"),
    ],
)
def test_a_broken_file_names_what_is_wrong(text: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(text)


def test_it_is_written_in_the_programs_order() -> None:
    data, verdict = parsers.encode([camera()], "artoolkitplus_cal")
    heading, row = data.decode().splitlines()
    assert heading == "ARToolKitPlus_CamCal_Rev02"
    numbers = [float(part) for part in row.split()]
    assert numbers == [
        5472, 3648, 2741.3 - 0.5, 1815.9 - 0.5, 3650.1, 3648.7, -0.1131, 0.0247, -0.00037, 0.00081, -0.0062, 0, 20,
    ]  # fmt: skip
    assert str(verdict) == "exact (0.000 px)"


def test_the_iterations_survive() -> None:
    data, verdict = parsers.encode([read(CAL)], "artoolkitplus_cal")
    assert verdict.dropped == ()
    assert data.endswith(b" 10\n")
