"""OPF's cameras, against the formulas of Pix4D's papers written down here once more."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.distortion import FisheyePolynomial, KannalaBrandt, NoDistortion
from calibrary.errors import MissingTagError, ParseError, UnsupportedModelError
from calibrary.records import replace
from tests.parsers.cameras import SIZE, camera

PERSPECTIVE = {
    "type": "perspective",
    "principal_point_px": [2741.3, 1815.9],
    "focal_length_px": 3650.1,
    "radial_distortion": [-0.0113, 0.0247, -0.0062],
    "tangential_distortion": [-0.00037, 0.00081],
}
FISHEYE = {
    "type": "fisheye",
    "principal_point_px": [634.45, 481.23],
    "affine": [1676.3, 0.31, 0.0, 1675.9],
    "polynomial": [0.0, 1.02, 0.0152, -0.161],
    "is_p0_zero": True,
    "is_symmetric_affine": False,
}


def document(*internals: dict[str, Any], **changes: Any) -> bytes:
    sensors = [{"id": 2**63 + index, "internals": item} for index, item in enumerate(internals)]
    mark = "application/opf-calibrated-cameras+json"
    fields = {"format": mark, "version": "1.0", "sensors": sensors, "cameras": []}
    return json.dumps(fields | changes).encode()


def input_cameras(*sizes: tuple[int, int]) -> bytes:
    sensors = [
        {"id": 2**63 + index, "name": "twin" if index < 2 else "tele", "image_size_px": size}
        for index, size in enumerate(sizes)
    ]
    mark = "application/opf-input-cameras+json"
    return json.dumps({"format": mark, "version": "1.0", "sensors": sensors, "captures": []}).encode()


def read(data: bytes, size: tuple[int, int] | None = SIZE, **beside: bytes) -> Sequence[Calibration]:
    files = {name.replace("__", "."): content for name, content in beside.items()}
    return parsers.decode(data, name="calibrated_cameras.json", image_size=size, companion=files.get)


def rays(reach: float) -> NDArray[np.float64]:
    u, v = np.meshgrid(np.linspace(-reach, reach, 15), np.linspace(-reach, reach, 15))
    return np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])


def test_a_perspective_camera_projects_as_opencv_does_from_the_pixels_corner() -> None:
    [calibration] = read(document(PERSPECTIVE))
    D = np.array([-0.0113, 0.0247, -0.00037, 0.00081, -0.0062])
    observed = cv2.projectPoints(rays(0.6), np.zeros(3), np.zeros(3), np.eye(3), D)[0].reshape(-1, 2)
    np.testing.assert_allclose(
        calibration.project(rays(0.6)), 3650.1 * observed + [2741.3, 1815.9], rtol=0, atol=1e-9
    )
    assert calibration.grade is Grade.ADJUSTED


def test_a_fisheye_projects_by_pix4ds_formula() -> None:
    [calibration] = read(document(FISHEYE), (1280, 960))
    directions = rays(2.5) + 1e-9
    X, Y, Z = directions.T
    R = np.hypot(X, Y)
    t = 2 / np.pi * np.arctan2(R, Z)
    rho = 1.02 * t + 0.0152 * t**2 - 0.161 * t**3
    x_h, y_h = rho * X / R, rho * Y / R
    pixels = np.stack([1676.3 * x_h + 0.31 * y_h + 634.45, 1675.9 * y_h + 481.23], axis=1)
    seen = calibration.project(directions)
    np.testing.assert_allclose(seen, pixels, rtol=0, atol=1e-9)
    back = calibration.unproject(seen)
    np.testing.assert_allclose(calibration.project(back), seen, rtol=0, atol=1e-9)


def test_sizes_and_names_come_from_the_input_cameras_beside_it() -> None:
    sizes = ((5472, 3648), (2736, 1824), (1280, 960))
    cameras = read(
        document(PERSPECTIVE, PERSPECTIVE, FISHEYE), None, input_cameras__json=input_cameras(*sizes)
    )
    assert [item.camera.image_size for item in cameras] == list(sizes)
    names = [item.camera.sub_camera for item in cameras]
    assert names == [f"twin {2**63}", f"twin {2**63 + 1}", "tele"]


def test_the_project_says_which_file_the_input_cameras_are() -> None:
    resource = {"format": "application/opf-input-cameras+json", "uri": "in.json"}
    elsewhere = {"format": "application/opf-input-cameras+json", "uri": "../in.json"}
    project = json.dumps({"items": [{"resources": [elsewhere, resource]}]}).encode()
    [item] = read(document(PERSPECTIVE), None, project__opf=project, in__json=input_cameras((5472, 3648)))
    assert item.camera.image_size == (5472, 3648)


def test_without_them_the_size_is_asked_for() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        read(document(PERSPECTIVE), None)


def test_a_size_from_the_caller_is_for_sensors_that_the_project_does_not_know() -> None:
    cameras = read(
        document(PERSPECTIVE, FISHEYE), (1280, 960), input_cameras__json=input_cameras((5472, 3648))
    )
    assert [item.camera.image_size for item in cameras] == [(5472, 3648), (1280, 960)]


def test_a_sensors_id_and_place_in_a_rig_survive_but_no_position_does() -> None:
    data = json.loads(document(PERSPECTIVE, PERSPECTIVE))
    data["sensors"][1]["rig_relatives"] = {"rotation_angles_deg": [1, 2, 3], "translation": [0.1, 0, 0]}
    data["cameras"] = [{"id": 1, "sensor_id": 2**63, "position": [7.1, 46.2, 400]}]
    original = read(json.dumps(data).encode())
    again, verdict = parsers.encode(original, "opf_calibrated_cameras")
    assert verdict.dropped == ("image size",)
    written = json.loads(again)
    assert written["sensors"] == data["sensors"]
    assert written["cameras"] == []


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"polynomial": [0.1, 1.0, 0.0, 0.0]}, "p0 = 0"),
        ({"polynomial": [0.0, 1.0, 0.0, 0.0, 0.0, 0.1]}, "nothing past p4"),
        ({"affine": [1676.0, 0.0, 0.2, 1676.0]}, "rotated"),
        ({"type": "spherical"}, "spherical"),
    ],
)
def test_what_has_no_counterpart_is_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(UnsupportedModelError, match=message):
        read(document(FISHEYE | changes))


def test_a_later_version_is_refused() -> None:
    with pytest.raises(UnsupportedModelError, match="version"):
        read(document(PERSPECTIVE, version="2.0"))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (document(), "no sensor"),
        (document(PERSPECTIVE | {"focal_length_px": "x"}), "focal_length_px: 'x' is not a number"),
        (document(PERSPECTIVE | {"focal_length_px": 0}), "focal lengths"),
        (document(PERSPECTIVE | {"radial_distortion": [0.1]}), r"sensors\[0\].internals.radial_distortion"),
        (document(PERSPECTIVE, sensors=[{"id": 1.5, "internals": PERSPECTIVE}] * 2), "id"),
        (document(PERSPECTIVE)[:-5], "JSON"),
    ],
)
def test_a_broken_file_names_what_is_wrong(data: bytes, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parsers.decode(data, name="f.json", format="opf_calibrated_cameras", image_size=SIZE)


def test_zeros_are_no_distortion() -> None:
    flat = PERSPECTIVE | {"radial_distortion": [0, 0, 0], "tangential_distortion": [0, 0]}
    assert read(document(flat))[0].distortion == NoDistortion()


def test_a_fisheye_is_written_in_right_angles() -> None:
    K = replace(camera().intrinsics, fy=3650.1)
    lens = FisheyePolynomial(k2=0.01, k3=-0.06, k4=0.002)
    data, _ = parsers.encode([replace(camera(lens), intrinsics=K)], "opf_calibrated_cameras")
    internals = json.loads(data)["sensors"][0]["internals"]
    assert internals["affine"] == pytest.approx([3650.1 * np.pi / 2, 0, 0, 3650.1 * np.pi / 2])
    assert internals["polynomial"] == pytest.approx(
        [0, 1, 0.01 * np.pi / 2, -0.06 * (np.pi / 2) ** 2, 0.002 * (np.pi / 2) ** 3]
    )
    assert internals["is_symmetric_affine"] is True


def test_opencvs_fisheye_is_refitted() -> None:
    K = replace(camera().intrinsics, fy=3650.1)
    lens = KannalaBrandt(k1=-0.03, k2=0.001, k3=0.0, k4=0.0)
    original = replace(camera(lens), intrinsics=K, camera=CameraKey(image_size=SIZE))
    _, verdict = parsers.encode([original], "opf_calibrated_cameras")
    assert 0 < verdict.max_px < 0.05
