"""The USGS report, against its own equations in mm, y up."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import InverseBrown, InversePolynomial
from calibrary.errors import MissingTagError, ParseError
from tests.parsers.samples import Sample

SIZE = (11430, 11430)
REPORT = """\
USGS Report No. OSL/0000
United States Department of the Interior
REPORT OF CALIBRATION   May 3, 2001
of Aerial Mapping Camera
Camera type: Acme RC99   Camera serial no.: 4711
Lens type: Acme Aviogon /4   Lens serial no.: 4712
I. Calibrated Focal Length: 152.881 mm
K0 = 0.3117 x 10-4   P1 = -0.1218 x 10-7   xp = 0.016 mm
K1 = -0.5113 x 10-8  P2 = -0.4226 x 10-7   yp = -0.011 mm
K2 = 0.1512 x 10-12  P3 = 0.0000
K3 = 0.0000          P4 = 0.0000
K4 = 0.0000
"""
GROWING = REPORT.replace("P3 = 0.0000", "P3 = 0.211 x 10^-4").replace("P4 = 0.0000", "P4 = -3.1E-10")


def read(text: str, scan_um: str = "20") -> Calibration:
    [calibration] = parsers.decode(
        text.encode(), name="osl.txt", image_size=SIZE, options={"scan_um": scan_um}
    )
    return calibration


SAMPLES = {"usgs_report": Sample(REPORT.encode(), options={"scan_um": "20"})}


@pytest.mark.parametrize(
    ("text", "P3", "P4", "kind"),
    [(REPORT, 0.0, 0.0, InverseBrown), (GROWING, 0.211e-4, -3.1e-10, InversePolynomial)],
)
def test_the_measured_point_is_corrected_by_the_reports_equations(
    text: str, P3: float, P4: float, kind: type[InverseBrown]
) -> None:
    calibration = read(text)
    u, v = np.meshgrid(np.linspace(0, 11430, 17), np.linspace(0, 11430, 17))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    x, y = (pixels[:, 0] - 5715) * 0.02 - 0.016, (5715 - pixels[:, 1]) * 0.02 + 0.011
    r2 = x**2 + y**2
    radial = 1 + 0.3117e-4 - 0.5113e-8 * r2 + 0.1512e-12 * r2**2
    P1, P2, growth = -0.1218e-7, -0.4226e-7, 1 + P3 * r2 + P4 * r2**2
    xc = x * radial + (P1 * (r2 + 2 * x**2) + 2 * P2 * x * y) * growth
    yc = y * radial + (P2 * (r2 + 2 * y**2) + 2 * P1 * x * y) * growth
    rays = np.column_stack([xc / 152.881, -yc / 152.881, np.ones(len(x))])
    np.testing.assert_allclose(calibration.project(rays), pixels, rtol=0, atol=1e-9)
    assert isinstance(calibration.distortion, kind)


def test_the_linear_term_joins_the_focal_length() -> None:
    K = read(REPORT).intrinsics
    assert K.fx == K.fy == pytest.approx(152.881 / (1 + 0.3117e-4) / 0.02, rel=1e-14)
    assert (K.cx, K.cy) == pytest.approx((5715 + 0.8, 5715 + 0.55), rel=1e-14)


def test_camera_and_lens_are_named_but_no_serial_number_is_kept() -> None:
    calibration = read(REPORT)
    assert (calibration.camera.model, calibration.camera.lens) == ("Acme RC99", "Acme Aviogon /4")
    assert "471" not in repr(calibration)
    assert calibration.grade is Grade.CALIBRATED


def test_what_was_taken_for_granted_of_the_scan_is_said() -> None:
    [assumption] = read(REPORT, "12.5").provenance.assumptions
    assert "12.5 µm" in assumption
    assert "fiducial" in assumption


def test_the_scans_pixel_size_is_asked_for() -> None:
    with pytest.raises(MissingTagError, match="scan_um"):
        parsers.decode(REPORT.encode(), name="osl.txt", image_size=SIZE)


@pytest.mark.parametrize(
    ("was", "is_now"),
    [
        ("K0 =", "Ko ="),
        ("x 10-4", "× 10⁻⁴"),
        ("x 10-4", "x 10 -4"),
        ("x 10-4", "x 10**-4"),
        ("-0.1218", "−0.1218"),
    ],
)
def test_what_a_scanner_makes_of_the_print_is_read(was: str, is_now: str) -> None:
    assert read(REPORT.replace(was, is_now)) == read(REPORT).__class__(
        **{
            name: getattr(read(REPORT), name)
            for name in ("camera", "intrinsics", "distortion", "grade", "quality", "notes", "extras")
        },
        provenance=read(REPORT.replace(was, is_now)).provenance,
    )


@pytest.mark.parametrize(
    ("was", "is_now", "message"),
    [
        ("K4 = 0.0000", "", "there is no K4"),
        ("yp = -0.011 mm", "", "there is no yp"),
        ("x 10-4", "x 104", "sign of the exponent"),
        ("152.881", "152,881", "decimal point"),
        ("Calibrated Focal", "Focal", "no 'Calibrated"),
        ("K4 = 0.0000", "K4 = 0.0000\nK1 = 0.7 x 10-8", "K1: it is"),
        ("K4 = 0.0000", "K4 = 0.0.0", "not a number"),
        ("152.881", "-152.881", "focal lengths"),
        ("K0 = 0.3117 x 10-4", "K0 = -2", "small scale"),
    ],
)
def test_a_broken_report_names_what_is_wrong(was: str, is_now: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parsers.decode(
            REPORT.replace(was, is_now).encode(), name="osl.txt", format="usgs_report", image_size=SIZE,
            options={"scan_um": "20"},
        )  # fmt: skip
