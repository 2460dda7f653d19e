"""RealSense's numbers, against librealsense's own formulas and OpenCV."""

from __future__ import annotations

import json
from collections.abc import Sequence

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, InverseBrown, NoDistortion
from calibrary.errors import (
    InputError,
    MissingTagError,
    ParseError,
    UnknownFormatError,
    UnsupportedModelError,
)
from calibrary.records import Json
from tests.parsers.samples import Sample

Array = NDArray[np.float64]
TABLE: dict[str, Json] = {
    "baseline": -50.1, "intrinsic_left.x.x": 0.497,
    "rectified.0.width": 1920, "rectified.0.height": 1080, "rectified.0.fx": "957.2", "rectified.0.fy": "957.2",
    "rectified.0.ppx": 971.8, "rectified.0.ppy": 527.8,
    "rectified.1.width": 1280, "rectified.1.height": 720, "rectified.1.fx": 638.1, "rectified.1.fy": 638.1,
    "rectified.1.ppx": 647.9, "rectified.1.ppy": 351.9,
    "rectified.2.width": 0, "rectified.2.height": 0, "rectified.2.fx": 0, "rectified.2.fy": 0,
    "rectified.2.ppx": 0, "rectified.2.ppy": 0,
}  # fmt: skip
STREAM: dict[str, Json] = {
    "width": 1280, "height": 720, "fx": 638.1, "fy": 637.9, "ppx": 647.9, "ppy": 351.9,
    "model": "Brown Conrady", "coeffs": [-0.055, 0.066, -0.0006, 0.0004, -0.021],
}  # fmt: skip
D = (-0.055, 0.066, -0.0006, 0.0004, -0.021)
K = np.array([[638.1, 0, 647.9], [0, 637.9, 351.9], [0, 0, 1]])


def read(document: Json, size: tuple[int, int] | None = None, **options: str) -> Sequence[Calibration]:
    return parsers.decode(json.dumps(document).encode(), name="camera.json", image_size=size, options=options)


def stream(model: str, **changes: Json) -> dict[str, Json]:
    return {**STREAM, "model": model, **changes}


def rays() -> Array:
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 25), np.linspace(-0.5, 0.5, 25))
    return np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])


SAMPLES = {"realsense": Sample(json.dumps(STREAM).encode())}


def test_the_table_gives_the_rectified_camera_at_every_resolution() -> None:
    first, second = read(TABLE)
    assert first.camera.sub_camera == "rectified 1920x1080"
    assert (first.intrinsics.fx, first.intrinsics.cx, first.intrinsics.cy) == (957.2, 972.3, 528.3)
    assert second.intrinsics.image_size == (1280, 720)
    assert first.distortion == NoDistortion()
    assert "intrinsic_left" in first.notes[0]


def test_a_size_selects_one_of_the_table() -> None:
    [only] = read(TABLE, (1280, 720))
    assert only.intrinsics.fx == 638.1
    assert only.camera.sub_camera is None
    with pytest.raises(InputError, match="1920×1080, 1280×720"):
        read(TABLE, (640, 480))


@pytest.mark.parametrize(
    "name", ["Brown Conrady", "distortion.brown_conrady", "RS2_DISTORTION_BROWN_CONRADY"]
)
def test_brown_conrady_is_opencvs(name: str) -> None:
    [calibration] = read(stream(name))
    expected = cv2.projectPoints(rays(), np.zeros(3), np.zeros(3), K, np.array(D))[0].reshape(-1, 2)
    np.testing.assert_allclose(calibration.project(rays()) - 0.5, expected, rtol=0, atol=1e-9)


def test_kannala_brandt_is_opencvs_fisheye() -> None:
    [calibration] = read(stream("Kannala Brandt4", coeffs=[-0.0292, 0.0208, -0.0319, 0.0166, 0.0]))
    vector = np.array([-0.0292, 0.0208, -0.0319, 0.0166])
    points = rays().reshape(-1, 1, 3)
    expected = cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), K, vector)[0].reshape(-1, 2)
    np.testing.assert_allclose(calibration.project(rays()) - 0.5, expected, rtol=0, atol=1e-9)


def test_f_theta_is_the_field_of_view_model() -> None:
    [calibration] = read(stream("F-Theta", coeffs=[0.92, 0, 0, 0, 0]))
    P = rays()
    r = np.hypot(P[:, 0], P[:, 1])
    scale = np.arctan(2 * r * np.tan(0.46)) / 0.92 / np.where(r > 0, r, 1)
    expected = P[:, :2] * scale[:, None] * [638.1, 637.9] + [647.9, 351.9]
    np.testing.assert_allclose(calibration.project(P) - 0.5, expected, rtol=0, atol=1e-9)


def test_inverse_brown_conrady_is_asked_about() -> None:
    with pytest.raises(ParseError, match="inverse_brown"):
        read(stream("Inverse Brown Conrady"))
    [documented] = read(stream("Inverse Brown Conrady"), inverse_brown="distorted-to-undistorted")
    assert documented.distortion == InverseBrown(k1=-0.055, k2=0.066, p1=-0.0006, p2=0.0004, k3=-0.021)
    [newer] = read(stream("Inverse Brown Conrady"), inverse_brown="undistorted-to-distorted")
    assert newer.distortion == BrownConrady(k1=-0.055, k2=0.066, p1=-0.0006, p2=0.0004, k3=-0.021)


def test_the_documented_inverse_deprojects_by_librealsenses_closed_form() -> None:
    [calibration] = read(stream("Inverse Brown Conrady"), inverse_brown="distorted-to-undistorted")
    px = np.array([[100.0, 80.0], [700.0, 333.0], [1200.0, 650.0]])
    x, y = ((px - [647.9, 351.9]) / [638.1, 637.9]).T
    k1, k2, p1, p2, k3 = D
    r2 = x * x + y * y
    f = 1 + k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2
    ux = x * f + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    uy = y * f + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
    found = calibration.unproject(px + 0.5)
    np.testing.assert_allclose(found[:, :2] / found[:, 2:], np.stack([ux, uy], axis=1), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["Inverse Brown Conrady", "Modified Brown Conrady", "None", "F-Theta"])
def test_coefficients_that_are_all_zero_are_no_distortion_in_every_model(name: str) -> None:
    assert read(stream(name, coeffs=[0, 0, 0, 0, 0]))[0].distortion == NoDistortion()


def test_modified_brown_conrady_is_brown_conrady_without_tangential_terms_only() -> None:
    [calibration] = read(stream("Modified Brown Conrady", coeffs=[-0.05, 0.06, 0, 0, -0.02]))
    assert calibration.distortion == BrownConrady(k1=-0.05, k2=0.06, p1=0.0, p2=0.0, k3=-0.02)
    with pytest.raises(UnsupportedModelError, match="tangential"):
        read(stream("Modified Brown Conrady"))


@pytest.mark.parametrize("document", [{"color": STREAM, "depth": STREAM, "device": "D435"}, [STREAM, STREAM]])
def test_several_streams_are_read_with_their_names(document: Json) -> None:
    cameras = read(document)
    assert [item.camera.sub_camera for item in cameras] in (["color", "depth"], ["[0]", "[1]"])


def test_a_size_that_is_not_stated_is_asked_for() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        read({key: value for key, value in STREAM.items() if key not in {"width", "height"}})


def test_without_a_model_the_coefficients_are_brown_conradys_and_that_is_said() -> None:
    unnamed = {key: value for key, value in STREAM.items() if key != "model"}
    [item] = read({"color": {**unnamed, "coeffs": [STREAM["coeffs"]]}})
    assert item.distortion == read(STREAM)[0].distortion
    assert "names no model" in item.notes[0]
    assert read({**unnamed, "coeffs": []})[0].distortion is None


@pytest.mark.parametrize(
    ("document", "error", "match"),
    [
        (stream("Thin Prism"), UnsupportedModelError, "Thin Prism"),
        (stream("None"), ParseError, "has none"),
        (stream("Brown Conrady", coeffs=[1, 2, 3]), ParseError, "3 numbers, expected 4 or 5"),
        (stream("F-Theta", coeffs=[53.0, 0, 0, 0, 0]), ParseError, "degrees"),
        (stream("None", fx=0, coeffs=[]), ParseError, "focal"),
        ({**TABLE, "rectified.0.width": 19.5}, ParseError, "image size"),
        ({"fx": 1, "fy": 1}, UnknownFormatError, "no format"),
    ],
)
def test_a_broken_file_names_what_is_wrong(document: Json, error: type[InputError], match: str) -> None:
    with pytest.raises(error, match=match):
        read(document)


PRINTED = """\
 Intrinsic of "Color" / {size} / {{YUYV/RGB8}}
  Width:      	{width}
  Height:     	{height}
  PPX:        	647.9
  PPY:        	351.9
  Fx:         	638.1
  Fy:         	637.9
  Distortion: 	Brown Conrady
  Coeffs:     	-0.055  	0.066  	-0.0006  	0.0004  	-0.021
  FOV (deg):  	90.17 x 58.87

"""


def printed(*sizes: str) -> bytes:
    blocks = (
        PRINTED.format(size=size, width=size.split("x")[0], height=size.split("x")[1]) for size in sizes
    )
    return (
        "Intrinsic Parameters:\n\n" + "".join(blocks) + 'Extrinsic from "Color"\n Rotation: 1 0 0\n'
    ).encode()


def test_what_rs_enumerate_devices_prints_is_read() -> None:
    [item] = parsers.decode(printed("1280x720"), name="camera.txt")
    [same] = read(STREAM)
    assert (item.intrinsics, item.distortion) == (same.intrinsics, same.distortion)


def test_every_printed_stream_is_named_with_its_size() -> None:
    cameras = parsers.decode(printed("1280x720", "1920x1080"), name="camera.txt")
    assert [item.camera.sub_camera for item in cameras] == ["Color 1280x720", "Color 1920x1080"]
