"""Calib_Results.m, against OpenCV's projection and the toolbox's own formula for the skew."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion
from calibrary.errors import InputError, MissingTagError, ParseError
from tests.parsers.samples import Sample

SCRIPT = """\
% Intrinsic and Extrinsic Camera Parameters
% fc = [ 1 ; 1 ];

%-- Focal length:
fc = [ 3650.100000000000364 ; 3648.699999999999818 ];

%-- Principal point:
cc = [ 2740.800000000000182 ; 1815.400000000000091 ];

%-- Skew coefficient:
alpha_c = 0.000700000000000;

%-- Distortion coefficients:
kc = [ -0.1131 ; 0.0247 ; -0.00037 ; 0.00081 ; -0.0062 ];

fc_error = [ 1.8 ; 2.1 ];
cc_error = [ NaN ; NaN ];
kc_error = [ 0.003 ; 0.006 ; 0.00003 ; NaN ; 0 ];

%-- Image size:
nx = 5472;
ny = 3648;

n_ima = 21;						% Number of calibration images
%-- Image #1:
omc_1 = [ 1.9 ; -1.4 ; 0.5 ];
"""


def read(text: str, **options: str) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="Calib_Results.m", options=options)
    return calibration


SAMPLES = {"bouguet_m": Sample(SCRIPT.encode())}


def test_a_camera_projects_as_the_toolbox_does() -> None:
    calibration = read(SCRIPT)
    u, v = np.meshgrid(np.linspace(-0.6, 0.6, 15), np.linspace(-0.4, 0.4, 15))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    D = np.array([-0.1131, 0.0247, -0.00037, 0.00081, -0.0062])
    x, y = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), D)[0].reshape(-1, 2).T
    seen = np.column_stack([3650.1 * (x + 0.0007 * y) + 2740.8, 3648.7 * y + 1815.4])
    np.testing.assert_allclose(calibration.project(rays), seen + 0.5, rtol=0, atol=1e-9)


def test_uncertainties_are_a_third_and_those_not_estimated_are_left_out() -> None:
    quality = read(SCRIPT).quality
    assert quality is not None
    assert quality.std == pytest.approx({"fx": 0.6, "fy": 0.7, "k1": 0.001, "k2": 0.002, "p1": 0.00001})
    assert quality.views == 21


def test_four_coefficients_are_asked_about() -> None:
    text = SCRIPT.replace(" ; -0.0062 ]", " ]")
    with pytest.raises(ParseError, match="distortion"):
        read(text)
    assert read(text, distortion="brown").distortion == BrownConrady(
        k1=-0.1131, k2=0.0247, p1=-0.00037, p2=0.00081
    )
    assert isinstance(read(text, distortion="fisheye").distortion, KannalaBrandt)


def test_zeros_are_no_distortion() -> None:
    text = SCRIPT.replace("-0.1131 ; 0.0247 ; -0.00037 ; 0.00081 ; -0.0062", "0.0 ; 0 ; 0 ; 0 ; -0.0")
    assert read(text).distortion == NoDistortion()


def test_the_image_size_is_asked_for_where_it_is_missing() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        read(SCRIPT.replace("nx = 5472;\nny = 3648;\n", ""))


@pytest.mark.parametrize(
    ("was", "is_now", "message"),
    [
        ("cc = [ 2740.8", "dd = [ 2740.8", "does not assign cc"),
        ("alpha_c = 0.0007", "fc = [ 1 ; 1 ];\nalpha_c = 0.0007", "assigned twice"),
        ("fc = [ 3650.100000000000364 ;", "fc = [", "1 numbers, expected 2"),
        ("fc = [ 3650.1", "fc = [ system('x') 3650.1", "not a number|expected 2"),
        ("; -0.0062", "; -0.0062 ; 0.3", "sixth"),
        ("3650.1", "-3650.1", "focal lengths"),
        ("ny = 3648;", "", "does not assign ny"),
    ],
)
def test_a_broken_script_names_what_is_wrong(was: str, is_now: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(SCRIPT.replace(was, is_now))


def test_a_script_cut_short_anywhere_is_noticed_or_reads_the_same() -> None:
    whole = read(SCRIPT)
    for end in range(len(SCRIPT)):
        try:
            part = read(SCRIPT[:end])
        except InputError:
            continue
        assert (part.intrinsics, part.distortion) == (whole.intrinsics, whole.distortion)
