"""FTC's webcam calibrations, against OpenCV, whose numbers they are."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.errors import ParseError
from tests.parsers.samples import Sample

K = np.array([[602.5, 0.0, 318.75], [0.0, 603.25, 241.5], [0.0, 0.0, 1.0]])
D = np.array([0.11, -0.24, 0.001, -0.0005, 0.09, 0.01, 0.02, 0.03])
ONE = (
    '<Calibration size="{size}" focalLength="602.5, 603.25" principalPoint="318.75, 241.5"'
    ' distortionCoefficients="{D}"/>'
)
FILE = (
    "<?xml version='1.0' encoding='UTF-8'?>\n<Calibrations>\n"
    '  <Camera vid="Logitech" pid="0x085C">\n    {calibrations}\n  </Camera>\n</Calibrations>\n'
)


def file(*sizes: str, coefficients: str = ", ".join(map(str, D))) -> bytes:
    return FILE.format(
        calibrations="\n".join(ONE.format(size=size, D=coefficients) for size in sizes)
    ).encode()


SAMPLES = {"ftc_webcams": Sample(file("640 480"))}


def test_it_projects_as_opencv_does() -> None:
    [item] = parsers.decode(file("640 480"), name="webcams.xml")
    rays = np.array([[x, y, 1.0] for x in np.linspace(-0.4, 0.4, 9) for y in np.linspace(-0.3, 0.3, 7)])
    expected = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(item.project(rays) - 0.5, expected, rtol=0, atol=1e-9)


def test_every_size_of_a_webcam_is_a_camera() -> None:
    cameras = parsers.decode(file("640 480", "1280 720"), name="webcams.xml")
    assert [item.intrinsics.image_size for item in cameras] == [(640, 480), (1280, 720)]
    assert cameras[1].camera.sub_camera == "Logitech 0x085C 1280 720"


def test_coefficients_of_no_lens_are_refused() -> None:
    with pytest.raises(ParseError, match="3 numbers"):
        parsers.decode(file("640 480", coefficients="0.1, 0.2, 0.3"), name="webcams.xml")
