"""Simulated cameras: a field of view, or intrinsics, and no direction of the distortion."""

from __future__ import annotations

import math

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.samples import Sample

CAMERA = (
    "<horizontal_fov>1.3962634</horizontal_fov><image><width>400</width><height>300</height></image>{}"
    "<clip><near>0.02</near></clip>"
)
SDF = (
    '<sdf version="1.5"><model name="m"><link name="l"><sensor type="camera" name="front">{}</sensor></link></model>'
    "</sdf>"
)
ONE = SDF.format(f"<camera>{CAMERA.format('')}</camera>")
INTRINSICS = (
    "<lens><intrinsics><fx>277.1</fx><fy>277.4</fy><cx>201.5</cx><cy>149.5</cy><s>0</s></intrinsics></lens>"
)
ZEROS = "<distortion><k1>0.0</k1><k2>0.0</k2><p1>0</p1></distortion>"
SAMPLES = {"gazebo_sdf": Sample(ONE.encode())}


def read(text: str) -> Calibration:
    [item] = parsers.decode(text.encode(), name="robot.sdf")
    return item


@pytest.mark.parametrize("more", ["", ZEROS])
def test_a_field_of_view_is_over_the_width(more: str) -> None:
    item = read(SDF.format(f"<camera>{CAMERA.format(more)}</camera>"))
    K = item.intrinsics
    assert K.fx == K.fy == pytest.approx(200 / math.tan(1.3962634 / 2), abs=1e-12)
    assert (K.cx, K.cy, item.grade, item.distortion) == (200, 150, Grade.DESIGN, NoDistortion())


def test_intrinsics_go_before_the_field_of_view() -> None:
    K = read(SDF.format(f"<camera>{CAMERA.format(INTRINSICS)}</camera>")).intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (277.1, 277.4, 201.5, 149.5)


def test_the_cameras_of_a_pair_are_named() -> None:
    pair = "".join(f'<camera name="{name}">{CAMERA.format("")}</camera>' for name in ("left", "right"))
    found = parsers.decode(SDF.format(pair).encode(), name="robot.sdf")
    assert [item.camera.sub_camera for item in found] == ["left", "right"]


def test_a_robot_contains_them_as_well() -> None:
    sensor = f'<sensor name="s"><camera>{CAMERA.format("")}</camera></sensor>'
    text = f'<robot name="r"><gazebo reference="l">{sensor}</gazebo></robot>'
    assert read(text).intrinsics.image_size == (400, 300)


def test_a_distortion_without_a_direction_is_refused() -> None:
    with pytest.raises(UnsupportedModelError, match=r"k1 is not 0.*direction"):
        read(SDF.format(f"<camera>{CAMERA.format(ZEROS.replace('0.0', '-0.25', 1))}</camera>"))


@pytest.mark.parametrize(
    ("lens", "match"),
    [
        ("<type>stereographic</type>", "stereographic"),
        ("<type>custom</type><custom_function><c1>1.05</c1><fun>tan</fun></custom_function>", "custom"),
        ("<type>gnomonical</type><scale_to_hfov>false</scale_to_hfov>", "scale_to_hfov 'false'"),
        ("<scale_to_hfov>0</scale_to_hfov>", "scale_to_hfov '0'"),
    ],
)
def test_a_lens_that_is_no_pinhole_is_refused(lens: str, match: str) -> None:
    with pytest.raises(UnsupportedModelError, match=match):
        read(SDF.format(f"<camera>{CAMERA.format(f'<lens>{lens}</lens>')}</camera>"))


@pytest.mark.parametrize("sensor", ["wideanglecamera", "wide_angle_camera"])
def test_a_wide_angle_camera_is_refused(sensor: str) -> None:
    with pytest.raises(UnsupportedModelError, match=f"of type {sensor}"):
        read(ONE.replace('type="camera"', f'type="{sensor}"'))


def test_a_gnomonical_lens_is_a_pinhole() -> None:
    lens = "<lens><type>gnomonical</type><scale_to_hfov>true</scale_to_hfov></lens>"
    assert read(SDF.format(f"<camera>{CAMERA.format(lens)}</camera>")).intrinsics == read(ONE).intrinsics


@pytest.mark.parametrize(("p_fx", "agrees"), [("277.1", True), ("300", False)])
def test_a_projection_states_the_same_k(p_fx: str, agrees: bool) -> None:
    numbers = f"<p_fx>{p_fx}</p_fx><p_fy>277.4</p_fy><p_cx>201.5</p_cx><p_cy>149.5</p_cy><tx>0</tx><ty>0</ty>"
    lens = INTRINSICS.replace("</lens>", f"<projection>{numbers}</projection></lens>")
    text = SDF.format(f"<camera>{CAMERA.format(lens)}</camera>")
    if agrees:
        assert read(text).intrinsics.fx == 277.1
    else:
        with pytest.raises(ParseError, match=r"p_fx is 300, and the K .* has 277\.1"):
            read(text)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("1.3962634", "80", "expected radians"),
        ("<width>400</width>", "", "there is no <image/width>"),
        ("<width>400</width>", "<width>0</width>", "image size"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: str, new: str, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        read(ONE.replace(old, new))
