"""Kalibr's chains, against OpenCV where it has the model and against the models' own formulas where not."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    DoubleSphere,
    ExtendedUnified,
    FieldOfView,
    KannalaBrandt,
    NoDistortion,
    Unified,
)
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers.format import Fidelity
from calibrary.records import replace
from tests.parsers.cameras import BROWN, camera

Array = NDArray[np.float64]
FU, FV, PU, PV = 433.2, 432.9, 371.6, 238.3
FOCAL = f"{FU}, {FV}, {PU}, {PV}"


def chain(model: str, intrinsics: str, kind: str, coefficients: str, name: str = "cam0") -> str:
    return (
        f"{name}:\n  cam_overlaps: []\n  camera_model: {model}\n  distortion_coeffs: [{coefficients}]\n"
        f"  distortion_model: {kind}\n  intrinsics: [{intrinsics}]\n  resolution: [752, 480]\n"
        f"  rostopic: /{name}/image_raw\n"
    )


RADTAN = chain("pinhole", FOCAL, "radtan", "-0.2131, 0.0447, -0.00037, 8.1e-04")


def read(text: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="camchain.yaml")


def one(text: str) -> Calibration:
    [calibration] = read(text)
    return calibration


def rays(widest: float = 0.8) -> Array:
    u, v = np.meshgrid(np.linspace(-widest, widest, 25), np.linspace(-widest, widest, 25))
    return np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])


def pixels(m: Array) -> Array:
    """What Kalibr makes of a point of the normalised plane, counted from the corner."""
    return np.asarray(m * [FU, FV] + [PU, PV] + 0.5)


def test_radtan_projects_as_opencv() -> None:
    matrix = np.array([[FU, 0, PU], [0, FV, PV], [0, 0, 1]])
    D = np.array([-0.2131, 0.0447, -0.00037, 0.00081])
    expected = cv2.projectPoints(rays(), np.zeros(3), np.zeros(3), matrix, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(one(RADTAN).project(rays()) - 0.5, expected, rtol=0, atol=1e-9)


def test_equidistant_projects_as_opencvs_fisheye() -> None:
    calibration = one(chain("pinhole", FOCAL, "equidistant", "-0.0292, 0.0208, -0.0319, 0.0166"))
    matrix = np.array([[FU, 0, PU], [0, FV, PV], [0, 0, 1]])
    D = np.array([-0.0292, 0.0208, -0.0319, 0.0166])
    points = rays().reshape(-1, 1, 3)
    expected = cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), matrix, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(calibration.project(rays()) - 0.5, expected, rtol=0, atol=1e-9)


def test_omni_projects_through_the_mirror_and_then_the_plane() -> None:
    calibration = one(chain("omni", f"0.671, {FOCAL}", "radtan", "-0.1524, 0.0421, 0.0004, 0.001"))
    P = np.vstack([rays(), [[1.0, 0.2, -0.1], [-0.3, 1.0, -0.2], [0.0, -1.0, 0.0]]])
    x, y = (P[:, :2] / (P[:, 2:] + 0.671 * np.linalg.norm(P, axis=1, keepdims=True))).T
    r2 = x * x + y * y
    radial = 1 - 0.1524 * r2 + 0.0421 * r2 * r2
    xd = x * radial + 2 * 0.0004 * x * y + 0.001 * (r2 + 2 * x * x)
    yd = y * radial + 0.0004 * (r2 + 2 * y * y) + 2 * 0.001 * x * y
    seen = calibration.project(P)
    inside = np.isfinite(seen[:, 0])
    assert inside[: len(rays())].all()
    np.testing.assert_allclose(seen[inside], pixels(np.stack([xd, yd], axis=1))[inside], rtol=0, atol=1e-9)


def test_eucm_projects_by_its_formula() -> None:
    calibration = one(chain("eucm", f"0.59, 1.127, {FOCAL}", "none", ""))
    P = rays()
    d = np.sqrt(1.127 * (P[:, 0] ** 2 + P[:, 1] ** 2) + P[:, 2] ** 2)
    m = P[:, :2] / (0.59 * d + 0.41 * P[:, 2])[:, None]
    np.testing.assert_allclose(calibration.project(P), pixels(m), rtol=0, atol=1e-9)


def test_ds_projects_by_its_formula() -> None:
    calibration = one(chain("ds", f"-0.27, 0.56, {FOCAL}", "none", ""))
    P = rays()
    k = -0.27 * np.linalg.norm(P, axis=1) + P[:, 2]
    d2 = np.sqrt(P[:, 0] ** 2 + P[:, 1] ** 2 + k * k)
    m = P[:, :2] / (0.56 * d2 + 0.44 * k)[:, None]
    np.testing.assert_allclose(calibration.project(P), pixels(m), rtol=0, atol=1e-9)


def test_fov_projects_by_its_formula() -> None:
    calibration = one(chain("pinhole", FOCAL, "fov", "0.92"))
    P = rays()
    r = np.hypot(P[:, 0], P[:, 1])
    scale = np.arctan(2 * r * np.tan(0.46)) / 0.92 / np.where(r > 0, r, 1)
    np.testing.assert_allclose(calibration.project(P), pixels(P[:, :2] * scale[:, None]), rtol=0, atol=1e-9)


def test_what_the_focal_length_means_is_said_where_it_is_not_the_pinholes() -> None:
    for text in (chain("omni", f"0.5, {FOCAL}", "none", ""), chain("ds", f"-0.2, 0.6, {FOCAL}", "none", "")):
        calibration = one(text)
        assert calibration.intrinsics.fx == FU
        assert "fu/(1 + xi)" in calibration.notes[0]
    assert one(RADTAN).notes == ()


def test_a_pinhole_without_distortion_is_read_in_both_spellings() -> None:
    assert one(chain("pinhole", FOCAL, "none", "")).distortion == NoDistortion()
    assert one(chain("pinhole", FOCAL, "radtan", "0.0, 0.0, 0.0, 0.0")).distortion == NoDistortion()


def test_a_chain_gives_every_camera_with_its_name() -> None:
    second = chain("ds", f"-0.2, 0.6, {FOCAL}", "none", "", name="cam1")
    cameras = read(RADTAN + second + "  T_cn_cnm1:\n  - [1.0, 0.0, 0.0, -0.11]\n")
    assert [item.camera.sub_camera for item in cameras] == ["cam0", "cam1"]
    assert [item.provenance.tag for item in cameras] == ["cam0", "cam1"]
    assert ("kalibr/T_cn_cnm1", "[[1.0, 0.0, 0.0, -0.11]]") in cameras[1].extras


def test_a_single_camera_may_stand_alone_and_under_opencvs_directive() -> None:
    bare = "\n".join(line.strip() for line in RADTAN.splitlines()[1:]) + "\n"
    assert one(bare).distortion == one(RADTAN).distortion == one("%YAML:1.0\n" + RADTAN).distortion


def test_a_chain_goes_back_with_all_that_it_said() -> None:
    second = chain("eucm", f"0.6, 1.1, {FOCAL}", "none", "", name="cam1")
    text = RADTAN + second + "  T_cn_cnm1:\n  - [1.0, 0.0, 0.0, -0.11]\n  timeshift_cam_imu: 1e-05\n"
    data, verdict = parsers.encode(read(text), "kalibr")
    document = yaml.safe_load(data)
    assert verdict.outcome is Fidelity.EXACT
    assert verdict.dropped == ()
    assert document == yaml.safe_load(text.replace("1e-05", "1.0e-05"))


def test_transforms_do_not_survive_a_change_of_order() -> None:
    second = chain("pinhole", FOCAL, "none", "", name="cam1") + "  T_cn_cnm1: [[1.0]]\n"
    data, verdict = parsers.encode(read(RADTAN + second)[::-1], "kalibr")
    assert b"T_cn_cnm1" not in data
    assert "kalibr/T_cn_cnm1" in verdict.dropped


@pytest.mark.parametrize(
    ("lens", "model", "kind", "special", "coefficients"),
    [
        (NoDistortion(), "pinhole", "radtan", [], [0.0] * 4),
        (
            BrownConrady(k1=-0.1, k2=1e-05, p1=0.0, p2=0.001),
            "pinhole",
            "radtan",
            [],
            [-0.1, 1e-05, 0.0, 0.001],
        ),
        (
            KannalaBrandt(k1=0.03, k2=-0.007, k3=0.004, k4=0.0),
            "pinhole",
            "equidistant",
            [],
            [0.03, -0.007, 0.004, 0.0],
        ),
        (Unified(xi=0.7, k1=-0.1, k2=0.02), "omni", "radtan", [0.7], [-0.1, 0.02, 0.0, 0.0]),
        (Unified(xi=0.7), "omni", "none", [0.7], []),
        (ExtendedUnified(alpha=0.6, beta=1.1), "eucm", "none", [0.6, 1.1], []),
        (DoubleSphere(xi=-0.2, alpha=0.6), "ds", "none", [-0.2, 0.6], []),
        (FieldOfView(omega=0.9), "pinhole", "fov", [], [0.9]),
    ],
    ids=lambda value: value.model if isinstance(value, Distortion) else "",
)
def test_every_model_is_written_in_kalibrs_terms(
    lens: Distortion, model: str, kind: str, special: list[float], coefficients: list[float]
) -> None:
    data, verdict = parsers.encode([camera(lens)], "kalibr")
    written = yaml.safe_load(data)["cam0"]
    assert verdict.outcome is Fidelity.EXACT
    assert (written["camera_model"], written["distortion_model"]) == (model, kind)
    assert written["distortion_coeffs"] == coefficients
    assert written["intrinsics"] == [*special, 3650.1, 3648.7, 2741.3 - 0.5, 1815.9 - 0.5]
    assert written["resolution"] == [5472, 3648]
    assert parsers.decode(data, name="chain.yaml")[0].distortion == lens


def test_k3_is_refitted_within_the_limit_or_refused() -> None:
    mild = camera(replace(BROWN, k3=-0.0001))
    data, verdict = parsers.encode([mild], "kalibr")
    assert verdict.outcome is Fidelity.REFITTED
    assert 0 < verdict.max_px < 0.05
    assert yaml.safe_load(data)["cam0"]["distortion_model"] == "radtan"
    with pytest.raises(UnsupportedModelError, match="--max-error-px"):
        parsers.encode([mild], "kalibr", max_error_px=1e-9)


def test_names_that_are_not_kalibrs_are_lost_and_named() -> None:
    pair = [
        replace(camera(), camera=CameraKey(sub_camera=side, image_size=(5472, 3648)))
        for side in ("left", "right")
    ]
    pair = [replace(item, distortion=NoDistortion()) for item in pair]
    _, verdict = parsers.encode(pair, "kalibr")
    assert "sub camera" in verdict.dropped


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (RADTAN.replace("pinhole", "cahvore"), "cahvore"),
        (RADTAN.replace("radtan", "radtan8"), "radtan8"),
        (chain("eucm", f"0.6, 1.1, {FOCAL}", "radtan", "0.1, 0.1, 0.1, 0.1"), "'eucm radtan'"),
    ],
)
def test_another_model_is_refused_by_name(text: str, match: str) -> None:
    with pytest.raises(UnsupportedModelError, match=match):
        read(text)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (chain("omni", FOCAL, "radtan", "0.1, 0.1, 0.1, 0.1"), "3 numbers, expected 4"),
        (chain("pinhole", FOCAL, "radtan", "0.1, 0.1, 0.1, 0.1, 0.1"), "5 numbers, expected 4"),
        (chain("eucm", f"1.6, 1.1, {FOCAL}", "none", ""), "alpha"),
        (chain("ds", f"-1.0, 0.6, {FOCAL}", "none", ""), "xi"),
        (chain("omni", f"-0.1, {FOCAL}", "none", ""), "xi"),
        (chain("pinhole", FOCAL, "fov", "53.0"), "degrees"),
        (RADTAN.replace("[752, 480]", "[752]"), "1 numbers"),
        (RADTAN.replace("resolution", "size"), "'resolution'"),
        (RADTAN + RADTAN, "duplicate key"),
    ],
)
def test_a_broken_file_names_what_is_wrong(text: str, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        read(text)


def test_a_camera_may_have_any_name() -> None:
    two = RADTAN.replace("cam0", "camera_center") + RADTAN.replace("cam0", "rear")
    assert [item.camera.sub_camera for item in read(two)] == ["camera_center", "rear"]
    assert one(RADTAN.replace("cam0", "camera_center")).intrinsics == one(RADTAN).intrinsics
