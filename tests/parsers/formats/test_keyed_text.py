"""Keyed sheets: one meaning, or a message that says which word is missing."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Grade, Quality
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt, NoDistortion, Rational
from calibrary.errors import MissingTagError, ParseError, UnknownFormatError, UnsupportedModelError
from calibrary.parsers.content import Content
from calibrary.parsers.reading import identified
from calibrary.records import replace
from tests.parsers.cameras import BROWN, SIZE, camera

PIXELS = """\
# Calibration certificate 17
image_width = 5472
image_height = 3648
fx_px = 3650.1
fy_px = 3648.7
cx_px = 2741.3
cy_px = 1815.9
k1 = -0.1131
k2 = 0.0247
p1 = -0.00037
p2 = 0.00081
k3 = -0.0062
"""
METRIC = """\
; a laboratory's sheet
[camera]
Model: X-20
Serial number: 0042
Image size: 5472 x 3648
Pixel pitch [µm]: 2.41
[lens]
Focal length: 8.7969 mm   ; at infinity
principal_point_x_mm: 6.6065
principal_point_y_mm: 4.3763
distortion_model: brown
k1: -0.1131
"""


def read(text: str, *, image_size: tuple[int, int] | None = None, **options: str) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="x.cal", image_size=image_size, options=options)
    return calibration


def test_pixels_project_as_opencv_does() -> None:
    calibration = read(PIXELS)
    u, v = np.meshgrid(np.linspace(-0.6, 0.6, 15), np.linspace(-0.4, 0.4, 15))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    K = np.array([[3650.1, 0, 2741.3], [0, 3648.7, 1815.9], [0, 0, 1]])
    D = np.array([-0.1131, 0.0247, -0.00037, 0.00081, -0.0062])
    seen = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(calibration.project(rays), seen + 0.5, rtol=0, atol=1e-9)
    assert calibration.grade is Grade.CALIBRATED
    assert any(
        "centre of the top-left pixel was taken" in item for item in calibration.provenance.assumptions
    )


def test_millimetres_become_pixels_through_the_pitch() -> None:
    calibration = read(METRIC)
    K = calibration.intrinsics
    assert K.fx == K.fy == pytest.approx(8.7969 / 0.00241, rel=1e-15)
    assert (K.cx, K.cy) == pytest.approx((6.6065 / 0.00241, 4.3763 / 0.00241), rel=1e-15)
    assert calibration.distortion == BrownConrady(k1=-0.1131, k2=0, p1=0, p2=0)
    assert calibration.camera.model == "X-20"
    assert calibration.extras == (("hand_made/Serial number", '"0042"'),)


def test_or_through_the_sensors_size() -> None:
    text = METRIC.replace("Pixel pitch [µm]: 2.41", "sensor_width_mm = 13.18752")
    assert read(text).intrinsics.fx == pytest.approx(8.7969 / 0.00241, rel=1e-12)
    both = METRIC.replace("Pixel pitch [µm]: 2.41", "sensor size = 13.2 mm x 8.8 mm")
    assert read(both).intrinsics.fy == pytest.approx(8.7969 * 5472 / 13.2, rel=1e-12)


@pytest.mark.parametrize(
    "line",
    [
        "focal_length_mm = 8.7969", "Focal Length (mm): 8.7969", "focalLength [mm] = 8.7969",
        "calibrated focal length = 8.7969mm", "camera constant = 8796.9 µm", "focal-length-mm: 8.7969  # fixed",
    ],
)  # fmt: skip
def test_a_key_may_be_spelt_in_many_ways(line: str) -> None:
    text = METRIC.replace("Focal length: 8.7969 mm   ; at infinity", line)
    assert read(text).intrinsics.fx == pytest.approx(8.7969 / 0.00241, rel=1e-12)


@pytest.mark.parametrize(
    ("was", "is_now", "message"),
    [
        ("fx_px = 3650.1", "fx = 8.8", "no unit.*--set unit=px"),
        ("fx_px = 3650.1\n", "", "fx and fy.*found fy"),
        ("fx_px = 3650.1\nfy_px = 3648.7\n", "", "no focal length"),
        ("cy_px = 1815.9\n", "", "principal point"),
        ("fx_px = 3650.1\nfy_px = 3648.7", "focal_length_mm = 8.8", "pixel_pitch_um"),
        ("fx_px = 3650.1", "fx_px = 3650,1", "decimal point"),
        ("fx_px = 3650.1", "fx_px = 3.6501 mm", "in px and in mm"),
        ("fx_px = 3650.1", "fx [furlong] = 3.6501", "furlong"),
        ("fx_px = 3650.1", "fx_px = nan", "not finite"),
        ("image_height = 3648\n", "", "only one"),
        ("image_width = 5472", "image_width = 13.2 mm", "sensor_width_mm"),
        ("k1 = -0.1131", "k1 = -0.1131\nK1 = 0.2", "means the same"),
        ("k1 = -0.1131", "k4 = -0.1131", "k1 is not stated"),
        ("k1 = -0.1131", "and so on", "k1 is not stated"),
        ("cx_px = 2741.3", "cx_px = 5.3", "principal_point_origin"),
        ("k3 = -0.0062\n", "k3 = -0.0062", "not ended"),
        ("k3", "grade = superb\nk3", "not a grade"),
        ("k3", "fx: 9650.1 px\nk3", "means the same"),
        ("k3", "y_axis = sideways\nk3", "down or up"),
        ("k3", "image_size = 4000x3000\nk3", "two image sizes"),
    ],
)
def test_what_is_missing_or_wrong_is_named(was: str, is_now: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parsers.decode(PIXELS.replace(was, is_now, 1).encode(), name="x.cal", format="keyed_text")


def test_the_image_size_is_asked_for() -> None:
    text = PIXELS.replace("image_width = 5472\nimage_height = 3648\n", "")
    with pytest.raises(MissingTagError, match="--image-size"):
        read(text)
    assert read(text, image_size=SIZE).intrinsics == read(PIXELS).intrinsics


def test_a_pitch_and_a_sensor_that_disagree_are_refused() -> None:
    with pytest.raises(ParseError, match="contradict"):
        read(METRIC + "sensor_width_mm = 17.3\n")


def test_coefficients_beside_millimetres_need_their_model() -> None:
    text = METRIC.replace("distortion_model: brown\n", "")
    with pytest.raises(ParseError, match="per mm²"):
        read(text)
    assert read(text, distortion="brown").distortion == read(METRIC).distortion


def test_coefficients_with_a_unit_are_refused() -> None:
    with pytest.raises(UnsupportedModelError, match="lengths on the sensor"):
        read(METRIC.replace("k1: -0.1131", "k1 [mm^-2]: -0.00113"))


def test_a_term_that_nobody_knows_is_not_lost() -> None:
    with pytest.raises(ParseError, match="b1"):
        read(PIXELS + "b1 = 0.0002\n")
    assert read(PIXELS + "b1 = 0.000\n").distortion == BROWN


def test_a_unit_may_be_given_by_the_caller() -> None:
    text = "".join(row.replace("_px", "") + "\n" for row in PIXELS.splitlines())
    small = text.replace("3650.1", "250.1").replace("3648.7", "248.7")
    small = "".join(row for row in small.splitlines(keepends=True) if row[0] not in "kp")
    with pytest.raises(ParseError, match="unit"):
        read(small)
    [named] = parsers.decode(small.encode(), name="x.cal", format="keyed_text", options={"unit": "px"})
    assert named.intrinsics.fx == 250.1
    assert read(text, unit="px").intrinsics == read(PIXELS).intrinsics


@pytest.mark.parametrize("sign", ["=", ":"])
def test_plain_names_without_a_unit_are_pixels_where_millimetres_are_impossible(sign: str) -> None:
    text = "".join(row.replace("_px", "").replace("=", sign) + "\n" for row in PIXELS.splitlines())
    calibration = read(text)
    assert (calibration.intrinsics, calibration.distortion) == (read(PIXELS).intrinsics, BROWN)
    with pytest.raises(ParseError, match="no unit"):
        read(text + f"pixel pitch {sign} 2.4 um\n")


def test_an_offset_needs_to_know_which_way_y_grows() -> None:
    text = PIXELS.replace("cx_px = 2741.3", "cx_px = 5.3").replace("cy_px = 1815.9", "cy_px = 8.1")
    text += "principal_point_origin = image centre\n"
    with pytest.raises(ParseError, match="y_axis"):
        read(text)
    assert read(text + "y_axis = down\n").intrinsics.cy == 1824 + 8.1
    up = read(text, y_axis="up")
    assert (up.intrinsics.cx, up.intrinsics.cy) == (2736 + 5.3, 1824 - 8.1)
    assert up.distortion == replace(BROWN, p1=0.00037)


@pytest.mark.parametrize(
    ("origin", "centre"),
    [("corner", (2741.3, 1815.9)), ("pixel-centre", (2741.8, 1816.4)), ("Pixel center", (2741.8, 1816.4))],
)
def test_the_origin_is_taken_at_the_sheets_word(origin: str, centre: tuple[float, float]) -> None:
    K = read(PIXELS + f"principal_point_origin = {origin}\n").intrinsics
    assert (K.cx, K.cy) == centre


@pytest.mark.parametrize(
    ("lines", "lens"),
    [
        ("", None),
        ("distortion_model = none\n", NoDistortion()),
        ("k1 = 0\nk2 = 0\n", NoDistortion()),
        ("distortion_model = equidistant\nk1 = 0\n", KannalaBrandt(k1=0, k2=0, k3=0, k4=0)),
        ("k1 = 0.01\nk2 = 0.02\n", BrownConrady(k1=0.01, k2=0.02, p1=0, p2=0)),
        ("distortion model: fisheye\nk1 = 0.1\nk2 = 0.01\n", KannalaBrandt(k1=0.1, k2=0.01, k3=0, k4=0)),
        ("distortion_model=rational\nk1=.3\nk2=0\np1=0\np2=0\nk3=0\nk4=.4\nk5=.02\nk6=0\n",
         Rational(k1=0.3, k2=0, p1=0, p2=0, k3=0, k4=0.4, k5=0.02, k6=0)),
    ],
    ids=["unknown", "none", "zeros", "equidistant", "brown", "fisheye", "rational"],
)  # fmt: skip
def test_the_model_is_the_stated_one_or_beyond_doubt(lines: str, lens: Distortion | None) -> None:
    assert read(PIXELS.partition("k1")[0] + lines).distortion == lens


def test_a_lens_where_a_cameras_name_stands_is_its_lens() -> None:
    found = read(PIXELS.partition("k1")[0] + "camera_model: fisheye\nk1 = 0.1\nk2 = 0.01\n")
    assert found.distortion == KannalaBrandt(k1=0.1, k2=0.01, k3=0, k4=0)
    assert found.camera.model is None
    for other, why in (("fisheye", "has no p1"), ("double sphere", "camera_model"), ("omni", "camera_model")):
        with pytest.raises(UnsupportedModelError, match=why):
            read(PIXELS.partition("k1")[0] + f"camera_model: {other}\nk1 = 0.1\np1 = 0.01\n")


def test_a_model_without_coefficients_is_refused() -> None:
    with pytest.raises(ParseError, match="no coefficient of brown"):
        read(PIXELS.partition("k1")[0] + "distortion_model = brown\n")


def test_a_model_that_has_no_such_coefficient_is_refused() -> None:
    with pytest.raises(UnsupportedModelError, match="brown model has no k4"):
        read(PIXELS + "k4 = 0.1\ndistortion_model = brown\n")
    with pytest.raises(ParseError, match="s1"):
        read(PIXELS + "s1 = 0.1\n")
    with pytest.raises(UnsupportedModelError, match="splines"):
        read(PIXELS + "distortion_model = splines\n")


def test_sections_divide_a_sheet_of_one_camera_and_name_several() -> None:
    head, own = PIXELS.partition("fx_px")[::2]
    assert read(f"{head}[lens]\nfx_px{own}").intrinsics == read(PIXELS).intrinsics
    text = f"{head}[wide]\nfx_px{own}[tele]\nfx_px{own}"
    wide, tele = parsers.decode(text.encode(), name="x.cal")
    assert (wide.camera.sub_camera, tele.camera.sub_camera) == ("wide", "tele")
    assert wide.intrinsics == tele.intrinsics == read(PIXELS).intrinsics
    with pytest.raises(UnsupportedModelError, match="one camera"):
        parsers.encode([camera(), camera()], "keyed_text")


def test_what_is_known_of_the_camera_goes_there_and_back() -> None:
    key = CameraKey(make="Acme", model='X "20"#3', lens="f/2;8.8 mm", firmware="01.02", sub_camera="wide",
                    image_size=SIZE)  # fmt: skip
    original = replace(
        camera(skew=-2.3), camera=key, grade=Grade.ADJUSTED, quality=Quality(rms_px=0.31, points=812, views=21),
        extras=(("keyed_text/Serial number", '"0042"'),),
    )  # fmt: skip
    data, verdict = parsers.encode([original], "keyed_text")
    copy = read(data.decode())
    assert str(verdict) == "exact (0.000 px)"
    assert (copy.camera, copy.quality, copy.grade, copy.extras) == (
        key, original.quality, original.grade, original.extras,
    )  # fmt: skip
    assert (copy.intrinsics, copy.distortion) == (original.intrinsics, original.distortion)


def test_a_zed_cameras_own_sections_are_left_to_its_own_format() -> None:
    text = b"[LEFT_CAM_2K]\nfx=1057.3\nfy=1056.9\ncx=1100.1\ncy=620.3\nk1=0\nk2=0\n"
    assert identified(Content(text, "SN.conf")).format.name == "zed"


@pytest.mark.parametrize(
    "text",
    [
        "%YAML:1.0\n---\nfx: 1.0\n",
        "cam0:\n  fx: 3650.1 px\n",
        "name = x\nvalue = 3\n",
    ],
)
def test_other_texts_are_not_claimed(text: str) -> None:
    with pytest.raises(UnknownFormatError):
        parsers.decode(text.encode(), name="x.cal")


@pytest.mark.parametrize("model", ["X # 3", " X", "X\ny"])
def test_a_text_that_would_not_read_back_is_left_out_and_named(model: str) -> None:
    original = replace(camera(), camera=CameraKey(model=model, image_size=SIZE))
    data, verdict = parsers.encode([original], "keyed_text")
    assert read(data.decode()).camera.model is None
    assert verdict.dropped == ("model",)


def test_date_tool_operator_and_focus_are_the_sheets() -> None:
    text = (
        PIXELS + "Calibrated on: 14 May 2019\nsoftware = Solver 3\ncalibrated by: A. Lab\nfocus: infinity\n"
    )
    origin = read(text).provenance
    assert (origin.date, origin.tool, origin.operator, origin.focus) == (
        "2019-05-14",
        "Solver 3",
        "A. Lab",
        "infinity",
    )


VECTORS = """\
image size: 1280 x 720
camera_matrix = [1000.5, 0, 640.25, 0, 1001.5, 360.75, 0, 0, 1]
"""


@pytest.mark.parametrize(
    "lens",
    [
        "dist_coeffs = [-0.1131, 0.0247, 0.0002, -0.0004, 0]",
        "distortion = -0.1131 0.0247 0.0002 -0.0004 0",
        "radial = -0.1131 0.0247\ntangential = 0.0002 -0.0004",
        "D: -0.1131, 0.0247, 0.0002, -0.0004\ndistortion_model: brown",
    ],
)
def test_a_matrix_and_a_vector_are_opencvs(lens: str) -> None:
    found = read(f"{VECTORS}{lens}\n")
    K = found.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (1000.5, 1001.5, 640.75, 361.25)
    assert found.distortion == BrownConrady(k1=-0.1131, k2=0.0247, p1=0.0002, p2=-0.0004)


def test_a_vector_of_four_needs_its_model() -> None:
    text = f"{VECTORS}D = 0.1 0.02 0.003 0.004\n"
    with pytest.raises(ParseError, match="--set distortion=brown or distortion=fisheye"):
        read(text)
    assert read(f"{text}distortion_model = fisheye\n").distortion == KannalaBrandt(
        k1=0.1, k2=0.02, k3=0.003, k4=0.004
    )
