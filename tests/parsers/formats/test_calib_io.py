"""calib.io's JSON, against OpenCV, whose coefficients it names."""

from __future__ import annotations

import json
from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import NoDistortion, Rational, Tilted
from calibrary.errors import InputError, MissingTagError, ParseError, UnsupportedModelError
from calibrary.records import Json
from tests.parsers.samples import Sample

NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tauX", "tauY")
D14 = (
    -0.0125,
    0.0231,
    -3.7e-4,
    8.1e-4,
    -0.0172,
    0.0083,
    -0.0061,
    0.0042,
    1.1e-4,
    -2.3e-5,
    -7e-5,
    1.9e-5,
    0.01,
    -0.02,
)
OPENCV = "libCalib::CameraModelOpenCV"
SIZE: Json = {"CameraModelBase": {"imageSize": {"width": 1920, "height": 1200}}}


def camera(
    count: int = 14, name: str | None = OPENCV, number: int = (1 << 31) + 1, size: Json = SIZE
) -> dict[str, Json]:
    D = [*D14[:count], *[0.0] * (14 - count)]
    numbers = {"f": 1733.2, "ar": 0.9992, "cx": 971.6, "cy": 588.3, **dict(zip(NAMES, D, strict=True))}
    parameters: Json = {key: {"val": value, "state": 2} for key, value in numbers.items()}
    data: dict[str, Json] = {"CameraModelCRT": size, "parameters": parameters}
    model: dict[str, Json] = {"polymorphic_id": number, "ptr_wrapper": {"valid": 1, "data": data}}
    return {"model": model | ({"polymorphic_name": name} if name else {}), "transform": {}}


def read(*cameras: Json, size: tuple[int, int] | None = None) -> Sequence[Calibration]:
    document = json.dumps({"Calibration": {"cameras": list(cameras)}}).encode()
    return parsers.decode(document, name="calibration.json", image_size=size)


SAMPLES = {"calib_io": Sample(json.dumps({"Calibration": {"cameras": [camera()]}}).encode())}


@pytest.mark.parametrize(("count", "model"), [(0, NoDistortion), (8, Rational), (14, Tilted)])
def test_it_projects_as_opencv_with_the_same_coefficients(count: int, model: type) -> None:
    [calibration] = read(camera(count))
    assert type(calibration.distortion) is model
    x, y = np.meshgrid(np.linspace(-0.55, 0.55, 25), np.linspace(-0.35, 0.35, 25))
    rays = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])
    K = np.array([[1733.2, 0, 971.6], [0, 1733.2 * 0.9992, 588.3], [0, 0, 1]])
    D = np.array([*D14[:count], *[0.0] * (14 - count)])
    expected = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(calibration.project(rays) - 0.5, expected, rtol=0, atol=1e-9)
    assert calibration.intrinsics.image_size == (1920, 1200)


def test_later_cameras_repeat_the_number_of_their_model_only() -> None:
    cameras = read(camera(), camera(8, name=None, number=1))
    assert [item.camera.sub_camera for item in cameras] == ["cam0", "cam1"]
    with pytest.raises(ParseError, match="gave 2 a name"):
        read(camera(), camera(name=None, number=2))


def test_a_file_without_a_size_asks_for_one() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        read(camera(size={}))
    assert read(camera(size={}), size=(1920, 1200))[0].intrinsics.fx == 1733.2


@pytest.mark.parametrize(
    ("item", "error", "match"),
    [
        (camera(name="libCalib::CameraModelGenericBSpline"), UnsupportedModelError, "GenericBSpline"),
        ({"model": {"polymorphic_id": 1, "note": "libCalib::"}}, ParseError, "gave 1 a name"),
        ({"note": "libCalib::"}, ParseError, "model"),
    ],
)
def test_a_broken_file_names_what_is_wrong(item: Json, error: type[InputError], match: str) -> None:
    document = json.dumps({"Calibration": {"cameras": [item]}}).encode()
    with pytest.raises(error, match=match):
        parsers.decode(document, name="calibration.json", format="calib_io")
