"""The Stereo Pipeline's cameras, against the arithmetic of Vision Workbench written down here once more."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import (
    FieldOfView,
    InverseBrown,
    InversePolynomial,
    NoDistortion,
    OffCentreBrown,
)
from calibrary.errors import MissingTagError, ParseError, UnsupportedModelError
from tests.parsers.cameras import SIZE, camera

PITCH = 0.0024
FU, FV, CU, CV = 8.76024, 8.75688, 6.5791, 4.3582
TSAI = {"k1": -0.1131, "k2": 0.0247, "p1": -0.00037, "p2": 0.00081, "k3": -0.0062}
METRIC = {"xp": 0.021, "yp": -0.013, "k1": 1.3e-3, "k2": -2.1e-6, "k3": 3.3e-8, "p1": 7.2e-5, "p2": -2.3e-5}


def tsai(lens: str, rows: dict[str, float] | str, *, fv: float = FV, **changes: str) -> str:
    head = {
        "fu": str(FU), "fv": str(fv), "cu": str(CU), "cv": str(CV), "u_direction": "1  0  0",
        "v_direction": "0  1  0", "w_direction": "0  0  1", "C": "266.9 -105.5 -2.1",
        "R": "0.08 0.99 -0.02 -0.99 0.08 0.03 0.03 0.02 0.99", "pitch": str(PITCH),
    }  # fmt: skip
    body = rows if isinstance(rows, str) else "".join(f"{name} = {value}\n" for name, value in rows.items())
    written = "".join(f"{name} = {value}\n" for name, value in (head | changes).items() if value)
    return f"VERSION_4\nPINHOLE\n{written}{lens}\n{body}"


def read(text: str) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="camera.tsai", image_size=SIZE)
    return calibration


def rays() -> NDArray[np.float64]:
    u, v = np.meshgrid(np.linspace(-0.7, 0.7, 15), np.linspace(-0.48, 0.48, 15))
    return np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])


def opencv(D: list[float]) -> NDArray[np.float64]:
    seen = cv2.projectPoints(rays(), np.zeros(3), np.zeros(3), np.eye(3), np.array(D))[0]
    return np.asarray(seen.reshape(-1, 2))


def test_tsai_is_opencvs_model_in_units_of_the_pitch() -> None:
    observed = opencv([-0.1131, 0.0247, -0.00037, 0.00081, -0.0062])
    pixels = (observed * [FU, FV] + [CU, CV]) / PITCH
    calibration = read(tsai("TSAI", TSAI))
    np.testing.assert_allclose(calibration.project(rays()), pixels, rtol=0, atol=1e-9)
    assert calibration.grade is Grade.ADJUSTED
    assert "upper-left corner" in calibration.notes[0]


def test_adjustable_tsai_has_more_radial_terms_and_a_skew() -> None:
    rows = (
        "Radial Coeff: Vector4(-0.1131,0.0247,-0.0062,0.0011)\n"
        "Tangental Coeff: Vector2(-0.00037,0.00081)\nAlpha: 0.0007\n"
    )
    calibration = read(tsai("AdjustableTSAI", rows))
    x, y = opencv([-0.1131, 0.0247, -0.00037, 0.00081, -0.0062]).T
    r2 = (rays()[:, :2] ** 2).sum(axis=1)
    x, y = x + rays()[:, 0] * 0.0011 * r2**4, y + rays()[:, 1] * 0.0011 * r2**4
    pixels = np.stack([FU * (x + 0.0007 * y) + CU, FV * y + CV], axis=1) / PITCH
    np.testing.assert_allclose(calibration.project(rays()), pixels, rtol=0, atol=1e-9)
    assert isinstance(calibration.distortion, OffCentreBrown)


def test_fisheye_is_opencvs() -> None:
    k = {"k1": -0.036, "k2": 0.038, "k3": -0.058, "k4": 0.029}
    seen = cv2.fisheye.projectPoints(
        rays()[:, None], np.zeros(3), np.zeros(3), np.eye(3), np.array(list(k.values()))
    )[0].reshape(-1, 2)
    np.testing.assert_allclose(
        read(tsai("FISHEYE", k)).project(rays()), (seen * [FU, FV] + [CU, CV]) / PITCH, rtol=0, atol=1e-9
    )


def test_fov_is_the_field_of_view_model() -> None:
    x, y, _ = rays().T
    r = np.maximum(np.hypot(x, y), 1e-300)
    scale = np.arctan(r * 2 * np.tan(0.9 / 2)) / 0.9 / r
    pixels = np.stack([FU * x * scale + CU, FV * y * scale + CV], axis=1) / PITCH
    calibration = read(tsai("FOV", {"k1": 0.9}))
    np.testing.assert_allclose(calibration.project(rays())[r > 1e-9], pixels[r > 1e-9], rtol=0, atol=1e-9)
    assert calibration.distortion == FieldOfView(omega=0.9)


def corrected(pixels: NDArray[np.float64], lens: str) -> NDArray[np.float64]:
    """LensDistortion.cc: a measured point in mm to one that a pinhole at (cu, cv) would see, as x/z, y/z."""
    c = METRIC
    x, y = (pixels * PITCH - [CU + c["xp"], CV + c["yp"]]).T
    r2 = x * x + y * y
    drr = c["k1"] * r2 + c["k2"] * r2**2 + c["k3"] * r2**3
    if lens == "Photometrix":
        u = x + c["xp"] + x * drr + c["p1"] * (r2 + 2 * x * x) + 2 * c["p2"] * x * y
        v = y + c["yp"] + y * drr + c["p2"] * (r2 + 2 * y * y) + 2 * c["p1"] * x * y
    else:
        decentring = c["p1"] * r2 + c["p2"] * r2**2
        u, v = x * (1 + drr) - decentring * np.sin(0.7), y * (1 + drr) + decentring * np.cos(0.7)
    return np.stack([u, v], axis=1) / FU


@pytest.mark.parametrize(
    ("lens", "rows", "kind"),
    [
        ("Photometrix", METRIC | {"b1": 0.0, "b2": 0.0}, InverseBrown),
        ("BrownConrady", METRIC | {"phi": 0.7}, InversePolynomial),
    ],
)
def test_the_metric_models_correct_the_measured_point(
    lens: str, rows: dict[str, float], kind: type[InverseBrown]
) -> None:
    calibration = read(tsai(lens, rows, fv=FU))
    u, v = np.meshgrid(np.linspace(0, 5472, 15), np.linspace(0, 3648, 15))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    rays_of = np.column_stack([corrected(pixels, lens), np.ones(len(pixels))])
    np.testing.assert_allclose(calibration.project(rays_of), pixels, rtol=0, atol=1e-9)
    assert isinstance(calibration.distortion, kind)


def test_a_photometrix_affinity_is_left_out_with_a_word_as_the_program_does() -> None:
    calibration = read(tsai("Photometrix", METRIC | {"b1": 1e-4, "b2": 0.0}, fv=FU))
    assert "b1 and b2" in calibration.notes[1]


def test_null_is_no_distortion() -> None:
    assert read(tsai("NULL", "")).distortion == NoDistortion()


def test_files_before_version_3_count_in_pixels_and_name_no_lens() -> None:
    text = tsai("TSAI", TSAI, pitch="").replace("VERSION_4\nPINHOLE\n", "").replace("TSAI\n", "")
    K = read(text).intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (FU, FV, CU, CV)


def test_axes_that_are_turned_are_no_matter_of_k() -> None:
    turned = tsai("TSAI", TSAI, u_direction="0 1 0", v_direction="-1 0 0")
    assert read(turned).intrinsics == read(tsai("TSAI", TSAI)).intrinsics


def test_a_mirrored_image_is_refused() -> None:
    with pytest.raises(UnsupportedModelError, match="mirrored"):
        read(tsai("TSAI", TSAI, v_direction="0 -1 0"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (tsai("RPC", "rpc_degree = 1\n"), "convert_pinhole_model"),
        (tsai("Photometrix", METRIC), "ellipses"),
        (tsai("TSAI", TSAI).replace("PINHOLE", "OPTICAL_BAR"), "expected PINHOLE"),
        (
            tsai(
                "AdjustableTSAI",
                f"Radial Coeff: Vector6({'1,' * 5}1)\nTangential Coeff: Vector2(0,0)\nAlpha: 0\n",
            ),
            "6 radial terms",
        ),
    ],
)
def test_what_has_no_counterpart_is_refused_with_the_way_out(text: str, message: str) -> None:
    with pytest.raises(UnsupportedModelError, match=message):
        read(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (tsai("TSAI", {"k1": 1, "k2": 2, "p1": 3}), "no p2"),
        (tsai("TSAI", TSAI, pitch=""), "no pitch"),
        (tsai("TSAI", TSAI).replace("TSAI\n", ""), "name of a lens"),
        (tsai("TSAI", TSAI, pitch="0"), "pitch is 0"),
        (tsai("TSAI", TSAI, fu="x"), "not a number"),
        (tsai("TSAI", TSAI, C=""), "there is no C"),
        (tsai("TSAI", TSAI) + "k1 = 2\n", "k1 is a duplicate key"),
        (tsai("TSAI", TSAI) + "?\n", "not 'name = value'"),
        (tsai("TSAI", TSAI)[:-1], "cut short"),
        (tsai("Photometrix", METRIC, fv=1e200, fu="1e200"), "finite"),
    ],
)
def test_a_broken_file_names_what_is_wrong(text: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(text)


def test_the_size_is_asked_for() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(tsai("TSAI", TSAI).encode(), name="camera.tsai")


def test_the_pitch_survives_and_the_place_does_not() -> None:
    data, verdict = parsers.encode([read(tsai("TSAI", TSAI))], "asp_tsai")
    assert verdict.dropped == ("image size",)
    assert b"pitch = 0.0024\n" in data
    assert b"C = 0 0 0\n" in data
    assert read(data.decode()).intrinsics.fx == pytest.approx(FU / PITCH, rel=1e-15)


def test_a_camera_from_elsewhere_is_written_in_pixels() -> None:
    data, _ = parsers.encode([camera()], "asp_tsai")
    assert b"\nfu = 3650.1\n" in data
    assert b"\npitch = 1.0\nTSAI\nk1 = -0.1131\n" in data
