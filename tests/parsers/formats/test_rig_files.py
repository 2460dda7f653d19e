"""Azure Kinect, Qualisys and Calibu: cameras of devices and rigs, against OpenCV."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import FieldOfView, KannalaBrandt, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample


def kinect(
    parameters: list[float], location: str = "PV0", width: int = 4096, height: int = 3072
) -> dict[str, Any]:
    return {
        "Intrinsics": {
            "ModelParameterCount": 14, "ModelParameters": parameters,
            "ModelType": "CALIBRATION_LensDistortionModelBrownConrady",
        },
        "Location": f"CALIBRATION_CameraLocation{location}", "SensorWidth": width, "SensorHeight": height,
    }  # fmt: skip


COLOUR = [
    0.4987,
    0.5021,
    0.4782,
    0.6374,
    0.5844,
    -0.4942,
    0.1603,
    0.4648,
    -0.3362,
    0.1012,
    0,
    0,
    -0.000177,
    0.000653,
]
KINECT = {"CalibrationInformation": {"Cameras": [kinect(COLOUR[:], "D0", 1024, 1024), kinect(COLOUR)]}}
QUALISYS = """<?xml version="1.0" encoding="UTF-8"?>
<calibration created="today" type="regular">
  <cameras>
    <camera active="1" serial="26580" model="Miqus Video" viewrotation="90">
      <transform x="4263.3" y="2283.8" z="1794.3" r11="1"/>
      <intrinsic focallength="9.27" sensorMinU="0.000000" sensorMaxU="122879.000000" sensorMinV="0.000000"
        sensorMaxV="69631.000000" focalLengthU="107872.609375" focalLengthV="107880.257813"
        centerPointU="60827.273438" centerPointV="32684.021484" skew="0" radialDistortion1="-0.045450"
        radialDistortion2="0.139604" radialDistortion3="0.010000" tangentalDistortion1="0.000615"
        tangentalDistortion2="-0.000391"/>
    </camera>
    <camera active="0" serial="1"/>
  </cameras>
</calibration>
"""
CALIBU = """<rig>
    <camera>
        <camera_model name="" index="0" serialno="0" type="calibu_fu_fv_u0_v0_k1_k2_k3" version="8">
            <width> 752 </width>
            <height> 480 </height>
            <right> [ 1; 0; 0 ] </right>
            <params> [  433.2;  432.9;  371.6;  238.3;  -0.2131; 4.47e-02;  0.0062 ] </params>
        </camera_model>
        <pose><T_wc> [ 1, 0, 0, 0; 0, 1, 0, 0; 0, 0, 1, 0 ] </T_wc></pose>
    </camera>
</rig>
"""
THEIA_LENS = {
    "camera_intrinsics_type": "PINHOLE_RADIAL_TANGENTIAL", "radial_distortion_coeffs": [-0.2131, 0.0447, 0.0062],
    "tangential_distortion_coeffs": [-0.00037, 0.00081],
}  # fmt: skip


def prior(name: str, **changes: Any) -> dict[str, Any]:
    fields = {
        "image_name": name, "focal_length": 433.2, "width": 752, "height": 480, "principal_point": [371.6, 238.3],
        "aspect_ratio": 432.9 / 433.2, "skew": 0.0, **THEIA_LENS, **changes,
    }  # fmt: skip
    return {"CameraIntrinsicsPrior": {key: value for key, value in fields.items() if value is not None}}


THEIA = {"priors": [prior("a.jpg"), prior("b.jpg"), prior("c.jpg", focal_length=500.0)]}
SAMPLES = {
    "theia_priors": Sample(json.dumps(THEIA).encode()),
    "azure_kinect": Sample(json.dumps(KINECT).encode()),
    "qualisys": Sample(QUALISYS.encode()),
    "calibu": Sample(CALIBU.encode()),
}


def read(document: object) -> Sequence[Calibration]:
    text = document if isinstance(document, str) else json.dumps(document)
    return parsers.decode(text.encode(), name="rig")


def test_a_kinects_colour_camera_is_opencvs_rational_model() -> None:
    depth, colour = read(KINECT)
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1 = COLOUR
    # The SDK: cx·width − 0.5, from the centre of the first pixel.
    K = (fx * 4096, fy * 3072, cx * 4096 - 0.5, cy * 3072 - 0.5)
    assert_projects_as_opencv(colour, K, (k1, k2, p1, p2, k3, k4, k5, k6))
    assert (depth.camera.sub_camera, depth.intrinsics.image_size) == ("D0", (1024, 1024))
    assert "whole sensor" in colour.notes[0]


def test_a_kinects_other_models_are_refused() -> None:
    moved = [*COLOUR[:10], 0.01, 0.0, *COLOUR[12:]]
    with pytest.raises(UnsupportedModelError, match="centre of its own"):
        read({"CalibrationInformation": {"Cameras": [kinect(moved)]}})
    other = json.dumps(KINECT).replace("BrownConrady", "Rational6KT")
    with pytest.raises(UnsupportedModelError, match="LensDistortionModelRational6"):
        read(other)
    with pytest.raises(ParseError, match=r"ModelParameters\[4:\]: 9 numbers, expected 10"):
        read({"CalibrationInformation": {"Cameras": [kinect(COLOUR[1:])]}})


def test_qualisys_counts_in_64ths_of_a_pixel() -> None:
    [item] = read(QUALISYS)
    K = (107872.609375 / 64, 107880.257813 / 64, 60827.273438 / 64 - 0.5, 32684.021484 / 64 - 0.5)
    assert_projects_as_opencv(item, K, (-0.04545, 0.139604, 0.000615, -0.000391, 0.01))
    assert item.intrinsics.image_size == (1920, 1088)
    assert "not publish" in item.provenance.assumptions[0]
    assert "90°" in item.notes[-1]
    theia = read(QUALISYS.replace("122879", "122880").replace("69631", "69632"))[0]
    assert theia.intrinsics.image_size == (1920, 1088)


@pytest.mark.parametrize(
    ("old", "new", "kind", "match"),
    [
        ('skew="0"', 'skew="3"', UnsupportedModelError, "skew"),
        ('focalLengthU="107872.609375"', "", ParseError, "no 'focalLengthU'"),
        ('sensorMaxU="122879.000000"', 'sensorMaxU="-5"', ParseError, "image size"),
        ("</cameras>", '<camera serial="26580"><intrinsic/></camera></cameras>', ParseError, "same serial"),
    ],
)
def test_a_broken_qualisys_file_names_what_is_wrong(
    old: str, new: str, kind: type[Exception], match: str
) -> None:
    with pytest.raises(kind, match=match):
        read(QUALISYS.replace(old, new))


def test_calibus_polynomial_is_opencvs_radial_part() -> None:
    [item] = read(CALIBU)
    assert_projects_as_opencv(item, (433.2, 432.9, 371.6, 238.3), (-0.2131, 0.0447, 0, 0, 0.0062))
    assert "does not state" in item.provenance.assumptions[0]


@pytest.mark.parametrize(
    ("kind", "rest", "lens"),
    [
        ("calibu_fu_fv_u0_v0", "", NoDistortion()),
        ("calibu_fu_fv_u0_v0_w", "; 0.92", FieldOfView(omega=0.92)),
        ("calibu_fu_fv_u0_v0_kb4", "; 0.1; 0.2; 0.3; 0.4", KannalaBrandt(k1=0.1, k2=0.2, k3=0.3, k4=0.4)),
    ],
)
def test_calibus_type_lists_the_parameters(kind: str, rest: str, lens: object) -> None:
    text = CALIBU.replace("calibu_fu_fv_u0_v0_k1_k2_k3", kind).replace(";  -0.2131; 4.47e-02;  0.0062", rest)
    assert read(text)[0].distortion == lens


@pytest.mark.parametrize(
    ("old", "new", "kind", "match"),
    [
        ("_k1_k2_k3", "_rational6", UnsupportedModelError, "rational6"),
        ("0.0062 ]", "]", ParseError, "2 numbers, expected 3"),
        ("<width> 752 </width>", "", ParseError, "there is no 'width'"),
    ],
)
def test_a_broken_rig_names_what_is_wrong(old: str, new: str, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        read(CALIBU.replace(old, new))


def test_theias_priors_are_opencvs_and_read_once_for_each_camera() -> None:
    first, second = read(THEIA)
    assert_projects_as_opencv(
        first, (433.2, 432.9, 371.6, 238.3), (-0.2131, 0.0447, -0.00037, 0.00081, 0.0062)
    )
    assert [item.camera.sub_camera for item in (first, second)] == ["a.jpg", "c.jpg"]


def test_an_image_without_a_focal_length_is_left_out_and_counted() -> None:
    bare = prior("d.jpg")
    del bare["CameraIntrinsicsPrior"]["focal_length"]
    first, _ = read({"priors": [bare, *THEIA["priors"]]})
    assert first.provenance.tag == "a.jpg"
    assert any("1 of 4 images state no focal length" in note for note in first.notes)
    with pytest.raises(ParseError, match="there is no 'focal_length'"):
        read({"priors": [bare]})


@pytest.mark.parametrize(
    ("changes", "lens"),
    [
        ({"camera_intrinsics_type": "FISHEYE", "radial_distortion_coeffs": [0.1, 0.2, 0.3, 0.4]},
         KannalaBrandt(k1=0.1, k2=0.2, k3=0.3, k4=0.4)),
        ({"camera_intrinsics_type": "FOV", "radial_distortion_coeffs": [0.92]}, FieldOfView(omega=0.92)),
        ({"camera_intrinsics_type": "PINHOLE", "radial_distortion_coeffs": None, "tangential_distortion_coeffs": None},
         NoDistortion()),
    ],
)  # fmt: skip
def test_theias_other_models(changes: dict[str, Any], lens: object) -> None:
    assert read({"priors": [prior("a.jpg", **changes)]})[0].distortion == lens


@pytest.mark.parametrize(
    ("changes", "kind", "match"),
    [
        ({"camera_intrinsics_type": "DIVISION_UNDISTORTION"}, UnsupportedModelError, "DIVISION"),
        ({"camera_intrinsics_type": "FISHEYE"}, ParseError, "3 numbers, expected 4"),
        ({"principal_point": None}, ParseError, "no 'principal_point'"),
    ],
)
def test_a_broken_prior_names_what_is_wrong(
    changes: dict[str, Any], kind: type[Exception], match: str
) -> None:
    with pytest.raises(kind, match=match):
        read({"priors": [prior("a.jpg", **changes)]})
