"""PhotonVision's JSON, against OpenCV."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample

FILE: dict[str, Any] = {
    "resolution": {"width": 752.0, "height": 480.0},
    "cameraIntrinsics": {
        "rows": 3, "cols": 3, "type": 6, "data": [433.2, 0.0, 371.6, 0.0, 432.9, 238.3, 0.0, 0.0, 1.0],
    },
    "distCoeffs": {"rows": 1, "cols": 5, "type": 6, "data": [-0.2131, 0.0447, -0.00037, 8.1e-4, 0.0062]},
    "perViewErrors": [0.31, 0.28],
    "standardDeviation": 0.02,
}  # fmt: skip
OPENCV = (433.2, 432.9, 371.6, 238.3)
SAMPLES = {"photonvision": Sample(json.dumps(FILE).encode())}


def read(document: object) -> Sequence[Calibration]:
    return parsers.decode(json.dumps(document).encode(), name="camera.json")


def test_the_numbers_are_opencvs() -> None:
    [item] = read(FILE)
    assert_projects_as_opencv(item, OPENCV, (-0.2131, 0.0447, -0.00037, 0.00081, 0.0062))
    assert item.intrinsics.image_size == (752, 480)
    assert item.quality is not None
    assert item.quality.views == 2


def test_older_files_call_the_coefficients_extrinsics() -> None:
    older = {key: value for key, value in FILE.items() if key != "distCoeffs"}
    [item] = read({**older, "cameraExtrinsics": FILE["distCoeffs"]})
    assert item.distortion == read(FILE)[0].distortion
    four = [-0.0292, 0.0208, -0.0319, 0.0166]
    coefficients = {"rows": 4, "cols": 1, "type": 6, "data": four}
    [item] = read({**older, "cameraExtrinsics": coefficients, "isFisheye": True})
    assert_projects_as_opencv(item, OPENCV, four, fisheye=True)


def test_a_cameras_settings_have_a_calibration_for_each_resolution() -> None:
    items = read(
        {"nickname": "front", "calibrations": [FILE, {**FILE, "resolution": {"width": 1504, "height": 960}}]}
    )
    assert [item.camera.sub_camera for item in items] == ["752×480", "1504×960"]


@pytest.mark.parametrize(
    ("key", "value", "kind", "match"),
    [
        ("lensmodel", "LENSMODEL_SPLINED_STEREOGRAPHIC", UnsupportedModelError, "SPLINED"),
        ("distCoeffs", {"rows": 1, "cols": 3, "data": [1, 2, 3]}, ParseError, "3 numbers"),
        ("cameraIntrinsics", {"rows": 2, "cols": 2, "data": [1, 2, 3, 4]}, ParseError, "2×2"),
        ("resolution", {"width": 0, "height": 2}, ParseError, "image size"),
    ],
)
def test_a_broken_file_names_what_is_wrong(key: str, value: Any, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        read({**FILE, key: value})
