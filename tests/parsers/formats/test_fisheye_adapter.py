"""Fisheye-Calib-Adapter's models, each by its formula."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import KannalaBrandt
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers.content import Content
from calibrary.parsers.discovery import known_formats
from tests.parsers.samples import Sample

HEAD = "image:\n  width: 752\n  height: 480\nparameter:\n"
PINHOLE = "  fx: 348.1\n  fy: 347.1\n  cx: 365.8\n  cy: 249.3\n"
DS = f"{HEAD}{PINHOLE}  alpha: 0.5657\n  xi: -0.2443\n"
OCAM = (
    f"{HEAD}  c: 0.9989\n  d: -0.0002\n  e: 0.0\n  cx: 359.8\n  cy: 243.6\n  coefficients:\n"
    "    projection: [287.9, 140.1, -12.7]\n    unprojection: [209.3, 0.0, -0.0022, 5.1e-06, -2.1e-08]\n"
)
SAMPLES = {"fisheye_adapter": Sample(DS.encode())}


def read(text: str, name: str = "DS.yml", **options: str) -> Calibration:
    [item] = parsers.decode(text.encode(), name=name, options=options)
    return item


def rays() -> NDArray[np.float64]:
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 9), np.linspace(-0.6, 0.6, 7))
    return np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])


def pixels(mx: NDArray[np.float64], my: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([348.1 * mx + 365.8, 347.1 * my + 249.3]) + 0.5


def test_the_double_sphere() -> None:
    x, y, z = rays().T
    d1 = np.sqrt(x * x + y * y + z * z)
    d2 = np.sqrt(x * x + y * y + (-0.2443 * d1 + z) ** 2)
    below = 0.5657 * d2 + (1 - 0.5657) * (-0.2443 * d1 + z)
    np.testing.assert_allclose(read(DS).project(rays()), pixels(x / below, y / below), atol=1e-9)


@pytest.mark.parametrize(("more", "beta"), [("", 1.0), ("  beta: 1.2\n", 1.2)])
def test_the_unified_models(more: str, beta: float) -> None:
    x, y, z = rays().T
    below = 0.6 * np.sqrt(beta * (x * x + y * y) + z * z) + 0.4 * z
    item = read(f"{HEAD}{PINHOLE}  alpha: 0.6\n{more}", "UCM.yml")
    np.testing.assert_allclose(item.project(rays()), pixels(x / below, y / below), atol=1e-9)


@pytest.mark.parametrize("text", [DS.replace("  cx:", "  px:"), DS.replace("parameter:", "parameters:")])
def test_what_lacks_a_key_of_it_is_no_file_of_it(text: str) -> None:
    assert known_formats()["fisheye_adapter"].sniff(Content(text.encode(), "DS.yml")) is None


def test_kannala_and_brandt() -> None:
    item = read(f"{HEAD}{PINHOLE}  k1: 0.01\n  k2: -0.002\n  k3: 0.001\n  k4: -0.0003\n")
    assert item.distortion == KannalaBrandt(k1=0.01, k2=-0.002, k3=0.001, k4=-0.0003)


def test_ocamcalibs_polynomial_is_the_one_of_the_ray() -> None:
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-150, 150, 9), np.linspace(-120, 120, 7)))
    rho = np.hypot(x, y)
    seen = np.column_stack([x, y, 209.3 - 0.0022 * rho**2 + 5.1e-06 * rho**3 - 2.1e-08 * rho**4])
    expected = np.column_stack([0.9989 * x - 0.0002 * y + 359.8, y + 243.6]) + 0.5
    np.testing.assert_allclose(read(OCAM).project(seen), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("more", "match"),
    [
        ("  alpha: 1.0167\n", "alpha is 1.0167, expected 0 to 1"),
        ("  w: 0.9\n", "the parameters are w, of no model"),
    ],
)
def test_what_has_no_counterpart_is_refused(more: str, match: str) -> None:
    with pytest.raises(UnsupportedModelError, match=match):
        read(f"{HEAD}{PINHOLE}{more}", "UCM.yml")


@pytest.mark.parametrize(
    ("terms", "match"),
    [("[]", "unprojection.*no coefficients"), ("[1e200, 0, 1]", "the constant term is 1e\\+200")],
)
def test_a_polynomial_without_a_focal_length_names_its_key(terms: str, match: str) -> None:
    text = re.sub(r"unprojection: .*", f"unprojection: {terms}", OCAM)
    with pytest.raises(ParseError, match=match):
        read(text)


def test_alpha_alone_may_be_another_model_cut_short() -> None:
    text = f"{HEAD}{PINHOLE}  alpha: 0.6\n"
    with pytest.raises(ParseError, match="--set model=ucm"):
        read(text)
    assert read(text, model="ucm").distortion == read(text, "UCM.yml").distortion
