"""DepthAI's EEPROM, against OpenCV, whose fourteen coefficients it holds."""

from __future__ import annotations

import json
from collections.abc import Sequence

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion, Rational, Tilted
from calibrary.errors import InputError, MissingTagError, ParseError, UnsupportedModelError
from calibrary.records import Json
from tests.parsers.samples import Sample

K: list[Json] = [[799.4, 0.0, 652.9], [0.0, 799.1, 382.2], [0.0, 0.0, 1.0]]
# As such devices have them: numerator and denominator nearly cancel.
D8 = [9.491, -102.07, 0.0008, 0.002, 401.19, 9.265, -100.43, 394.56]


def entry(D: list[float], **changes: Json) -> dict[str, Json]:
    camera: dict[str, Json] = {
        "cameraType": 0, "distortionCoeff": [*D, *[0.0] * (14 - len(D))], "height": 720, "width": 1280,
        "intrinsicMatrix": K, "lensPosition": 130, "specHfovDeg": 71.8,
    }  # fmt: skip
    return camera | changes


def read(document: Json, size: tuple[int, int] | None = None) -> Sequence[Calibration]:
    return parsers.decode(json.dumps(document).encode(), name="calib.json", image_size=size)


def device(*cameras: Json) -> Json:
    return {"boardName": "BW1098OBC", "productName": "OAK-D", "cameraData": list(cameras), "version": 7}


def rays() -> NDArray[np.float64]:
    x, y = np.meshgrid(np.linspace(-0.7, 0.7, 25), np.linspace(-0.45, 0.45, 25))
    return np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])


SAMPLES = {"depthai": Sample(json.dumps(device([0, entry(D8)])).encode())}


@pytest.mark.parametrize("D", [D8, [*D8, 1e-4, -2e-5, -7e-5, 2e-5, 0.01, -0.02]], ids=["rational", "tilted"])
def test_it_projects_as_opencv_with_the_same_vector(D: list[float]) -> None:
    [calibration] = read(device([2, entry(D)]))
    vector = np.array([*D, *[0.0] * (14 - len(D))])
    expected = cv2.projectPoints(rays(), np.zeros(3), np.zeros(3), np.array(K), vector)[0].reshape(-1, 2)
    np.testing.assert_allclose(calibration.project(rays()) - 0.5, expected, rtol=0, atol=1e-9)
    assert isinstance(calibration.distortion, Rational if D is D8 else Tilted)


def test_large_coefficients_that_cancel_are_one_to_one_over_the_image() -> None:
    [calibration] = read(device([2, entry(D8)]))
    pixels = np.array([[0.0, 0.0], [1280.0, 720.0], [640.0, 360.0]])
    np.testing.assert_allclose(calibration.project(calibration.unproject(pixels)), pixels, rtol=0, atol=1e-8)


def test_zeros_at_the_end_are_left_away() -> None:
    assert isinstance(read(device([0, entry([-0.1, 0.02])]))[0].distortion, BrownConrady)
    assert read(device([0, entry([])]))[0].distortion == NoDistortion()


def test_cameras_are_named_by_their_sockets_and_the_product() -> None:
    cameras = read(device([0, entry(D8)], [1, entry(D8, width=640, height=400)], [2, entry(D8)]))
    assert [item.camera.sub_camera for item in cameras] == ["CAM_A", "CAM_B", "CAM_C"]
    assert str(cameras[0].camera) == "Luxonis OAK-D CAM_A 1280×720"
    assert cameras[1].intrinsics.image_size == (640, 400)


def test_a_fisheye_has_four() -> None:
    [calibration] = read(device([0, entry([0.03, -0.007, 0.004, -0.001], cameraType=1)]))
    assert calibration.distortion == KannalaBrandt(k1=0.03, k2=-0.007, k3=0.004, k4=-0.001)


def test_a_socket_without_a_calibration_is_skipped() -> None:
    zeros: Json = [[0, 0, 0], [0, 0, 0], [0, 0, 0]]
    cameras = read(
        device([0, entry([], intrinsicMatrix=[])], [1, entry([], intrinsicMatrix=zeros)], [2, entry(D8)])
    )
    assert [item.provenance.tag for item in cameras] == ["cameraData[2][1]"]
    with pytest.raises(ParseError, match="not calibrated"):
        read(device([0, entry([], intrinsicMatrix=[])]))


def test_one_camera_may_stand_alone() -> None:
    alone: Json = {"intrinsicMatrix": K, "distortionCoeff": [*D8, *[0.0] * 6]}
    with pytest.raises(MissingTagError, match="--image-size"):
        read(alone)
    assert read(alone, (1280, 720))[0].intrinsics.cx == 652.9 + 0.5


def test_an_object_of_sockets_is_read_too() -> None:
    cameras = read({"cameraData": {"CAM_A": entry(D8), "CAM_B": entry(D8)}})
    assert [item.camera.sub_camera for item in cameras] == ["CAM_A", "CAM_B"]


@pytest.mark.parametrize(
    ("document", "error", "match"),
    [
        (device([0, entry(D8, cameraType=2)]), UnsupportedModelError, "cameraType: the model is '2'"),
        (device([0, entry(D8, cameraType=1)]), ParseError, "fisheye"),
        (device([0, entry(D8, distortionCoeff=[1, 2, 3])]), ParseError, "3 numbers"),
        (
            device([0, entry(D8, intrinsicMatrix=[[1, 0, 1], [1, 1, 1], [0, 0, 1]])]),
            ParseError,
            "camera matrix",
        ),
        (device([0]), ParseError, "1 values"),
        (device([0, entry(D8, width=0)]), ParseError, "image size"),
        (device(3), ParseError, "expected a list"),
    ],
)
def test_a_broken_file_names_what_is_wrong(document: Json, error: type[InputError], match: str) -> None:
    with pytest.raises(error, match=match):
        read(document)
