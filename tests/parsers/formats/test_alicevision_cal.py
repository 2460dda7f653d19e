"""AliceVision's eight numbers, against OpenCV's projection of the same."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError, UnknownFormatError
from tests.parsers.samples import Sample

CAL = "1920 1080 1604.3 963.7 541.9 -0.1131 0.0247 -0.0062\n"


def read(text: str, record: str | None = None) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="cameraCalibration.cal", format=record)
    return calibration


SAMPLES = {"alicevision_cal": Sample(CAL.encode())}


def test_a_camera_projects_as_opencv_does() -> None:
    calibration = read(CAL)
    u, v = np.meshgrid(np.linspace(-0.6, 0.6, 15), np.linspace(-0.33, 0.33, 15))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    K = np.array([[1604.3, 0, 963.7], [0, 1604.3, 541.9], [0, 0, 1]])
    D = np.array([-0.1131, 0.0247, 0, 0, -0.0062])
    seen = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(calibration.project(rays), seen + 0.5, rtol=0, atol=1e-9)
    assert calibration.intrinsics.image_size == (1920, 1080)


def test_that_nothing_proves_the_format_is_told() -> None:
    notes = read(CAL).notes
    assert any("nothing in the file says" in note for note in notes)
    assert any("tangential" in note for note in notes)
    assert len(read(CAL, "alicevision_cal").notes) == 1


def test_zeros_are_no_distortion() -> None:
    assert read("640 480 500 320 240 0 0 0\n").distortion == NoDistortion()


def test_eight_numbers_of_another_kind_are_refused() -> None:
    with pytest.raises(ParseError, match="outside"):
        read("1 2 3 4 5 6 7 8\n")
    with pytest.raises(UnknownFormatError):
        read("1.5 2 3 4 5 6 7 8\n")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (CAL.replace("1604.3 ", ""), "7 numbers, expected 8"),
        (CAL.replace("1604.3", "1604,3"), "decimal point"),
        (CAL.replace("1604.3", "-1604.3"), "focal lengths"),
        (CAL.replace("1920", "1920.5"), "image size"),
        (CAL.replace("062\n", ""), "not ended"),
    ],
)
def test_a_broken_file_names_what_is_wrong(text: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(text, "alicevision_cal")
