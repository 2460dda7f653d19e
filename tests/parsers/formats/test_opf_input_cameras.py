"""OPF's input cameras: the same optics, with a size, a name and an origin."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.errors import InputError, ParseError
from tests.parsers.samples import Sample

INTERNALS = {
    "type": "perspective",
    "principal_point_px": [2736, 1824],
    "focal_length_px": 3666.7,
    "radial_distortion": [0.0038, -0.0171, 0.0196],
    "tangential_distortion": [0, 0],
}


def sensor(number: int = 7, **changes: Any) -> dict[str, Any]:
    fields = {"id": number, "name": "FC_8.8", "image_size_px": [5472, 3648], "pixel_size_um": 2.4}
    return {**fields, "shutter_type": "global", "internals": INTERNALS, **changes}


def document(*sensors: dict[str, Any], sources: tuple[str, ...] = ()) -> bytes:
    cameras = [{"sensor_id": 7, "id": index, "model_source": source} for index, source in enumerate(sources)]
    mark = "application/opf-input-cameras+json"
    fields = {"format": mark, "version": "1.0", "sensors": list(sensors), "captures": [{"cameras": cameras}]}
    return json.dumps(fields).encode()


def read(data: bytes) -> Sequence[Calibration]:
    return parsers.decode(data, name="input_cameras.json")


SAMPLES = {"opf_input_cameras": Sample(document(sensor()))}


def test_the_file_says_its_size_and_what_it_knows_beside_k() -> None:
    [calibration] = read(document(sensor()))
    K = calibration.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy, K.image_size) == (3666.7, 3666.7, 2736.0, 1824.0, (5472, 3648))
    assert dict(calibration.extras)["opf_input_cameras/pixel_size_um"] == "2.4"
    assert calibration.camera.sub_camera is None


def test_several_sensors_have_their_names() -> None:
    cameras = read(document(sensor(1), sensor(2, name="Tele"), sensor(3)))
    assert [item.camera.sub_camera for item in cameras] == ["FC_8.8 1", "Tele", "FC_8.8 3"]


@pytest.mark.parametrize(
    ("sources", "grade"),
    [
        ((), Grade.DESIGN),
        (("database",), Grade.DESIGN),
        (("user", "database"), Grade.DESIGN),
        (("generic_from_exif",), Grade.DERIVED),
        (("database", "generic"), Grade.PRIOR),
        (("some later word",), Grade.PRIOR),
    ],
)
def test_the_grade_is_that_of_the_worst_source(sources: tuple[str, ...], grade: Grade) -> None:
    assert read(document(sensor(), sources=sources))[0].grade is grade


def test_a_size_that_contradicts_the_file_is_refused() -> None:
    with pytest.raises(InputError, match="5472×3648"):
        parsers.decode(document(sensor()), name="f.json", image_size=(4000, 3000))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"image_size_px": [5472]}, "1 numbers, expected 2"),
        ({"image_size_px": [5472, 0]}, "image size"),
        ({"internals": {}}, "type"),
        ({"id": "7"}, "whole number"),
    ],
)
def test_a_broken_file_names_what_is_wrong(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(document(sensor(**changes)))
