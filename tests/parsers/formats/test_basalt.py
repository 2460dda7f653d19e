"""Basalt's rigs, against the formulas of its paper and against OpenCV."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError, UnknownFormatError, UnsupportedModelError
from tests.parsers.samples import Sample

Array = NDArray[np.float64]
FOCAL = {"fx": 433.2, "fy": 432.9, "cx": 371.6, "cy": 238.3}
K = np.array([[433.2, 0, 371.6], [0, 432.9, 238.3], [0, 0, 1]])
RADTAN8 = {
    "k1": -0.2,
    "k2": 0.04,
    "p1": -4e-4,
    "p2": 8e-4,
    "k3": -0.01,
    "k4": 0.008,
    "k5": -0.006,
    "k6": 0.004,
}


def rig(*cameras: tuple[str, dict[str, float]], sizes: int | None = None) -> bytes:
    entries = [{"camera_type": kind, "intrinsics": FOCAL | numbers} for kind, numbers in cameras]
    count = len(cameras) if sizes is None else sizes
    value0 = {
        "T_imu_cam": [],
        "intrinsics": entries,
        "resolution": [[752, 480]] * count,
        "cam_time_offset_ns": 0,
    }
    return json.dumps({"value0": value0}).encode()


def read(kind: str, **numbers: float) -> Calibration:
    [calibration] = parsers.decode(rig((kind, numbers)), name="calibration.json")
    return calibration


def rays() -> Array:
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 25), np.linspace(-0.6, 0.6, 25))
    return np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])


def check(calibration: Calibration, m: Array) -> None:
    expected = m * [433.2, 432.9] + [371.6, 238.3]
    np.testing.assert_allclose(calibration.project(rays()) - 0.5, expected, rtol=0, atol=1e-9)


SAMPLES = {"basalt": Sample(rig(("ds", {"xi": -0.24, "alpha": 0.57})))}


def test_ds_projects_by_its_formula() -> None:
    P = rays()
    d1 = np.linalg.norm(P, axis=1)
    d2 = np.sqrt(P[:, 0] ** 2 + P[:, 1] ** 2 + (-0.24 * d1 + P[:, 2]) ** 2)
    m = P[:, :2] / (0.57 * d2 + 0.43 * (-0.24 * d1 + P[:, 2]))[:, None]
    calibration = read("ds", xi=-0.24, alpha=0.57)
    check(calibration, m)
    assert "fx/(1 + xi)" in calibration.notes[0]


@pytest.mark.parametrize(("kind", "beta"), [("eucm", {"beta": 1.13}), ("ucm", {})])
def test_eucm_projects_by_its_formula_and_ucm_with_beta_one(kind: str, beta: dict[str, float]) -> None:
    P = rays()
    d = np.sqrt(beta.get("beta", 1.0) * (P[:, 0] ** 2 + P[:, 1] ** 2) + P[:, 2] ** 2)
    check(read(kind, alpha=0.59, **beta), P[:, :2] / (0.59 * d + 0.41 * P[:, 2])[:, None])


def test_kb4_is_opencvs_fisheye() -> None:
    D = np.array([-0.0292, 0.0208, -0.0319, 0.0166])
    points = rays().reshape(-1, 1, 3)
    expected = cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    calibration = read("kb4", k1=-0.0292, k2=0.0208, k3=-0.0319, k4=0.0166)
    np.testing.assert_allclose(calibration.project(rays()) - 0.5, expected, rtol=0, atol=1e-9)


def test_radtan8_is_opencvs_rational_model() -> None:
    D = np.array(list(RADTAN8.values()))
    expected = cv2.projectPoints(rays(), np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    calibration = read("pinhole-radtan8", **RADTAN8, rpmax=2.5)
    np.testing.assert_allclose(calibration.project(rays()) - 0.5, expected, rtol=0, atol=1e-9)
    assert "rpmax = 2.5" in calibration.notes[0]


def test_fov_projects_by_its_formula() -> None:
    P = rays()
    r = np.hypot(P[:, 0], P[:, 1])
    scale = np.arctan(2 * r * np.tan(0.46)) / 0.92 / np.where(r > 0, r, 1)
    check(read("fov", w=0.92), P[:, :2] * scale[:, None])


def test_a_pinhole_is_free_of_distortion() -> None:
    assert read("pinhole").distortion == NoDistortion()


def test_every_camera_of_the_rig_is_read_with_its_number() -> None:
    cameras = parsers.decode(rig(("ucm", {"alpha": 0.5}), ("pinhole", {})), name="calibration.json")
    assert [item.camera.sub_camera for item in cameras] == ["cam0", "cam1"]
    assert cameras[1].provenance.tag == "value0.intrinsics[1]"


def test_another_type_is_refused_by_name() -> None:
    with pytest.raises(UnsupportedModelError, match="bal"):
        read("bal", f=1.0)


def test_other_json_with_value0_is_not_claimed() -> None:
    for data in (b'{"value0": 3}', b'{"value0": {"intrinsics": []}}'):
        with pytest.raises(UnknownFormatError):
            parsers.decode(data, name="file.json")


@pytest.mark.parametrize(
    ("data", "match"),
    [
        (rig(("ds", {"xi": -1.0, "alpha": 0.5})), "xi"),
        (rig(("ds", {"alpha": 0.5})), "'xi'"),
        (rig(("eucm", {"alpha": 0.5, "beta": 0.0})), "beta"),
        (rig(("eucm", {"alpha": 1.5, "beta": 1.0})), "alpha"),
        (rig(("fov", {"w": 53.0})), "degrees"),
        (rig(("ucm", {"alpha": 0.5}), sizes=2), "2 resolutions of 1 cameras"),
        (rig(("pinhole", {"fx": -1.0})), "focal"),
    ],
)
def test_a_broken_file_names_what_is_wrong(data: bytes, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        parsers.decode(data, name="calibration.json")
