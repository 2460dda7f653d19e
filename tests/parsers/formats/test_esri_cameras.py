"""Esri's cameras table, against the film coordinates that its description defines."""

from __future__ import annotations

import csv
import io

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.parsers.discovery import format_named

FILE = """ObjectID,CameraID,FocalLength,PrincipalX,PrincipalY,NRows,NColumns,PixelSize
1,Left,8787.36,-10.8,-55.44,3648,5472,2.4
2,Right,8790,0,0,3648,5472,2.4
"""
RAYS = [(-0.4, 0.3, 1.0), (0.0, 0.0, 2.0), (0.35, -0.2, 1.0), (1.0, 1.0, 4.0)]


def read(text: str) -> list[Calibration]:
    return [*parsers.decode(text.encode(), name="cameras.csv")]


def test_a_ray_is_where_the_film_coordinates_say() -> None:
    left, right = read(FILE)
    # Film: x right, y up from the middle of the image, µm; collinearity: x = x0 + f X/Z, y = y0 − f Y/Z (Y down).
    for X, Y, Z in RAYS:
        film_x, film_y = -10.8 + 8787.36 * X / Z, -55.44 - 8787.36 * Y / Z
        column, row = 5472 / 2 + film_x / 2.4, 3648 / 2 - film_y / 2.4
        assert left.project([[X, Y, Z]])[0] == pytest.approx([column, row], abs=1e-8)
    assert (right.camera.sub_camera, right.intrinsics.cx, right.intrinsics.cy) == ("Right", 2736.0, 1824.0)
    assert left.distortion == NoDistortion()
    assert left.grade is Grade.DERIVED


def test_a_table_is_written_as_the_description_has_it() -> None:
    K = Intrinsics(fx=3661.4, fy=3661.4, cx=2731.5, cy=1847.1, image_size=(5472, 3648))
    made = Calibration(
        camera=CameraKey(make="DJI", model="FC6310R", focal_mm=8.8),
        intrinsics=K,
        distortion=NoDistortion(),
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="test"),
    )
    data, verdict = parsers.encode([made], format_named("esri_cameras"))
    [row] = csv.DictReader(io.StringIO(data.decode()))
    assert (row["ObjectID"], row["CameraID"], row["NRows"], row["NColumns"]) == (
        "1",
        "FC6310R",
        "3648",
        "5472",
    )
    pitch = 8800 / 3661.4
    assert float(row["FocalLength"]) == pytest.approx(8800)
    assert float(row["PixelSize"]) == pytest.approx(pitch)
    assert float(row["PrincipalX"]) == pytest.approx((2731.5 - 2736) * pitch)
    assert float(row["PrincipalY"]) == pytest.approx((1824 - 1847.1) * pitch)
    assert verdict.fits[0].exact


def test_a_lens_with_distortion_is_not_written() -> None:
    K = Intrinsics(fx=3661.4, fy=3661.4, cx=2731.5, cy=1847.1, image_size=(5472, 3648))
    lens = BrownConrady(k1=-0.27, k2=0.11, p1=0.0, p2=0.0, k3=0.0)
    made = Calibration(
        camera=CameraKey(),
        intrinsics=K,
        distortion=lens,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="test"),
    )
    with pytest.raises(UnsupportedModelError, match=r"one of up to .* px would be lost"):
        parsers.encode([made], format_named("esri_cameras"))


def test_without_rows_and_columns_the_size_is_asked_for() -> None:
    short = "CameraID,FocalLength,PixelSize\nA,8790,2.4\n"
    with pytest.raises(InputError, match="--image-size"):
        read(short)
    [item] = parsers.decode(short.encode(), name="c.csv", image_size=(5472, 3648))
    assert item.intrinsics.fx == pytest.approx(8790 / 2.4)


ONE = "CameraID,FocalLength,PixelSize,NRows,NColumns{}\nA,{},{},3648,5472{}\n"


@pytest.mark.parametrize(
    ("text", "kind", "match"),
    [
        (ONE.format(",K0", 8790, 2.4, ",1e-4"), UnsupportedModelError, "distortion .k0."),
        (ONE.format(",A0", 8790, 2.4, ",0"), UnsupportedModelError, "A0 … B2"),
        (ONE.format("", 8790, 0, ""), ParseError, "PixelSize is 0"),
        (ONE.format("", "", 2.4, ""), ParseError, "FocalLength is empty"),
        (ONE.format("", "far", 2.4, ""), ParseError, "line 2, focallength"),
        (ONE.format("", 8790, 2.4, ",1"), ParseError, "6 fields, expected 5"),
        (ONE.format(",NRows", 8790, 2.4, ",1"), ParseError, "twice"),
    ],
)
def test_a_broken_table_names_what_is_wrong(text: str, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        read(text)


def test_zero_distortion_is_none() -> None:
    assert read(ONE.format(",K0,K1", 8790, 2.4, ",0.0,0"))[0].distortion == NoDistortion()
