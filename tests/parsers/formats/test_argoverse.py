"""Argoverse's cameras, against OpenCV's polynomial."""

from __future__ import annotations

import json
from typing import Any

import pytest

from calibrary import parsers
from calibrary.distortion import NoDistortion
from calibrary.errors import MissingSizeError, ParseError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample

VALUE: dict[str, Any] = {
    "distortion_coefficients_": [-0.0878, -0.0963, 0.0367],
    "focal_center_x_px_": 1260.6,
    "focal_center_y_px_": 1059.5,
    "focal_length_x_px_": 3634.1,
    "focal_length_y_px_": 3635.2,
    "skew_": 0.0,
    "vehicle_SE3_camera_": {
        "rotation": {"coefficients": [0.5, -0.49, 0.51, -0.5]},
        "translation": [1.6, -0.1, 1.3],
    },
}
FILE = {"camera_data_": [{"key": "image_raw_stereo_front_left", "value": VALUE}]}
SAMPLES = {"argoverse": Sample(json.dumps(FILE).encode())}


def test_the_coefficients_are_radial() -> None:
    [item] = parsers.decode(SAMPLES["argoverse"].data, name="vehicle_calibration_info.json")
    assert_projects_as_opencv(item, (3634.1, 3635.2, 1260.6, 1059.5), (-0.0878, -0.0963, 0.0, 0.0, 0.0367))
    assert item.intrinsics.image_size == (2464, 2056)
    assert any("do" in text or "does not state image sizes" in text for text in item.provenance.assumptions)


def test_a_rectified_camera_has_no_distortion_and_the_raw_images_coefficients_are_named() -> None:
    rows = [{"key": f"image_raw_stereo_front_left{end}", "value": VALUE} for end in ("", "_rect")]
    raw, rectified = parsers.decode(json.dumps({"camera_data_": rows}).encode(), name="x.json")
    assert raw.distortion is not None
    assert raw.distortion.coefficients["k1"] == -0.0878
    assert rectified.distortion == NoDistortion()
    assert any("distortion_coefficients_ is of the raw images" in note for note in rectified.notes)


def test_the_size_of_another_camera_is_asked_for() -> None:
    with pytest.raises(MissingSizeError):
        parsers.decode(
            json.dumps({"camera_data_": [{"key": "roof", "value": VALUE}]}).encode(), name="x.json"
        )


def test_two_coefficients_are_refused() -> None:
    broken = {"camera_data_": [{"key": "roof", "value": {**VALUE, "distortion_coefficients_": [0.1, 0.2]}}]}
    with pytest.raises(ParseError, match="2 numbers, expected 3"):
        parsers.decode(json.dumps(broken).encode(), name="x.json")
