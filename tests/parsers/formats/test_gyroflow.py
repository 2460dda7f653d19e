"""Gyroflow's profiles: OpenCV's fisheye, a prior, and never more than that."""

from __future__ import annotations

import json
from typing import Any

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.records import replace

Profile = dict[str, Any]  # JSON as Gyroflow writes it

MATRIX = [[2801.4, 0.0, 1926.4], [0.0, 2803.38, 1053.2], [0.0, 0.0, 1.0]]
COEFFICIENTS = [0.0618, -0.0183, 0.0682, -0.0805]
PROFILE: Profile = {
    "camera_brand": "Acme", "camera_model": "Air 3", "lens_model": "24 mm", "camera_setting": "4k wide",
    "calib_dimension": {"w": 3840, "h": 2160}, "input_horizontal_stretch": 1.0, "input_vertical_stretch": 1.0,
    "calibrated_by": "A. Pilot", "calibrator_version": "1.5.2", "date": "2023-09-08",
    "num_images": 12, "distortion_model": None, "digital_lens": None,
    "fisheye_params": {"RMS_error": 0.97, "camera_matrix": MATRIX, "distortion_coeffs": COEFFICIENTS},
}  # fmt: skip


def read(**changes: object) -> Calibration:
    [calibration] = parsers.decode(json.dumps({**PROFILE, **changes}).encode(), name="lens.json")
    return calibration


def params(**changes: object) -> Profile:
    return {"fisheye_params": {**PROFILE["fisheye_params"], **changes}}


def test_it_projects_as_opencvs_fisheye_does() -> None:
    u, v = np.meshgrid(np.linspace(-0.7, 0.7, 25), np.linspace(-0.4, 0.4, 25))
    points = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    zero = np.zeros(3)
    expected, _ = cv2.fisheye.projectPoints(
        points[:, None], zero, zero, np.array(MATRIX), np.array(COEFFICIENTS)
    )
    np.testing.assert_allclose(read().project(points), expected.reshape(-1, 2) + 0.5, rtol=0, atol=1e-9)


def test_it_is_a_prior_and_cannot_be_written_on() -> None:
    item = read()
    assert item.grade is Grade.PRIOR
    assert "not of one camera" in item.notes[0]
    with pytest.raises(InputError, match="guess"):
        parsers.encode([item], "opencv_storage")


def test_a_measured_fisheye_is_written_with_the_programs_own_keys() -> None:
    item = replace(read(), grade=Grade.CALIBRATED)
    data, verdict = parsers.encode([item], "gyroflow")
    written = json.loads(data)
    assert written["orig_dimension"] == {"w": 3840, "h": 2160}
    assert written["calibrator_version"] == "1.5.2"
    kept = {key: value for key, value in PROFILE.items() if value is not None}
    assert {key: written[key] for key in kept} == kept
    assert verdict.dropped == ("grade calibrated (the file reads as prior)",)


def test_another_program_is_named_whole() -> None:
    item = replace(read(), grade=Grade.CALIBRATED)
    origin = replace(item.provenance, tool="calibrary 0.1.0")
    [copy] = parsers.decode(parsers.encode([replace(item, provenance=origin)], "gyroflow")[0], name="a.json")
    assert copy.provenance.tool == "calibrary 0.1.0"


def test_a_camera_whose_distortion_is_unknown_is_not_made_an_equidistant_fisheye() -> None:
    with pytest.raises(UnsupportedModelError, match="the distortion is unknown, and a file of this format"):
        parsers.encode([replace(read(), grade=Grade.DERIVED, distortion=None)], "gyroflow")


def test_it_says_which_kind_of_camera_it_is_of() -> None:
    item = read()
    key = item.camera
    assert (key.make, key.model, key.lens, key.capture_mode, key.image_size) == (
        "Acme", "Air 3", "24 mm", "4k wide", (3840, 2160),
    )  # fmt: skip
    assert item.quality is not None
    assert (item.quality.rms_px, item.quality.views) == (0.97, 12)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"distortion_model": "poly5"}, "poly5"),
        ({"digital_lens": "gopro_superview"}, "gopro_superview"),
        ({"input_horizontal_stretch": 1.33}, "anamorphic"),
    ],
)
def test_another_model_is_refused_by_name(changes: Profile, named: str) -> None:
    with pytest.raises(UnsupportedModelError, match=named):
        read(**changes)


def test_the_fisheye_may_be_named() -> None:
    assert read(distortion_model="opencv_fisheye").distortion == read().distortion


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"calib_dimension": {"w": 3840}}, "'h'"),
        (params(distortion_coeffs=[0.1, 0.2]), "2 numbers, expected 4"),
        (params(camera_matrix=[[1, 0, 1], [0, 1, 1]]), "2 rows, expected 3"),
        (params(camera_matrix=[[1, 0, 1], [1, 1, 1], [0, 0, 1]]), "not a camera matrix"),
        (params(camera_matrix=[[0, 0, 1], [0, 1, 1], [0, 0, 1]]), "focal lengths"),
    ],
    ids=str,
)
def test_a_broken_profile_names_what_is_wrong(changes: Profile, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(**changes)
