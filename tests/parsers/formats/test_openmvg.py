"""OpenMVG's sfm_data.json: cereal's abbreviations, and OpenMVG's formulas written down once more."""

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
Fields = dict[str, Any]  # JSON as cereal writes it

NEW = 0x80000000
CAMERA: Fields = {"width": 4000, "height": 3000, "focal_length": 2856.5, "principal_point": [1992.3, 1520.2]}
LENS: dict[str, Fields] = {
    "pinhole": {},
    "pinhole_radial_k1": {"disto_k1": [-0.031]},
    "pinhole_radial_k3": {"disto_k3": [-0.031, 0.012, -0.004]},
    "pinhole_brown_t2": {"disto_t2": [-0.031, 0.012, -0.004, 0.0007, -0.0003]},
    "fisheye": {"fisheye": [0.031, -0.0072, 0.0041, -0.0011]},
}


def entry(key: int, kind: Fields, pointer: int, data: Fields | None) -> Fields:
    wrapper = {"id": pointer, **({} if data is None else {"data": data})}
    return {"key": key, "value": {**kind, "ptr_wrapper": wrapper}}


def named(name: str, number: int = 1) -> Fields:
    return {"polymorphic_id": NEW + number, "polymorphic_name": name}


def sfm_data(*intrinsics: Fields, extrinsics: list[object] | None = None) -> bytes:
    document = {"sfm_data_version": "0.3", "root_path": "", "views": [], "intrinsics": intrinsics}
    return json.dumps({**document, "extrinsics": extrinsics or []}).encode()


def one(name: str, **changes: object) -> bytes:
    return sfm_data(entry(0, named(name), NEW + 1, {**CAMERA, **LENS.get(name, {}), **changes}))


def read(data: bytes) -> Calibration:
    [calibration] = parsers.decode(data, name="sfm_data.json")
    return calibration


def rays() -> Array:
    u, v = np.meshgrid(np.linspace(-0.6, 0.6, 25), np.linspace(-0.45, 0.45, 25))
    return np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])


def openmvg(name: str, points: Array) -> Array:
    """add_disto and cam2ima of Camera_Pinhole_*.hpp, in px from the outer corner."""
    x, y = points[:, 0], points[:, 1]
    c: list[float] = next(iter(LENS[name].values()), [])
    r2 = x**2 + y**2
    r = np.sqrt(r2)
    if name == "fisheye":
        theta = np.arctan(r)
        turned = theta + c[0] * theta**3 + c[1] * theta**5 + c[2] * theta**7 + c[3] * theta**9
        scale = np.where(r > 1e-8, turned / np.where(r == 0, 1, r), 1.0)
        x, y = x * scale, y * scale
    elif c:
        k = [*c[:3], 0.0, 0.0][:3]
        t1, t2 = c[3:] or (0.0, 0.0)
        radial = k[0] * r2 + k[1] * r2**2 + k[2] * r2**3
        tx = t2 * (r2 + 2 * x**2) + 2 * t1 * x * y
        ty = t1 * (r2 + 2 * y**2) + 2 * t2 * x * y
        x, y = x + x * radial + tx, y + y * radial + ty
    return np.stack([2856.5 * x + 1992.3 + 0.5, 2856.5 * y + 1520.2 + 0.5], axis=1)


SAMPLES = {"openmvg": Sample(one("pinhole_brown_t2"))}


@pytest.mark.parametrize("name", LENS)
def test_a_camera_projects_by_openmvgs_own_formula(name: str) -> None:
    item = read(one(name))
    np.testing.assert_allclose(item.project(rays()), openmvg(name, rays()), rtol=0, atol=1e-9)
    assert "centre of the first pixel" in item.notes[0]
    assert item.grade is Grade.ADJUSTED


def test_a_class_is_named_once_and_then_goes_by_its_number() -> None:
    k3 = {**CAMERA, **LENS["pinhole_radial_k3"]}
    brown = {**CAMERA, **LENS["pinhole_brown_t2"]}
    found = parsers.decode(
        sfm_data(
            entry(0, named("pinhole_radial_k3", 1), NEW + 1, k3),
            entry(1, named("pinhole_brown_t2", 2), NEW + 2, brown),
            entry(2, {"polymorphic_id": 1}, NEW + 3, {**k3, "focal_length": 2900.5}),
            entry(5, {"polymorphic_id": 2}, NEW + 4, brown),
        ),
        name="sfm_data.json",
    )
    assert [item.camera.sub_camera for item in found] == ["0", "1", "2", "5"]
    assert [item.intrinsics.fx for item in found] == [2856.5, 2856.5, 2900.5, 2856.5]
    assert found[2].distortion == BrownConrady(k1=-0.031, k2=0.012, p1=0, p2=0, k3=-0.004)
    assert found[3].distortion == BrownConrady(k1=-0.031, k2=0.012, p1=0.0007, p2=-0.0003, k3=-0.004)


def test_a_camera_that_stands_twice_has_its_data_once() -> None:
    found = parsers.decode(
        sfm_data(entry(0, named("pinhole"), NEW + 7, CAMERA), entry(1, {"polymorphic_id": 1}, 7, None)),
        name="sfm_data.json",
    )
    assert found[0].intrinsics == found[1].intrinsics


def test_a_plain_object_is_known_by_its_coefficients() -> None:
    item = read(sfm_data(entry(0, {"polymorphic_id": 0x40000000}, NEW + 1, {**CAMERA, "disto_k1": [-0.031]})))
    assert item.distortion == BrownConrady(k1=-0.031, k2=0, p1=0, p2=0)


@pytest.mark.parametrize(
    "second", [entry(1, {"polymorphic_id": 9}, NEW + 2, CAMERA), entry(1, {"polymorphic_id": 1}, 8, None)]
)
def test_an_abbreviation_of_nothing_is_refused(second: Fields) -> None:
    with pytest.raises(ParseError, match=r"intrinsics\[1\]"):
        read(sfm_data(entry(0, named("pinhole"), NEW + 1, CAMERA), second))


def test_what_was_never_adjusted_is_a_prior() -> None:
    untouched = {"principal_point": [2000.0, 1500.0], "disto_k3": [0.0, 0.0, 0.0]}
    assert read(one("pinhole_radial_k3", **untouched)).grade is Grade.PRIOR
    data = json.loads(one("pinhole_radial_k3", **untouched))
    data["extrinsics"] = [{"key": 0, "value": {}}]
    item = read(json.dumps(data).encode())
    assert item.grade is Grade.ADJUSTED
    assert item.distortion == NoDistortion()


@pytest.mark.parametrize("name", ["spherical", "pinhole_of_tomorrow"])
def test_a_class_without_a_counterpart_is_refused_by_name(name: str) -> None:
    with pytest.raises(UnsupportedModelError, match=name):
        read(one(name))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"disto_k3": [0.2, -0.8]}, "2 numbers, expected 3"),
        ({"focal_length": -1}, "focal lengths"),
        ({"focal_length": None}, "expected a number"),
        ({"principal_point": 5}, "3 numbers, expected 4"),
        ({"width": 0}, "image size"),
    ],
    ids=str,
)
def test_a_broken_camera_names_what_is_wrong(changes: Fields, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(one("pinhole_radial_k3", **changes))
