"""Australis' report, against the correction of the measured point in mm, y up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Grade, Quality
from calibrary.distortion import Australis, BrownConrady, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers.format import Fidelity
from calibrary.records import replace
from tests.parsers.cameras import SIZE, camera

FINAL = {
    "C": 8.7602, "XP": -0.0281, "YP": 0.0214, "K1": 1.4738e-3, "K2": -3.20e-6, "K3": 7.9e-9,
    "P1": 1.75e-5, "P2": -8.64e-6, "B1": -4.3e-4, "B2": 1.8e-5,
}  # fmt: skip


def table(number: int = 1, name: str = "Nadir camera", changes: dict[str, float] | None = None) -> str:
    rows = "".join(
        f"{key:>5}  0.0000   {value:.3e}   {value:.8e}   1.0e+003   6.782e-003 {'(mm)' if key in ('C', 'XP') else ''}\n"
        for key, value in (FINAL | (changes or {})).items()
    )
    return (
        f"Results for Camera {number}    {name}      Lens\n\n"
        "Sensor Size        Pixel Size (mm)\n  H    5472           0.0024\n  V    3648           0.00241\n\n"
        "  Camera    Initial      Total          Final        Initial         Final\n"
        f" Variable    Value     Adjustment       Value       Std. Error     Std. Error\n\n{rows}\n"
    )


HEADING = """\
Australis Bundle Adjustment Results:  Camera Parameters

                                        03 May, 2024   14:11:14

Project:  C:\\secret\\flight.aus
Adjustment: Free-Network
Number of Points: 145
Number of Images: 9
RMS of Image coords:    0.48 (um)

"""
END = "Maximum Observational Radial Distance Encountered:      7.9 mm\n"
REPORT = HEADING + table() + END


def read(text: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="report.txt")


def test_the_measured_point_is_corrected_by_frasers_formula() -> None:
    [calibration] = read(REPORT)
    u, v = np.meshgrid(np.linspace(0, 5472, 17), np.linspace(0, 3648, 13))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    f = FINAL
    x = (pixels[:, 0] - 2736) * 0.0024 - f["XP"]
    y = (1824 - pixels[:, 1]) * 0.00241 - f["YP"]
    r2 = x**2 + y**2
    radial = f["K1"] * r2 + f["K2"] * r2**2 + f["K3"] * r2**3
    xc = x + x * radial + f["P1"] * (r2 + 2 * x**2) + 2 * f["P2"] * x * y + f["B1"] * x + f["B2"] * y
    yc = y + y * radial + f["P2"] * (r2 + 2 * y**2) + 2 * f["P1"] * x * y
    rays = np.column_stack([xc / f["C"], -yc / f["C"], np.ones(len(x))])
    np.testing.assert_allclose(calibration.project(rays), pixels, rtol=0, atol=1e-9)
    back = calibration.unproject(pixels)
    np.testing.assert_allclose(back / back[:, 2:], rays, rtol=0, atol=1e-13)


def test_the_final_values_make_k() -> None:
    [calibration] = read(REPORT)
    K = calibration.intrinsics
    assert (K.fx, K.fy) == pytest.approx((8.7602 / 0.0024, 8.7602 / 0.00241), rel=1e-14)
    assert (K.cx, K.cy) == pytest.approx((2736 - 0.0281 / 0.0024, 1824 - 0.0214 / 0.00241), rel=1e-14)
    assert calibration.grade is Grade.CALIBRATED
    assert "y pointing up" in calibration.notes[0]


def test_how_good_it_is_comes_in_pixels() -> None:
    quality = read(REPORT)[0].quality
    assert quality is not None
    assert quality.rms_px == pytest.approx(0.2)
    assert (quality.points, quality.views) == (145, 9)
    assert quality.std == pytest.approx(
        {"fx": 6.782e-3 / 0.0024, "fy": 6.782e-3 / 0.00241, "cx": 6.782e-3 / 0.0024, "cy": 6.782e-3 / 0.00241}
    )


def test_no_folder_of_somebodys_disk_is_kept() -> None:
    assert "secret" not in repr(read(REPORT))


def test_several_cameras_come_in_order_by_name_and_one_alone_needs_none() -> None:
    assert read(REPORT)[0].camera.sub_camera is None
    cameras = read(HEADING + table() + table(2, "Oblique", {"C": 12.5}) + END)
    assert [item.camera.sub_camera for item in cameras] == ["Nadir camera", "Oblique"]
    assert cameras[1].intrinsics.fx == pytest.approx(12.5 / 0.0024)


def test_zeros_are_no_distortion() -> None:
    zeros = dict.fromkeys(("K1", "K2", "K3", "P1", "P2", "B1", "B2"), 0.0)
    assert read(HEADING + table(changes=zeros) + END)[0].distortion == NoDistortion()


@pytest.mark.parametrize(
    ("was", "is_now", "message"),
    [
        ("   K3  ", "   KX  ", "line 11: its table lacks K3"),
        ("  H    5472           0.0024\n", "", "lacks H size"),
        ("V    3648           0.00241", "V    3648           0", "not positive"),
        ("V    3648 ", "V    3648.5 ", "image size"),
        ("8.76020000e+00", "8,7602", "decimal point"),
        ("   K2  0.0000", "   K1  0.0000", "K1 is a duplicate key"),
        ("   K2  0.0000", "   K2  ", "4 numbers, expected 5"),
        ("Results for Camera 1", "Results", "no 'Results for Camera'"),
        ("Australis Bundle", "Bundle", "no line 'Australis"),
        ("-4.30000000e-04", "0.5", "affinity"),
    ],
)
def test_a_broken_report_names_what_is_wrong(was: str, is_now: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parsers.decode(REPORT.replace(was, is_now).encode(), name="report.txt", format="australis_report")


def test_what_is_read_is_written_again_to_the_last_digit() -> None:
    [original] = read(REPORT)
    data, verdict = parsers.encode([original], "australis_report")
    [copy] = read(data.decode())
    assert verdict.outcome is Fidelity.EXACT
    assert copy.extras == original.extras
    assert copy.quality is not None
    assert copy.quality.rms_px == pytest.approx(0.2)
    assert copy.quality.std == pytest.approx(original.quality.std if original.quality else {})


def test_opencvs_direction_is_refitted_never_flipped() -> None:
    brown = BrownConrady(k1=-0.02, k2=0.004, p1=2e-4, p2=-1e-4, k3=0.0)
    data, verdict = parsers.encode([camera(brown)], "australis_report", max_error_px=0.1)
    assert verdict.outcome is Fidelity.REFITTED
    assert 0 < verdict.max_px < 0.1
    [copy] = read(data.decode())
    assert isinstance(copy.distortion, Australis)
    assert copy.distortion.k1 == pytest.approx(0.02, rel=0.1)
    with pytest.raises(UnsupportedModelError, match="--max-error-px"):
        parsers.encode([camera(brown)], "australis_report", max_error_px=1e-9)


def test_the_nominal_focal_length_settles_the_millimetres() -> None:
    known = replace(
        camera(NoDistortion()),
        camera=CameraKey(image_size=SIZE, focal_mm=8.8),
        quality=Quality(points=7, std={"fx": 0.4}),
    )
    data, _ = parsers.encode([known], "australis_report")
    row = next(line for line in data.decode().splitlines() if line.startswith("   C  "))
    assert float(row.split()[3]) == pytest.approx(8.8)
    assert b"Number of Points: 7\n" in data
