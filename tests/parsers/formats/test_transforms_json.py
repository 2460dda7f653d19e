"""instant-ngp's and nerfstudio's transforms.json, against OpenCV half a pixel away as nerfstudio calls it."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion
from calibrary.errors import MissingTagError, ParseError, UnsupportedModelError
from calibrary.records import replace
from tests.parsers.cameras import BROWN, SIZE, camera

Array = NDArray[np.float64]
Document = dict[str, Any]  # JSON as the programs have it

POSE = np.eye(4).tolist()
CAMERA: Document = {
    "w": 1920, "h": 1080.0, "fl_x": 1375.52, "fl_y": 1374.49, "cx": 965.268, "cy": 554.558,
    "k1": 0.0578, "k2": -0.0805, "p1": -0.00098, "p2": 0.000156,
}  # fmt: skip
FRAMES = [{"file_path": f"images/{i}.jpg", "transform_matrix": POSE} for i in range(3)]
ONE = {**CAMERA, "frames": FRAMES}
ANGLES = {"camera_angle_x": 2 * math.atan(960 / 1375.52), "camera_angle_y": 2 * math.atan(540 / 1374.49)}


def decoded(document: Document, image_size: tuple[int, int] | None = None) -> Sequence[Calibration]:
    return parsers.decode(json.dumps(document).encode(), name="transforms.json", image_size=image_size)


def read(document: Document) -> Calibration:
    [calibration] = decoded(document)
    return calibration


def rays() -> Array:
    u, v = np.meshgrid(np.linspace(-0.69, 0.69, 25), np.linspace(-0.39, 0.39, 25))
    return np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])


def by_opencv(c: Document, points: Array) -> Array:
    """Nerfstudio takes half a pixel off cx and cy before it calls OpenCV, and adds it again afterwards."""
    K = np.array([[c["fl_x"], 0, c["cx"] - 0.5], [0, c["fl_y"], c["cy"] - 0.5], [0, 0, 1]])
    zero = np.zeros(3)
    if c.get("camera_model") == "OPENCV_FISHEYE":
        D = np.array([c[f"k{i}"] for i in range(1, 5)])
        seen, _ = cv2.fisheye.projectPoints(points[:, None], zero, zero, K, D)
    else:
        D = np.array([c[name] for name in ("k1", "k2", "p1", "p2")] + [c.get("k3", 0.0)])
        seen, _ = cv2.projectPoints(points, zero, zero, K, D)
    return np.asarray(seen.reshape(-1, 2) + 0.5)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"camera_model": "OPENCV", "k3": 0.0123},
        {"camera_model": "OPENCV_FISHEYE", "k3": 0.0041, "k4": -0.0011, "p1": 0.0, "p2": 0.0},
    ],
    ids=["instant-ngp", "nerfstudio", "fisheye"],
)
def test_a_camera_projects_as_opencv_does_for_nerfstudio(changes: Document) -> None:
    document = ONE | changes
    seen = read(document).project(rays())
    np.testing.assert_allclose(seen, by_opencv(document, rays()), rtol=0, atol=1e-9)


def test_pixels_count_from_the_corner() -> None:
    K = read(ONE).intrinsics
    assert (K.fx, K.fy, K.cx, K.cy, K.image_size) == (1375.52, 1374.49, 965.268, 554.558, (1920, 1080))


def test_instant_ngps_mark_makes_a_fisheye() -> None:
    fisheye = {**ONE, "is_fisheye": True, "p1": 0, "p2": 0, "k3": 0.0041}
    assert read(fisheye).distortion == KannalaBrandt(k1=0.0578, k2=-0.0805, k3=0.0041, k4=0.0)
    assert isinstance(read({**ONE, "is_fisheye": False}).distortion, BrownConrady)


def test_frames_with_their_own_cameras_are_told_apart() -> None:
    left, right = CAMERA, {**CAMERA, "fl_x": 1375.9}
    frames = [{**FRAMES[i], **(right if i == 1 else left)} for i in range(3)]
    found = decoded({"camera_model": "OPENCV", "frames": frames})
    assert [item.camera.sub_camera for item in found] == ["images/0.jpg", "images/1.jpg"]
    assert [item.intrinsics.fx for item in found] == [1375.52, 1375.9]
    assert [item.quality.views for item in found if item.quality] == [2, 1]


def test_what_frames_leave_out_is_said_above_them() -> None:
    shared = {key: CAMERA[key] for key in ("w", "h", "k1", "k2", "p1", "p2")}
    own = {key: CAMERA[key] for key in ("fl_x", "fl_y", "cx", "cy")}
    document = {**shared, "frames": [{**frame, **own} for frame in FRAMES]}
    assert read(document).intrinsics == read(ONE).intrinsics


def test_a_number_said_twice_differently_is_not_chosen_from() -> None:
    document = {**CAMERA, "frames": [{**FRAMES[0], "fl_x": 1380.0}]}
    with pytest.raises(ParseError, match=r"frames\[0\].*fl_x is 1380 here and 1375\.52 above"):
        read(document)
    assert read({**CAMERA, "frames": [{**FRAMES[0], "fl_x": 1375.52}]}).intrinsics.fx == 1375.52


@pytest.mark.parametrize("frames", [None, [{**FRAMES[0], "h": 1080}]])
def test_a_size_with_one_side_names_the_other(frames: list[dict[str, Any]] | None) -> None:
    document = {key: value for key, value in CAMERA.items() if key not in {"w", "h"}}
    document |= {"frames": frames} if frames else {"frames": FRAMES, "h": 1080}
    with pytest.raises(ParseError, match="it states no w"):
        decoded(document)


def test_a_blender_file_has_a_field_of_view_and_no_size() -> None:
    document = {"camera_angle_x": 0.6911, "frames": FRAMES}
    with pytest.raises(MissingTagError, match="--image-size"):
        decoded(document)
    [item] = decoded(document, image_size=(800, 600))
    K = item.intrinsics
    assert K.fx == K.fy == pytest.approx(400 / math.tan(0.6911 / 2))
    assert (K.cx, K.cy) == (400, 300)
    assert item.grade is Grade.DESIGN
    assert item.distortion == NoDistortion()
    assert len(item.provenance.assumptions) == 3


def test_each_side_may_have_its_field_of_view() -> None:
    document = {"w": 1920, "h": 1080, "frames": FRAMES, **ANGLES}
    K = read(document).intrinsics
    assert (K.fx, K.fy) == pytest.approx((1375.52, 1374.49), rel=1e-12)
    assert read({**ONE, **ANGLES}).notes == ()


def test_a_field_of_view_that_contradicts_the_focal_length_is_pointed_out() -> None:
    item = read({**ONE, **ANGLES, "camera_angle_x": 0.9})
    assert item.intrinsics.fx == 1375.52
    assert "camera_angle_x is 0.9" in item.notes[0]


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"camera_model": "EQUIRECTANGULAR"}, "EQUIRECTANGULAR"),
        ({"camera_model": "FISHEYE624"}, "FISHEYE624"),
        ({"is_latlong": True}, "is_latlong"),
        ({"ftheta_p0": 0.1}, "ftheta_p0"),
        ({"k4": 0.001}, "two meanings"),
        ({"camera_model": "OPENCV_FISHEYE"}, "no tangential terms"),
    ],
)
def test_what_has_no_counterpart_is_refused_by_name(changes: Document, named: str) -> None:
    with pytest.raises(UnsupportedModelError, match=named):
        read(ONE | changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fl_x": 0}, "focal lengths"),
        ({"fl_x": "x"}, "not a number"),
        ({"w": 0}, "image size"),
        ({"k1": None}, "expected a number"),
        ({"frames": {}}, "expected a list"),
        ({"camera_model": "OPENCV", "is_fisheye": True}, "remove the wrong one"),
    ],
    ids=str,
)
def test_a_broken_file_names_what_is_wrong(changes: Document, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parsers.decode(json.dumps(ONE | changes).encode(), name="t.json", format="transforms_json")


def test_a_field_of_view_in_degrees_is_noticed() -> None:
    with pytest.raises(ParseError, match="radians"):
        read({"w": 800, "h": 800, "camera_angle_x": 39.6, "frames": FRAMES})


def test_frames_without_any_focal_length_are_refused() -> None:
    with pytest.raises(MissingTagError, match="neither fl_x nor camera_angle_x"):
        read({"w": 800, "h": 800, "frames": FRAMES})


def test_what_is_not_of_the_camera_survives() -> None:
    document = {**ONE, "aabb_scale": 4, "applied_transform": [[1, 0], [0, 1]], "ply_file_path": "a b.ply"}
    data, verdict = parsers.encode([read(document)], "transforms_json")
    assert verdict.dropped == ("number of views",)
    again = json.loads(data)
    assert {key: again[key] for key in ("aabb_scale", "applied_transform", "ply_file_path")} == {
        "aabb_scale": 4, "applied_transform": [[1, 0], [0, 1]], "ply_file_path": "a b.ply",
    }  # fmt: skip
    assert {key: again[key] for key in CAMERA} == CAMERA


def test_what_another_format_kept_by_name_is_not_written() -> None:
    item = replace(camera(BROWN), extras=(("kalibr/rostopic", '"/cam0"'), ("transforms_json/scale", "1.0")))
    document = json.loads(parsers.encode([item], "transforms_json")[0])
    assert "kalibr/rostopic" not in document
    assert document["scale"] == 1.0


def test_several_cameras_stand_in_a_frame_each() -> None:
    pair = [replace(camera(BROWN), camera=CameraKey(image_size=SIZE, sub_camera=name)) for name in "ab"]
    data, _ = parsers.encode(pair, "transforms_json")
    document = json.loads(data)
    assert [frame["file_path"] for frame in document["frames"]] == ["a", "b"]
    assert document["camera_model"] == "OPENCV"
    assert "fl_x" not in document


def test_a_fisheye_cannot_share_a_file_with_another_camera() -> None:
    fisheye = camera(KannalaBrandt(k1=0.03, k2=-0.007, k3=0.004, k4=-0.001))
    data, verdict = parsers.encode([fisheye], "transforms_json")
    assert (json.loads(data)["camera_model"], json.loads(data)["is_fisheye"]) == ("OPENCV_FISHEYE", True)
    assert not verdict.fits[0].max_px
    with pytest.raises(UnsupportedModelError, match="two files"):
        parsers.encode([fisheye, camera(BROWN)], "transforms_json")


@pytest.mark.parametrize(
    ("lens", "read_as"),
    [
        (
            {"distortion_model": "plumb_bob", "D": [-0.11, 0.02, 0.0002, -0.0004, 0.003]},
            {"k1": -0.11, "k3": 0.003},
        ),
        ({"K1": -0.11, "K2": 0.02}, {"k1": -0.11, "k2": 0.02}),
        (
            {"distortion": {"radial": [-0.11, 0.02], "tangential": [0.0002, -0.0004]}},
            {"k1": -0.11, "p2": -0.0004},
        ),
        (
            {"distortion": {"model": "plumb_bob", "D": [-0.11, 0.02, 0.0002, -0.0004]}},
            {"k1": -0.11, "p1": 0.0002},
        ),
        ({"dist": [-0.11, 0.02, 0.0002, -0.0004]}, {"k1": -0.11, "p1": 0.0002}),  # its camera_model is OPENCV
    ],
)
def test_a_lens_under_other_names_is_read(lens: Document, read_as: dict[str, float]) -> None:
    head = {key: CAMERA[key] for key in ("w", "h", "fl_x", "fl_y", "cx", "cy")}
    found = read({"camera_model": "OPENCV", **head, **lens, "frames": []})
    assert isinstance(found.distortion, BrownConrady)
    assert {name: found.distortion.coefficients[name] for name in read_as} == read_as
    [again] = parsers.decode(parsers.encode([found], "transforms_json")[0], name="transforms.json")
    assert again.distortion == found.distortion


def test_a_fisheye_under_other_names_is_read_where_its_model_is_named() -> None:
    head = {key: CAMERA[key] for key in ("w", "h", "fl_x", "fl_y", "cx", "cy")}
    found = read({**head, "distortion_model": "equidistant", "D": [0.1, 0.2, 0.3, 0.4], "frames": []})
    assert found.distortion == KannalaBrandt(k1=0.1, k2=0.2, k3=0.3, k4=0.4)
    bare = read({**head, "D": [0.1, 0.2, 0.3, 0.4], "frames": []})
    assert bare.distortion is None
