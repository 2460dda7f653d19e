"""PhotoModeler's export: the same camera as its report's, with fewer digits and the image size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.errors import ParseError
from tests.parsers.samples import Sample

CAMERA = "8.7602  6.5791  4.3582 13.13280 8.75520 0.00148 -0.00010 0.00001 -0.00006 0.00004"
HEAD = f"""\
Bundle Soln PhotoModeler Calibration Project
 0.000500 20 5472 3648
 1.00000  0.10000 10.00000 100.00000 100.00000 100.00000 20.00000 20.00000 20.00000
 {CAMERA}
 0.00000  0.00725  0.00544 0.500000 0.500000 0.001000 0.000100 0.000100 0.001000 0.001000
"""


def photo(number: int, name: str, focal: str = "8.760") -> str:
    return (
        f"   {number} photos/{name}\n"
        f"   {number}    0.455    1.794    1.468 -179.839   -1.181  -39.420\n"
        f"   {number}   0.0002   0.0002   0.0002   0.0029   0.0080   0.0090\n\n"
        f"   {number}   {focal}   6.579   4.358 13.13280 8.75520 0.00148 -0.00010 0.00001 -0.00006 0.00004\n"
        f"   {number}  0.00000  0.00725  0.00544 0.500000 0.500000 0.001000 0.0001 0.0001 0.001 0.001\n"
    )


POINTS = " 1001   1   0.5  0.25  0.0\n 1001   2   0.5  0.25  0.0\n"


def read(text: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="export.txt")


SAMPLES = {"photomodeler_export": Sample((HEAD + photo(1, "a.jpg") + POINTS).encode())}


def test_the_projects_camera_corrects_the_measured_point_by_photomodelers_formula() -> None:
    [calibration] = read(HEAD + photo(0, "a.jpg") + photo(1, "b.jpg") + POINTS)
    F, xp, yp, fw, fh, K1, K2, K3, P1, P2 = (float(value) for value in CAMERA.split())
    u, v = np.meshgrid(np.linspace(2000, 3500, 17), np.linspace(1200, 2400, 13))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    x, y = pixels[:, 0] * fw / 5472 - xp, -(pixels[:, 1] * fh / 3648 - yp)
    r2 = x**2 + y**2
    dr = K1 * r2 + K2 * r2**2 + K3 * r2**3
    xc = x + x * dr + P1 * (r2 + 2 * x**2) + 2 * P2 * x * y
    yc = y + y * dr + P2 * (r2 + 2 * y**2) + 2 * P1 * x * y
    rays = np.column_stack([xc / F, -yc / F, np.ones(len(x))])
    np.testing.assert_allclose(calibration.project(rays), pixels, rtol=0, atol=1e-9)
    assert "five decimals" in calibration.notes[0]


def test_photos_that_have_the_projects_camera_give_it_once() -> None:
    [calibration] = read(HEAD + photo(0, "a.jpg") + photo(1, "b.jpg"))
    assert calibration.camera.sub_camera is None
    assert calibration.intrinsics.fx == pytest.approx(8.7602 * 5472 / 13.1328)


def test_photos_with_cameras_of_their_own_give_each_of_them() -> None:
    cameras = read(HEAD + photo(0, "a b.jpg") + photo(1, "c.jpg", "20.000") + photo(2, "d.jpg"))
    assert [item.camera.sub_camera for item in cameras] == ["photos/a b.jpg", "photos/c.jpg"]


@pytest.mark.parametrize(
    ("was", "is_now", "message"),
    [
        (" 5472 3648", " 5472", "line 2: 3 numbers, expected 4"),
        (" 5472 3648", " 0 3648", "image size"),
        ("8.7602  6.5791", "8.7602", "line 4: 9 numbers, expected 10"),
        ("8.7602", "-8.7602", "focal lengths"),
        ("13.13280 8.75520 0.00148", "0 8.75520 0.00148", "format is 0"),
        ("Bundle Soln", "Bundle", "not a head"),
    ],
)
def test_a_broken_export_names_what_is_wrong(was: str, is_now: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parsers.decode(HEAD.replace(was, is_now, 1).encode(), name="e.txt", format="photomodeler_export")
