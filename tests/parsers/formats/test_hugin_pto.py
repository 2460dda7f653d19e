"""Hugin's projects, against libpano's formula."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.samples import Sample

FILE = """# hugin project file
#hugin_ptoversion 2
p f2 w3000 h1500 v360  k0 E0 R0 n"TIFF_m c:LZW r:CROP"
m i0

# image lines
#-hugin  cropFactor=1.5
i w4000 h3000 f0 v65.47 Ra0 Eev0 r0 p0 y0 TrX0 a0 b-0.0121 c0 d12.3 e-4.5 g0 t0 Va1  Vm5 n"IMG 1.jpg"
i w4000 h3000 f0 v=0 Ra=0 r0 p0 y40 a=0 b=0 c=0 d=0 e=0 g=0 t=0 Va=0  Vm5 n"IMG 2.jpg"
i w1200 h1600 f3 v120 a0 b0.05 c0 d0 e0 n"sub/fish.jpg"

v b0
"""
SAMPLES = {"hugin_pto": Sample(FILE.encode())}


def read(text: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="pano.pto")


def seen(
    angle: float, fisheye: bool, width: int, height: int, v: float, b: float, a: float = 0.0, c: float = 0.0
) -> float:
    """libpano: the distorted radius, px, of a ray at an angle from the axis."""
    half = math.radians(v) / 2
    ideal = width / 2 * (angle / half if fisheye else math.tan(angle) / math.tan(half))
    rho = ideal / (min(width, height) / 2)
    return ideal * (1 - a - b - c + c * rho + b * rho**2 + a * rho**3)


@pytest.mark.parametrize(
    ("index", "fisheye", "width", "height", "v", "b", "d", "e"),
    [(0, False, 4000, 3000, 65.47, -0.0121, 12.3, -4.5), (1, True, 1200, 1600, 120.0, 0.05, 0.0, 0.0)],
)
def test_a_ray_is_where_libpano_puts_it(
    index: int, fisheye: bool, width: int, height: int, v: float, b: float, d: float, e: float
) -> None:
    item = read(FILE)[index]
    for angle in (0.05, 0.2, 0.5):
        u, w = item.project(np.array([[math.sin(angle) * 0.6, math.sin(angle) * 0.8, math.cos(angle)]]))[0]
        radius = seen(angle, fisheye, width, height, v, b)
        assert (u, w) == pytest.approx(
            (width / 2 + d + 0.6 * radius, height / 2 + e + 0.8 * radius), abs=1e-9
        )


@pytest.mark.parametrize(
    ("index", "fisheye", "size", "v"), [(0, False, (4000, 3000), 65.47), (1, True, (1200, 1600), 120)]
)
def test_odd_powers_are_read_as_well(index: int, fisheye: bool, size: tuple[int, int], v: float) -> None:
    odd = FILE.replace("a0 b-0.0121 c0 d12.3 e-4.5", "a0.012 b0.05 c-0.03 d0 e0").replace(
        "a0 b0.05 c0", "a0.012 b0.05 c-0.03"
    )
    item = read(odd)[index]
    for angle in (0.05, 0.2, 0.5):
        [[u, _]] = item.project(np.array([[math.sin(angle), 0.0, math.cos(angle)]]))
        assert u == pytest.approx(size[0] / 2 + seen(angle, fisheye, *size, v, 0.05, 0.012, -0.03), abs=1e-9)


def test_images_of_one_lens_are_read_once_and_named() -> None:
    first, second = read(FILE)
    assert [item.camera.sub_camera for item in (first, second)] == ["image 0, IMG 1.jpg", "image 1, fish.jpg"]
    assert first.provenance.tag == "IMG 1.jpg"
    assert "libpano" in first.provenance.assumptions[0]


def test_without_a_polynomial_there_is_no_distortion() -> None:
    assert read(FILE.replace("b-0.0121", "b0"))[0].distortion == NoDistortion()


@pytest.mark.parametrize(
    ("old", "new", "kind", "match"),
    [
        ("f0 v65", "f1 v65", UnsupportedModelError, "projection f1"),
        ("g0 t0", "g3 t0", UnsupportedModelError, "sheared"),
        ("v65.47", "v200", ParseError, "field of view"),
        ("v65.47", "v1e-200", ParseError, "no finite terms"),
        ("v=0", "v=9", ParseError, "refers to image 9"),
        ("v=0", "v=1", ParseError, "refers to image 1"),
        ("b-0.0121", "b1", ParseError, "below 1"),
        ("d12.3", "d12.3.4", ParseError, "not a number"),
        ("w4000", "w0", ParseError, "image size"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: str, new: str, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        read(FILE.replace(old, new))
