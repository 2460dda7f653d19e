"""AliceVision's .sfm: one camera in every version's own numbers, and what the lens types mean."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.samples import Sample

Array = NDArray[np.float64]
Fields = dict[str, Any]  # JSON of strings, as AliceVision writes it

SIZE = (4000, 3000)
FX, FY, CX, CY = 3021.7, 2989.3, 2013.25, 1488.75
K3 = ["0.1", "0.05", "-0.001"]
OFFSET = [repr(CX - 2000), repr(CY - 1500)]
SENSOR_MM = 13.2


def mm(px: float) -> str:
    return repr(px / SIZE[0] * SENSOR_MM)


def by_version(minor: int, patch: int) -> Fields:
    """The same camera as that version of AliceVision writes it."""
    version = (1, minor, patch)
    fields: Fields = {"principalPoint": OFFSET if version >= (1, 2, 1) else [repr(CX), repr(CY)]}
    if version < (1, 2, 0):
        return fields | {"pxFocalLength": repr(FX)}
    if version < (1, 2, 2):
        return fields | {"pxFocalLength": [repr(FX), repr(FY)]}
    if version < (1, 2, 5):
        return fields | {"focalLength": mm(FX), "pixelRatio": repr(FX / FY)}
    if version < (1, 2, 11):
        return fields | {"focalLength": mm(FX), "pixelRatio": repr(FY / FX)}
    return fields | {"focalLength": mm(FY), "pixelRatio": repr(FY / FX)}


def sfm(
    fields: Fields | None = None,
    *,
    version: tuple[int, int] = (2, 11),
    top: Fields | None = None,
    count: int = 1,
) -> bytes:
    intrinsic: Fields = {
        "intrinsicId": "7", "width": "4000", "height": "3000", "sensorWidth": repr(SENSOR_MM), "sensorHeight": "9.9",
        "serialNumber": "", "initializationMode": "none", "locked": "false", **by_version(*version),
    }  # fmt: skip
    if version >= (2, 8):
        intrinsic |= {"type": "pinhole", "distortionType": "radialk3", "distortionParams": K3}
    else:
        intrinsic |= {"type": "radial3", "distortionParams": K3}
    items = [intrinsic | {"intrinsicId": str(7 + index)} | (fields or {}) for index in range(count)]
    document = {"version": ["1", *map(str, version)], "views": "", "intrinsics": items, **(top or {})}
    return json.dumps(document).encode()


def read(data: bytes, **options: str) -> Calibration:
    [calibration] = parsers.decode(data, name="sfm.json", options=options)
    return calibration


def rays() -> Array:
    u, v = np.meshgrid(np.linspace(-0.6, 0.6, 25), np.linspace(-0.45, 0.45, 25))
    return np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])


SAMPLES = {"alicevision_sfm": Sample(sfm())}


@pytest.mark.parametrize(
    "version",
    [(1, 0), (2, 0), (2, 1), (2, 2), (2, 4), (2, 5), (2, 7), (2, 8), (2, 10), (2, 11), (2, 14)],
    ids=str,
)
def test_every_version_writes_the_same_camera(version: tuple[int, int]) -> None:
    item = read(sfm(version=version))
    K = item.intrinsics
    fy = FX if version == (1, 0) else FY
    assert (K.fx, K.fy) == pytest.approx((FX, fy), rel=1e-14)
    assert (K.cx, K.cy) == pytest.approx((CX + 0.5, CY + 0.5), rel=1e-14)
    assert item.distortion == BrownConrady(k1=0.1, k2=0.05, p1=0, p2=0, k3=-0.001)
    assert "centre of the first pixel" in item.notes[0]


def alicevision(kind: str, c: list[float], points: Array) -> Array:
    """Distortion*.cpp's addDistortion and IntrinsicScaleOffset's cam2ima, in px from the outer corner."""
    x, y = points[:, 0], points[:, 1]
    r2 = x**2 + y**2
    r = np.sqrt(r2)
    safe = np.where(r == 0, 1, r)
    if kind == "fisheye":
        theta = np.arctan(r)
        scale = (theta + c[0] * theta**3 + c[1] * theta**5 + c[2] * theta**7 + c[3] * theta**9) / safe
        x, y = x * scale, y * scale
    elif kind == "fisheye1":
        scale = np.arctan(2 * r * np.tan(c[0] / 2)) / c[0] / safe
        x, y = x * scale, y * scale
    else:
        k = [*c[:3], 0.0, 0.0, 0.0][:3]
        t1, t2 = c[3:] if kind == "brown" else (0.0, 0.0)
        radial = 1 + k[0] * r2 + k[1] * r2**2 + k[2] * r2**3
        x, y = (
            x * radial + t2 * (r2 + 2 * x**2) + 2 * t1 * x * y,
            y * radial + t1 * (r2 + 2 * y**2) + 2 * t2 * x * y,
        )
    return np.stack([FX * x + CX + 0.5, FY * y + CY + 0.5], axis=1)


@pytest.mark.parametrize(
    ("kind", "before_1_2_8", "params"),
    [
        ("none", "pinhole", []),
        ("radialk1", "radial1", [-0.031]),
        ("radialk3", "radial3", [-0.031, 0.012, -0.004]),
        ("brown", "brown", [-0.031, 0.012, -0.004, 0.0007, -0.0003]),
        ("fisheye", "fisheye4", [0.031, -0.0072, 0.0041, -0.0011]),
        ("fisheye1", "fisheye1", [0.93]),
    ],
)
def test_a_lens_projects_by_alicevisions_own_formula(
    kind: str, before_1_2_8: str, params: list[float]
) -> None:
    texts = [repr(value) for value in params] or ""
    expected = alicevision(kind, params, rays())
    for data in (
        sfm({"distortionType": kind, "distortionParams": texts}),
        sfm({"type": before_1_2_8, "distortionParams": texts}, version=(2, 7)),
    ):
        np.testing.assert_allclose(read(data).project(rays()), expected, rtol=0, atol=1e-9)


def test_an_empty_list_of_coefficients_is_filled_with_zeros() -> None:
    assert read(sfm({"distortionParams": ""})).distortion == NoDistortion()


def test_several_intrinsics_come_in_order_by_their_ids() -> None:
    found = parsers.decode(sfm(count=3), name="a.sfm")
    assert [item.camera.sub_camera for item in found] == ["7", "8", "9"]
    assert found[1].provenance.tag == "intrinsic 8"


def test_the_camera_is_named_by_the_exif_of_its_images() -> None:
    views = [{"viewId": "1", "intrinsicId": "7", "metadata": {"Make": "Acme", "Model": "X1"}}]
    key = read(sfm(top={"views": views})).camera
    assert (key.make, key.model, key.serial) == ("Acme", "X1", None)


@pytest.mark.parametrize(
    ("fields", "top", "grade"),
    [
        ({"initializationMode": "estimated"}, {}, Grade.DERIVED),
        ({"initializationMode": "unknown"}, {}, Grade.SEED),
        ({"initializationMode": "calibrated"}, {}, Grade.CALIBRATED),
        ({"initializationMode": "none"}, {}, Grade.ADJUSTED),
        ({"initializationMode": "estimated", "initialFocalLength": "8.8"}, {}, Grade.ADJUSTED),
        ({"initializationMode": "estimated"}, {"poses": [{"poseId": "1"}]}, Grade.ADJUSTED),
        ({"initializationMode": "estimated"}, {"poses": ""}, Grade.DERIVED),
    ],
)
def test_the_grade_says_whether_anything_was_adjusted(fields: Fields, top: Fields, grade: Grade) -> None:
    assert read(sfm(fields, top=top)).grade is grade


def test_the_millimetres_of_an_upright_image_are_asked_about() -> None:
    upright = sfm({"width": "3000", "height": "4000"})
    with pytest.raises(ParseError, match="focal_side"):
        read(upright)
    by_width, by_longer = (read(upright, focal_side=side).intrinsics.fy for side in ("width", "longer"))
    assert by_width == pytest.approx(FY * 3000 / 4000)
    assert by_longer == pytest.approx(FY)


def test_a_sensor_that_is_not_given_is_36_mm_wide_and_that_is_said() -> None:
    document = json.loads(sfm())
    del document["intrinsics"][0]["sensorWidth"]
    item = read(json.dumps(document).encode())
    assert item.intrinsics.fy == pytest.approx(FY * SENSOR_MM / 36)
    assert "36 mm" in item.provenance.assumptions[0]


@pytest.mark.parametrize(
    "fields",
    [
        {"type": "equidistant"},
        {"distortionType": "radialk3pt"},
        {"distortionType": "none", "undistortionType": "3deanamorphic4", "undistortionParams": ["0.1"]},
    ],
    ids=str,
)
def test_what_has_no_counterpart_is_refused_by_name(fields: Fields) -> None:
    with pytest.raises(UnsupportedModelError, match=r"equidistant|radialk3pt|3deanamorphic4"):
        read(sfm(fields))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"focalLength": "0"}, "focal lengths"),
        ({"focalLength": "nan"}, "not finite"),
        ({"sensorWidth": "0"}, "sensorWidth"),
        ({"pixelRatio": "0"}, "pixelRatio"),
        ({"principalPoint": ["1"]}, "1 numbers, expected 2"),
        ({"distortionParams": ["1", "2"]}, "2 numbers, expected 3"),
        ({"width": "0"}, "image size"),
    ],
    ids=str,
)
def test_a_broken_intrinsic_names_what_is_wrong(fields: Fields, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(sfm(fields))


def test_a_version_to_come_is_refused() -> None:
    with pytest.raises(ParseError, match=r"2\.0\.0"):
        read(sfm(top={"version": ["2", "0", "0"]}))
