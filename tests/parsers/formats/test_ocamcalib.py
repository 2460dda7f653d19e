"""OCamCalib's file, against the toolbox's cam2world written out here."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion.scaramuzza import Scaramuzza
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.samples import Sample

A = (-325.9, 0.0, 8.6e-4, -3.5e-8, 6.7e-9)
ROW, COLUMN = 261.7, 326.9
TEXT = """\
#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB). These are used by cam2world

5 -325.9 0.0 8.6e-04 -3.5e-08 6.7e-09

#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB). These are used by world2cam

3 407.2 159.7 -53.2

#center: "row" and "column", starting from 0 (C convention)

261.7 326.9

#affine parameters "c", "d", "e"

1.002 0.0014 0.0001

#image size: "height" and "width"

480 640

"""


def read(text: str) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="calib_results.txt")
    return calibration


def cam2world(c: float, d: float, e: float, px: NDArray[np.float64]) -> NDArray[np.float64]:
    """ocam_functions.cpp, in the camera frame of OpenCV: x to the right, y down, z forward."""
    column, row = px.T
    inverse = 1.0 / (c - d * e)
    x = inverse * ((row - ROW) - d * (column - COLUMN))
    y = inverse * (-e * (row - ROW) + c * (column - COLUMN))
    rho = np.hypot(x, y)
    z = A[0] + A[1] * rho + A[2] * rho**2 + A[3] * rho**3 + A[4] * rho**4
    rays = np.column_stack([y, x, -z])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


SAMPLES = {"ocamcalib": Sample(TEXT.encode())}


@pytest.mark.parametrize("affine", [(1.002, 0.0014, 0.0001), (1.0, 0.0, 0.0), (0.997, 0.0, -0.011)])
def test_rays_are_the_toolboxs(affine: tuple[float, float, float]) -> None:
    c, d, e = affine
    calibration = read(TEXT.replace("1.002 0.0014 0.0001", f"{c} {d} {e}"))
    u, v = np.meshgrid(np.linspace(0, 639, 17), np.linspace(0, 479, 13))
    px = np.column_stack([u.ravel(), v.ravel()])
    expected = cam2world(c, d, e, px)
    turn = math.atan2(d, c)
    about_the_axis = np.array(
        [[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]]
    )
    found = calibration.unproject(px + 0.5)
    np.testing.assert_allclose(found, expected @ about_the_axis.T, rtol=0, atol=1e-12)
    np.testing.assert_allclose(calibration.project(found), px + 0.5, rtol=0, atol=1e-9)
    assert bool(calibration.notes) == bool(d)


def test_k_is_that_of_the_axis() -> None:
    calibration = read(TEXT.replace("1.002 0.0014 0.0001", "1.002 0.0 0.0001"))
    K = calibration.intrinsics
    assert (K.fx, K.fy, K.skew) == pytest.approx((325.9, 325.9 * 1.002, 325.9 * 0.0001), rel=1e-14)
    assert (K.cx, K.cy, K.image_size) == (COLUMN + 0.5, ROW + 0.5, (640, 480))
    assert isinstance(calibration.distortion, Scaramuzza)
    assert calibration.extras == (("ocamcalib/invpol", "3 407.2 159.7 -53.2"),)


@pytest.mark.parametrize(
    ("was", "is_now", "error", "message"),
    [
        ("5 -325.9", "5 325.9", ParseError, "backwards"),
        ("5 -325.9", "6 -325.9", ParseError, "5 numbers, expected 6"),
        ("5 -325.9", "900 -325.9", ParseError, "expected 1 to 64"),
        ("-325.9 0.0", "-325.9 0.1", UnsupportedModelError, "linear term"),
        ("5 -325.9 0.0 8.6e-04 -3.5e-08 6.7e-09", "6 -325.9 0 0 0 0 1e-12", UnsupportedModelError, "order 4"),
        ("480 640", "480", ParseError, "1 numbers, expected 2"),
        ("261.7 326.9\n", "", ParseError, "4 rows"),
        ("1.002 0.0014 0.0001", "0 0 0", ParseError, "no image"),
        ("480 640\n\n", "480 64", ParseError, "not ended"),
    ],
)
def test_a_broken_file_names_what_is_wrong(
    was: str, is_now: str, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        read(TEXT.replace(was, is_now))


def test_it_becomes_opencvs_fisheye_only_as_far_as_the_caller_accepts() -> None:
    calibration = read(TEXT.replace("1.002 0.0014 0.0001", "1.0 0.0 0.0"))
    with pytest.raises(UnsupportedModelError, match="kannala-brandt"):
        parsers.encode([calibration], "keyed_text", name="x.cal")
    _, verdict = parsers.encode([calibration], "keyed_text", name="x.cal", max_error_px=5.0)
    assert 1.0 < verdict.max_px < 5.0


def test_json_with_an_axis_that_points_forwards_is_the_same_camera() -> None:
    document = {
        "pol": [325.9, 0.0, -8.6e-04, 3.5e-08, -6.7e-09], "invpol": [407.2, 159.7, -53.2],
        "width": 640, "height": 480, "xc": ROW, "yc": COLUMN, "c": 1.002, "d": 0.0014, "e": 0.0001,
    }  # fmt: skip
    [item] = parsers.decode(json.dumps(document).encode(), name="ocam.json")
    whole = read(TEXT)
    assert (item.intrinsics, item.distortion) == (whole.intrinsics, whole.distortion)
    assert "row and column" in item.notes[0]
    straight = document | {"c": 1.0, "d": 0.0, "e": 0.0}
    exchanged = straight | {"xc": COLUMN, "yc": ROW}
    one, two = (
        parsers.decode(json.dumps(each).encode(), name="ocam.json")[0] for each in (straight, exchanged)
    )
    assert one.intrinsics == two.intrinsics


def test_json_whose_centre_may_be_either_way_round_is_asked_about() -> None:
    document = {
        "pol": [325.9],
        "invpol": [],
        "width": 640,
        "height": 640,
        "xc": 318.0,
        "yc": 322.0,
        "c": 1,
        "d": 0,
        "e": 0,
    }
    with pytest.raises(ParseError, match="column and row or"):
        parsers.decode(json.dumps(document).encode(), name="ocam.json")
