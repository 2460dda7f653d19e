"""Inpho's cameras, against collinearity in mm and the file's own affine map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.samples import Sample

AFFINE = """
     217.3923957723146400       0.0021000000000000    5798.5783629179004000
       0.0000000000    -217.2913442725533700    4358.1365279104657000"""
RADIAL = """
       0.0000000000000000    -0.0000141000000000     0.0000000040000000     0.0000000000000000
       0.0000000000000000     0.0000000000000000     0.0000000000000000     0.0000000000000000"""
ROWS = {
    "TYPE": "Acme-100_(50mm)", "DATE": "19:07:49 17/08/2024", "BRAND": "Custom", "KIND": "CCDFrame",
    "CCD_INTERIOR_ORIENTATION": AFFINE, "CCD_COLUMNS": "11608", "CCD_ROWS": "8708",
    "PIXEL_REFERENCE": "CenterTopLeft", "FOCAL_LENGTH": "   51.6829", "PRINCIPAL_POINT_PPA": "     0.021000    -0.013",
    "DISTORTION_TYPE": " Polynomial", "RADIAL_COEFFS": RADIAL, "DECENTRE_COEFFS": "\n  0.0000034 0.0000043 0.0 0.0",
    "GPS_ANTENNA_OFFSET": "     0.0     0.0     0.0", "CAMERA_MOUNT_ROTATION": "     0.0",
}  # fmt: skip


def block(changes: dict[str, str | None] | None = None) -> str:
    rows = {**ROWS, **(changes or {})}
    body = "".join(f"  ${key} :{value}\n" for key, value in rows.items() if value is not None)
    return f"$CAMERA\n{body}$END\n"


def definition(name: str, *focals: str, active: str = "2") -> str:
    sets = "".join(
        f"  $CALIBRATION_SET :\n    $ID : {number}\n    $CCD_INTERIOR_ORIENTATION :{AFFINE}\n"
        f"    $FOCAL_LENGTH : {focal}\n    $PRINCIPAL_POINT_PPA : 0 0\n  $END\n"
        for number, focal in enumerate(focals, start=1)
    )
    return (
        f"$CAMERA_DEFINITION\n  $ID : {name}\n  $CCD_COLUMNS : 11608\n  $CCD_ROWS : 8708\n"
        f"  $PIXEL_REFERENCE : CenterTopLeft\n  $ACTIVE_CALIBRATION : {active}\n{sets}$END\n"
    )


def read(text: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="block.prj")


SAMPLES = {"inpho_prj": Sample(block().encode())}


def test_a_point_is_seen_where_the_affine_map_puts_its_millimetres() -> None:
    [calibration] = read(block())
    u, v = np.meshgrid(np.linspace(-0.4, 0.4, 15), np.linspace(-0.3, 0.3, 15))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    x_mm, y_up_mm = 0.021 + 51.6829 * rays[:, 0], -0.013 - 51.6829 * rays[:, 1]
    column = 217.39239577231464 * x_mm + 0.0021 * y_up_mm + 5798.5783629179004
    row = -217.29134427255337 * y_up_mm + 4358.1365279104657
    # CenterTopLeft counts pixels' centres, and so half a pixel less than from the corner.
    np.testing.assert_allclose(
        calibration.project(rays), np.stack([column, row], axis=1) + 0.5, rtol=0, atol=1e-9
    )
    assert calibration.grade is Grade.CALIBRATED


def test_the_lens_terms_are_kept_but_not_used() -> None:
    [calibration] = read(block())
    assert calibration.distortion is None
    assert "not used" in calibration.notes[0]
    assert dict(calibration.extras)["inpho_prj/DECENTRE_COEFFS"] == "0.0000034 0.0000043 0.0 0.0"


def test_lens_terms_that_are_all_zero_are_no_distortion() -> None:
    [calibration] = read(block({"RADIAL_COEFFS": " 0 0 0 0", "DECENTRE_COEFFS": " 0 0"}))
    assert calibration.distortion == NoDistortion()
    assert calibration.notes == ()


def test_several_cameras_come_in_order_by_name_each_with_its_active_calibration() -> None:
    cameras = read(
        "$PROJECT 15.0.0\n  $ANGULAR_UNITS : deg\n$END\n"
        + definition("NADIR", "80.1", "80.2")
        + definition("LEFT", "124.1", active="1")
        + "$PHOTO\n  $PHOTO_NUM : 1\n$END\n"
    )
    assert [item.camera.sub_camera for item in cameras] == ["NADIR", "LEFT"]
    focals = [item.intrinsics.fx / 217.39239577231464 for item in cameras]
    assert focals == pytest.approx([80.2, 124.1])
    assert cameras[0].distortion is None


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"CCD_INTERIOR_ORIENTATION": " 0 -166.67 4102 -166.67 0 3052"}, "turns or mirrors"),
        ({"CCD_INTERIOR_ORIENTATION": " 217 0 5798 0 217 4358"}, "turns or mirrors"),
        ({"PIXEL_REFERENCE": " LowerLeft"}, "PIXEL_REFERENCE"),
        ({"KIND": " Frame"}, "CCDFrame"),
    ],
)
def test_what_k_cannot_hold_is_refused(changes: dict[str, str | None], message: str) -> None:
    with pytest.raises(UnsupportedModelError, match=message):
        read(block(changes))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (block({"FOCAL_LENGTH": None}), r"line 1: there is no \$FOCAL_LENGTH"),
        (block({"FOCAL_LENGTH": " -51"}), "focal lengths"),
        (block({"CCD_INTERIOR_ORIENTATION": " 1 2 3"}), "3 numbers, expected 6"),
        (block({"CCD_ROWS": " 8708.5"}), "image size"),
        (block({"RADIAL_COEFFS": " 0 x"}), "not a number"),
        (block()[:-6] + "\n", r"no \$END"),
        (block().replace("$BRAND", "$KIND"), r"\$KIND is a duplicate key"),
        (definition("A", "80", "81", active="7"), "not one of its 2"),
        ("$PROJECT 15\n$END\n", r"no \$CAMERA"),
    ],
)
def test_a_broken_project_names_what_is_wrong(text: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(text)
