"""TerraPhoto's .cal: K in its own words, the lens kept and not guessed."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.samples import Sample

CAL = """\
[TerraPhoto calibration]
Version=20050513
Description= left camera
LeverArm= 0.0110 -0.0160 0.9720
AttitudeCorrections(HRP)= 36.3 0.4 0.0
PlateSize= 4000 3000
ImageSize= 4000 3000
Orientation= TOP
PrincipalPoint(XoYoZo)= 12.4 -7.1 -3650.3
LensModel= Function
LensA3= -1.1e-9
LensR0= 1200
Panoramic= 0
"""


def read(text: str, **options: str) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="left.cal", options=options)
    return calibration


SAMPLES = {"terraphoto_cal": Sample(CAL.encode(), options={"y_axis": "up"})}


@pytest.mark.parametrize(("y_axis", "cy"), [("up", 1500 + 7.1), ("down", 1500 - 7.1)])
def test_k_is_counted_from_the_middle(y_axis: str, cy: float) -> None:
    K = read(CAL, y_axis=y_axis).intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (3650.3, 3650.3, 2012.4, cy)


def test_the_direction_of_y_is_asked_for_where_it_matters() -> None:
    with pytest.raises(ParseError, match="y_axis"):
        read(CAL)
    assert read(CAL.replace("-7.1", "0")).intrinsics.cy == 1500


def test_the_lens_terms_are_kept_and_marked_unconverted() -> None:
    calibration = read(CAL, y_axis="up")
    assert calibration.distortion is None
    assert ("terraphoto_cal/unconverted/LensA3", "-1.1e-9") in calibration.extras
    assert ("terraphoto_cal/LeverArm", "0.0110 -0.0160 0.9720") in calibration.extras
    assert any("LensA3" in note for note in calibration.notes)


def test_panoramas_have_no_k() -> None:
    with pytest.raises(UnsupportedModelError, match="panoramas"):
        read(CAL.replace("Panoramic= 0", "Panoramic=-1"))


def test_a_plate_in_other_units_is_refused() -> None:
    with pytest.raises(UnsupportedModelError, match="not in pixels"):
        read(CAL.replace("PlateSize= 4000 3000", "PlateSize= 24 18"))


@pytest.mark.parametrize(
    ("was", "is_now", "message"),
    [
        ("PlateSize= 4000 3000\n", "", "no PlateSize"),
        ("PrincipalPoint(XoYoZo)= 12.4 -7.1 -3650.3\n", "", "no PrincipalPoint"),
        (" -3650.3", "", "2 numbers, expected 3"),
        ("-3650.3", "0", "focal lengths"),
        ("Orientation= TOP", "Version= 1", "is a duplicate key"),
        ("Orientation= TOP", "Orientation", "expected a key, '=' and a value"),
        ("12.4", "12,4", "decimal point"),
        ("Panoramic= 0\n", "Panoramic= 0", "not ended"),
    ],
)
def test_a_broken_file_names_what_is_wrong(was: str, is_now: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(CAL.replace(was, is_now), y_axis="up")
