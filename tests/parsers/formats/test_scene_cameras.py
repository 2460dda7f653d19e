"""The cameras of scenes and data sets: pinholes in JSON and text, each against the K of its program's own reader."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.errors import MissingTagError, ParseError, UnknownFormatError, UnsupportedModelError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample

SIZE = (752, 480)
RECORD3D: dict[str, Any] = {
    "w": 752, "h": 480, "dw": 192, "dh": 256, "fps": 60, "K": [433.2, 0, 0, 0, 432.9, 0, 371.6, 238.3, 1],
    "perFrameIntrinsicCoeffs": [[433.2, 432.9, 371.6, 238.3], [430.1, 429.8, 371.6, 238.3]],
    "poses": [[0, 0, 0, 1, 0, 0, 0]],
}  # fmt: skip
PINHOLE: dict[str, Any] = {"fx": 433.2, "fy": 432.9, "cx": 371.6, "cy": 238.3, "width": 752, "height": 480}
POLYCAM = {**PINHOLE, "t_00": 1.0, "t_01": 0.0, "blur_score": 12.5}
SPLATS: list[dict[str, Any]] = [
    {"id": n, "img_name": f"0000{n}", "width": 752, "height": 480, "rotation": [[1, 0, 0]], "fy": 432.9, "fx": fx}
    for n, fx in enumerate((433.2, 433.2, 500.5))
]  # fmt: skip
NSVF = "433.2 371.6 238.3 0.\n0. 0. 0.\n0.\n1.\n480 752\n"
MVSNET = """extrinsic
1.0 0.0 0.0 -191.0
0.0 1.0 0.0 3.3
0.0 0.0 1.0 22.5
0.0 0.0 0.0 1.0

intrinsic
433.2 0 371.6
0 432.9 238.3
0 0 1

425 2.5
"""
SCANNET = """appVersionId = StructureSensorCalibrator/26
colorHeight = 480
colorWidth = 752
depthHeight = 240
depthWidth = 320
fx_color = 433.2
fx_depth = 288.4
fy_color = 432.9
fy_depth = 288.5
mx_color = 371.6
mx_depth = 159.5
my_color = 238.3
my_depth = 119.5
"""
MIDDLEBURY = """cam0=[433.2 0 371.6; 0 433.2 238.3; 0 0 1]
cam1=[433.2 0 402.7; 0 433.2 238.3; 0 0 1]
doffs=31.1
baseline=193.001
width=752
height=480
ndisp=280
"""
NUSCENES: list[dict[str, Any]] = [
    {"token": "a1", "sensor_token": "s1", "camera_intrinsic": [[433.2, 0, 371.6], [0, 432.9, 238.3], [0, 0, 1]]},
    {"token": "b2", "sensor_token": "s2", "camera_intrinsic": []},
]  # fmt: skip
SAMPLES = {
    "record3d": Sample(json.dumps(RECORD3D).encode()),
    "polycam": Sample(json.dumps(POLYCAM).encode()),
    "gaussian_cameras": Sample(json.dumps(SPLATS).encode()),
    "nsvf_intrinsics": Sample(NSVF.encode()),
    "mvsnet_cam": Sample(MVSNET.encode()),
    "named_pinholes": Sample(SCANNET.encode()),
    "nuscenes": Sample(json.dumps(NUSCENES).encode()),
}
CORNER = {"record3d", "polycam", "nsvf_intrinsics", "mvsnet_cam"}


def read(document: object, **named: Any) -> Sequence[Calibration]:
    data = (
        document
        if isinstance(document, bytes)
        else (document if isinstance(document, str) else json.dumps(document)).encode()
    )
    return parsers.decode(data, name="camera", **named)


@pytest.mark.parametrize("name", [name for name in SAMPLES if name != "gaussian_cameras"])
def test_k_is_the_programs_own(name: str) -> None:
    item = read(SAMPLES[name].data, image_size=SIZE if name in {"mvsnet_cam", "nuscenes"} else None)[0]
    offset = 0.0 if name in CORNER else 0.5
    fy = 433.2 if name == "nsvf_intrinsics" else 432.9
    K = item.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == pytest.approx((433.2, fy, 371.6 + offset, 238.3 + offset))
    assert K.image_size == SIZE
    assert item.provenance.assumptions


@pytest.mark.parametrize("name", ["polycam", "nsvf_intrinsics", "mvsnet_cam", "named_pinholes", "nuscenes"])
def test_the_caller_knows_where_it_counts_from(name: str) -> None:
    size = SIZE if name in {"mvsnet_cam", "nuscenes"} else None
    both = [
        read(SAMPLES[name].data, image_size=size, options={"origin": origin})[0]
        for origin in ("corner", "centre")
    ]
    assert both[1].intrinsics.cx - both[0].intrinsics.cx == 0.5
    assert "as the caller says" in both[0].provenance.assumptions[0]


@pytest.mark.parametrize("name", ["mvsnet_cam", "nuscenes"])
def test_the_image_size_is_asked_for(name: str) -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        read(SAMPLES[name].data)


def test_record3d_tells_how_far_its_frames_depart() -> None:
    [item] = read(RECORD3D)
    assert "of the 2 frames is 430.1 to 433.2 px" in item.notes[-1]
    assert item.distortion is None
    assert len(read({**RECORD3D, "perFrameIntrinsicCoeffs": []})[0].notes) == 1


def test_coefficients_by_name_are_opencvs() -> None:
    lens = {"k1": -0.2131, "k2": 0.0447, "p1": -0.00037, "p2": 0.00081, "k3": 0.0062}
    [item] = read({**PINHOLE, **lens})
    assert_projects_as_opencv(
        item, (433.2, 432.9, 371.6, 238.3), (-0.2131, 0.0447, -0.00037, 0.00081, 0.0062)
    )
    with pytest.raises(ParseError, match="fisheye's"):
        read({**PINHOLE, "k1": 0.1, "k2": 0.1, "k3": 0.1, "k4": 0.1})


def test_names_of_a_program_with_a_model_of_its_own_are_left_to_it() -> None:
    with pytest.raises(UnsupportedModelError, match=r"camera_model.*'DS'"):
        read({**PINHOLE, "camera_model": "DS"})


def test_splats_of_one_camera_are_read_once() -> None:
    first, second = read(SPLATS)
    assert [item.camera.sub_camera for item in (first, second)] == ["00000", "00002"]
    # graphdeco: fov2focal, and a projection matrix about the middle of the image.
    assert (first.intrinsics.cx, first.intrinsics.cy, first.intrinsics.fx) == (376, 240, 433.2)
    assert (first.grade, first.distortion) == (Grade.ADJUSTED, NoDistortion())


def test_srn_has_no_near_plane_and_some_files_two_focal_lengths() -> None:
    [item] = read("433.2 432.9 371.6 238.3\n0. 0. 0.\n1.\n480 752\n")
    assert (item.intrinsics.fx, item.intrinsics.fy, item.intrinsics.cx) == (433.2, 432.9, 371.6)


@pytest.mark.parametrize(
    "text", ["433.2,0.7,371.6\n0,432.9,238.3\n0,0,1\n", "[[433.2 0.7 371.6]\n [0 432.9 238.3]\n [0 0 1]]"]
)
def test_a_matrix_is_read_in_any_writing(text: str) -> None:
    [item] = read(text, image_size=SIZE)
    np.testing.assert_allclose(item.intrinsics.matrix[0], [433.2, 0.7, 372.1])
    assert (item.grade, item.distortion) == (Grade.DERIVED, None)


@pytest.mark.parametrize(
    "text",
    [
        "1 0 0\n0 1 0\n0 0 1\n",
        "500 0 320\n0 500 240\n0 0 2\n",
        "500 0 320\n5 500 240\n0 0 1\n",
        "1 2 3 4 5 6 7 8 9\n",
    ],
)
def test_another_matrix_is_not_claimed(text: str) -> None:
    with pytest.raises(UnknownFormatError):
        read(text, image_size=SIZE)


def test_scannet_has_two_cameras_and_middlebury_is_rectified() -> None:
    colour, depth = read(SCANNET)
    assert [item.camera.sub_camera for item in (colour, depth)] == ["color", "depth"]
    assert (depth.intrinsics.image_size, colour.distortion) == ((320, 240), None)
    left, right = read(MIDDLEBURY)
    assert right.intrinsics.cx - left.intrinsics.cx == pytest.approx(31.1)
    assert left.distortion == NoDistortion()


def test_mvsnet_sees_a_pixel_where_its_own_warping_does() -> None:
    """K⁻¹ of the pixels' centres at 0.5, 1.5, …, as ``get_pixel_grids`` has them."""
    [item] = read(MVSNET, image_size=SIZE)
    K = np.array([[433.2, 0, 371.6], [0, 432.9, 238.3], [0, 0, 1]])
    centres = np.array([[0, 0], [100, 30], [751, 479]]) + 0.5
    rays = np.linalg.solve(K, np.column_stack([centres, np.ones(3)]).T).T
    np.testing.assert_allclose(item.project(rays), centres, rtol=0, atol=1e-9)
    assert item.distortion == NoDistortion()


def test_middleburys_disparity_gives_the_depth_by_its_formula() -> None:
    left, right = read(MIDDLEBURY)
    baseline, doffs = 193.001, 31.1
    points = np.array([[10.0, 20.0, 2000.0], [-300.0, 5.0, 3500.0], [400.0, -250.0, 1500.0]])
    disparity = (left.project(points) - right.project(points - [baseline, 0, 0]))[:, 0]
    np.testing.assert_allclose(baseline * 433.2 / (disparity + doffs), points[:, 2], rtol=1e-12)


def test_polycams_camera_is_that_of_the_transforms_json_that_nerfstudio_makes_of_it() -> None:
    """As ``polycam_to_json`` copies the numbers."""
    [item] = read(POLYCAM)
    converted = {
        "camera_model": "OPENCV",
        "frames": [
            {"file_path": "images/frame_00001.jpg", "transform_matrix": np.eye(4).tolist()}
            | {"fl_x": POLYCAM["fx"], "fl_y": POLYCAM["fy"], "cx": POLYCAM["cx"], "cy": POLYCAM["cy"]}
            | {"w": POLYCAM["width"], "h": POLYCAM["height"]}
        ],
    }
    assert read(converted, format="transforms_json")[0].intrinsics == item.intrinsics


def test_record3ds_k_runs_down_the_columns() -> None:
    """As ``record3d_to_json`` takes it."""
    [item] = read(RECORD3D)
    np.testing.assert_array_equal(item.intrinsics.matrix, np.array(RECORD3D["K"]).reshape(3, 3).T)


@pytest.mark.parametrize(
    ("name", "document", "match"),
    [
        ("record3d", {**RECORD3D, "K": [433.2, 0, 371.6, 0, 432.9, 238.3, 0, 0, 1]}, "not a camera matrix"),
        ("gaussian_cameras", [{**SPLATS[0], "fx": "wide"}], "not a number"),
        ("nsvf_intrinsics", NSVF.replace("480 752", "480"), "lines of 4, 3, 1, 1, 1 numbers"),
        ("mvsnet_cam", MVSNET.replace("0 0 1\n\n425 2.5", "0 0"), "8 numbers, expected 9"),
        ("mvsnet_cam", "extrinsic\n1\n", "no lines"),
        ("named_pinholes", SCANNET.replace("fy_color = 432.9\n", ""), "no 'fy_color'"),
        ("named_pinholes", MIDDLEBURY.replace("cam1", "cam0"), "duplicate key"),
        ("nuscenes", [NUSCENES[0], NUSCENES[0]], "duplicate token"),
        ("hand_made", {**PINHOLE, "fx": None}, "empty, expected a number"),
    ],
)  # fmt: skip
def test_a_broken_file_names_what_is_wrong(name: str, document: object, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        read(document, format=name, image_size=SIZE if name in {"mvsnet_cam", "nuscenes"} else None)


def test_brown_is_the_smallest_model_that_holds_the_numbers() -> None:
    assert read({**PINHOLE, "k1": 0.1})[0].distortion == BrownConrady(k1=0.1, k2=0.0, p1=0.0, p2=0.0)
    assert read({**PINHOLE, "k1": 0.0})[0].distortion == NoDistortion()
