"""PhotoModeler's report, against the correction of the measured point in mm, y up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import NoDistortion
from calibrary.errors import MissingTagError, ParseError
from tests.parsers.cameras import SIZE
from tests.parsers.samples import Sample

CAMERA = {
    "F": 8.76024, "Xp": 6.5791, "Yp": 4.3582, "Fw": 13.1328, "Fh": 8.7652, "K1": 1.5e-3, "K2": -3.2e-6,
    "K3": 7.9e-9, "P1": 1.75e-5, "P2": -8.6e-6,
}  # fmt: skip
TITLES = {
    "F": "Focal Length", "Xp": "Xp - principal point x", "Yp": "Yp - principal point y", "Fw": "Fw - format width",
    "Fh": "Fh - format height", "K1": "K1 - radial distortion 1", "K2": "K2 - radial distortion 2",
    "K3": "K3 - radial distortion 3", "P1": "P1 - decentering distortion 1", "P2": "P2 - decentering distortion 2",
}  # fmt: skip


def block(number: int = 1, name: str = "FC6310 [8.80]", **changes: float) -> str:
    rows = [f"            Camera{number}: {name}"]
    for key, value in (CAMERA | changes).items():
        unit = " mm" if key in {"F", "Xp", "Yp", "Fw", "Fh"} else ""
        rows += [f"               {TITLES[key]}", f"                    Value: {value:.9g}{unit}"]
        if key in {"F", "Xp", "K1"}:
            rows.append(f"                    Deviation: {'Focal' if key == 'F' else key}: 0.0048{unit}  ")
            rows.append("                    Correlations over  95.0%: K2:-96.4%")
    return "\n".join(rows) + "\n"


def report(*blocks: str) -> str:
    return (
        "\n\nStatus Report Tree\n   Project Name: p.pmr\n   Information from most recent processing\n"
        "      Last Processing Attempt: Fri Oct 06 15:18:09 2017\n"
        "      Version: PhotoModeler UAS 2017.1.1.2199 (64-bit)\n"
        "      Precisions / Standard Deviations\n"
        + ("         Camera Calibration Standard Deviations\n" if blocks else "")
        + "".join(blocks)
        + "         Photograph Standard Deviations\n            Photo 1: a.jpg\n"
        "                    Value: -39.4 deg\n"
        "   Quality\n      Photographs\n         Number Oriented: 21\n"
        "      Point Marking Residuals\n         Overall RMS: 0.229 pixels\n"
    )


def read(text: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="report.txt", image_size=SIZE)


SAMPLES = {"photomodeler_report": Sample(report(block()).encode())}


def test_the_measured_point_is_corrected_by_photomodelers_formula() -> None:
    [calibration] = read(report(block()))
    u, v = np.meshgrid(np.linspace(0, 5472, 17), np.linspace(0, 3648, 13))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    c = CAMERA
    x = pixels[:, 0] * c["Fw"] / 5472 - c["Xp"]
    y = -(pixels[:, 1] * c["Fh"] / 3648 - c["Yp"])
    r2 = x**2 + y**2
    dr = c["K1"] * r2 + c["K2"] * r2**2 + c["K3"] * r2**3
    xc = x + x * dr + c["P1"] * (r2 + 2 * x**2) + 2 * c["P2"] * x * y
    yc = y + y * dr + c["P2"] * (r2 + 2 * y**2) + 2 * c["P1"] * x * y
    rays = np.column_stack([xc / c["F"], -yc / c["F"], np.ones(len(x))])
    np.testing.assert_allclose(calibration.project(rays), pixels, rtol=0, atol=1e-9)
    assert calibration.grade is Grade.CALIBRATED


def test_how_good_it_is_comes_in_pixels_and_what_was_fixed_has_no_deviation() -> None:
    quality = read(report(block()))[0].quality
    assert quality is not None
    assert (quality.rms_px, quality.views) == (0.229, 21)
    assert quality.std == pytest.approx(
        {"fx": 0.0048 * 5472 / 13.1328, "fy": 0.0048 * 3648 / 8.7652, "cx": 0.0048 * 5472 / 13.1328}
    )


def test_several_cameras_come_in_order_by_name() -> None:
    cameras = read(report(block(), block(4, "Tele", F=20.0)))
    assert [item.camera.sub_camera for item in cameras] == ["FC6310 [8.80]", "Tele"]
    assert cameras[1].intrinsics.fx == pytest.approx(20.0 * 5472 / 13.1328)


def test_zeros_are_no_distortion() -> None:
    flat = block(K1=0.0, K2=0.0, K3=0.0, P1=0.0, P2=0.0)
    assert read(report(flat))[0].distortion == NoDistortion()


def test_the_size_is_asked_for() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(report(block()).encode(), name="report.txt")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (report(), "without calibration"),
        (report(block()).replace("K3 - radial", "KX - radial"), "K2 is a duplicate key"),
        (report(block().partition("               P2 - ")[0]), "line 10: it lacks P2"),
        (report(block(Fw=0.0)), "format is 0"),
        (report(block()).replace("8.76024 mm", "8,76024 mm"), "decimal point"),
        ("Report\n", "no line 'Status"),
    ],
)
def test_a_broken_report_names_what_is_wrong(text: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parsers.decode(text.encode(), name="report.txt", format="photomodeler_report", image_size=SIZE)
