"""multical's rigs and JSON with OpenCV cameras by name, against OpenCV."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.errors import MissingTagError, ParseError, UnsupportedModelError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample

K = [[433.2, 0.0, 371.6], [0.0, 432.9, 238.3], [0.0, 0.0, 1.0]]
OPENCV = (433.2, 432.9, 371.6, 238.3)
RATIONAL = [-0.2, 0.04, -0.0003, 0.0008, 0.01, 0.02, 0.003, 0.001]
BROWN = [-0.2131, 0.0447, -0.00037, 0.00081, 0.0062]
RIG: dict[str, Any] = {
    "cameras": {
        "left": {"model": "standard", "image_size": [752, 480], "K": K, "dist": [BROWN]},
        "right": {"model": "rational", "image_size": [752, 480], "K": K, "dist": [RATIONAL]},
    },
    "camera_poses": {"left": {"R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "T": [0, 0, 0]}},
}  # fmt: skip
NAMED: dict[str, Any] = {
    "cam1": {"K": K, "dist": [[-0.2131, 0.0447, -0.00037, 0.00081, 0.0062]]},
    "cam0": {"camera_matrix": K, "dist_coeff": [RATIONAL]},
}
SAMPLES = {
    "multical": Sample(json.dumps(RIG).encode()),
}


def read(document: object, **named: Any) -> Sequence[Calibration]:
    return parsers.decode(json.dumps(document).encode(), name="calibration.json", **named)


def test_a_rig_has_opencvs_cameras() -> None:
    left, right = read(RIG)
    assert_projects_as_opencv(left, OPENCV, (-0.2131, 0.0447, -0.00037, 0.00081, 0.0062))
    assert_projects_as_opencv(right, OPENCV, RATIONAL)
    assert [item.camera.sub_camera for item in (left, right)] == ["left", "right"]


def test_a_rigs_fisheye_is_opencvs_fisheye() -> None:
    one = {
        "model": "fisheye",
        "image_size": [752, 480],
        "K": K,
        "dist": [[-0.0292], [0.0208], [-0.0319], [0.0166]],
    }
    [item] = read({"cameras": {"a": one}})
    assert_projects_as_opencv(item, OPENCV, (-0.0292, 0.0208, -0.0319, 0.0166), fisheye=True)


def test_cameras_by_name_have_any_of_opencvs_keys() -> None:
    first, second = read(NAMED, image_size=(752, 480))
    assert_projects_as_opencv(first, OPENCV, (-0.2131, 0.0447, -0.00037, 0.00081, 0.0062))
    assert_projects_as_opencv(second, OPENCV, RATIONAL)
    assert [item.camera.sub_camera for item in (first, second)] == ["cam1", "cam0"]
    with pytest.raises(MissingTagError, match="--image-size"):
        read(NAMED)


@pytest.mark.parametrize(
    ("key", "value", "kind", "match"),
    [
        ("model", "omni", UnsupportedModelError, "omni"),
        ("dist", [[1, 2, 3]], ParseError, r"cameras\.left\.dist: 3 numbers"),
        ("K", [[1, 0], [0, 1]], ParseError, "2 rows"),
        ("image_size", [752], ParseError, "1 numbers"),
    ],
)
def test_a_broken_rig_names_what_is_wrong(key: str, value: Any, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        read({"cameras": {"left": {**RIG["cameras"]["left"], key: value}}})


def test_cameras_without_number_are_refused() -> None:
    with pytest.raises(ParseError, match="over 1000 cameras, the most"):
        read({"cameras": dict.fromkeys(map(str, range(1001)), RIG["cameras"]["left"])})
