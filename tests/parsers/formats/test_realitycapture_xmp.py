"""RealityCapture's sidecar, against its projection written down here once more."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import BrownConrady, MetashapeFrame, NoDistortion
from calibrary.errors import MissingTagError, ParseError, UnsupportedModelError
from tests.parsers.samples import Sample

SIZE = (5472, 3648)
FIELDS = {
    "Version": "3", "DistortionModel": "brown3", "FocalLength35mm": "24.3", "Skew": "0", "AspectRatio": "1",
    "PrincipalPointU": "-0.0022", "PrincipalPointV": "0.0048", "CalibrationPrior": "exact",
    "DistortionCoeficients": "-0.0123 0.0155 -0.0174 0.0031 0 0",
}  # fmt: skip


def xmp(changes: dict[str, str | None] | None = None, *, elements: bool = False) -> bytes:
    fields = {name: value for name, value in (FIELDS | (changes or {})).items() if value is not None}
    inside = fields if elements else {"DistortionCoeficients": fields.pop("DistortionCoeficients", "")}
    attributes = "" if elements else " ".join(f'xcr:{name}="{value}"' for name, value in fields.items())
    children = "".join(f"<xcr:{name}>{value}</xcr:{name}>" for name, value in inside.items() if value)
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#" {attributes}>'
        f"<xcr:Rotation>1 0 0 0 1 0 0 0 1</xcr:Rotation>{children}</rdf:Description></rdf:RDF></x:xmpmeta>"
    ).encode()


def read(data: bytes, **options: str) -> Calibration:
    [calibration] = parsers.decode(data, name="DJI_0001.xmp", image_size=SIZE, options=options)
    return calibration


SAMPLES = {"realitycapture_xmp": Sample(xmp())}


@pytest.mark.parametrize("elements", [False, True])
def test_a_camera_projects_by_its_own_formula(elements: bool) -> None:
    calibration = read(xmp({"DistortionModel": "brown4"}, elements=elements))
    x, y = (c.ravel() for c in np.meshgrid(np.linspace(-0.7, 0.7, 15), np.linspace(-0.48, 0.48, 15)))
    r2 = x**2 + y**2
    radial = 1 - 0.0123 * r2 + 0.0155 * r2**2 - 0.0174 * r2**3 + 0.0031 * r2**4
    f = 24.3 / 36 * 5472
    wanted = np.column_stack([2736 - 0.0022 * 5472 + f * x * radial, 1824 + 0.0048 * 5472 + f * y * radial])
    seen = calibration.project(np.column_stack([x, y, np.ones_like(x)]))
    np.testing.assert_allclose(seen, wanted, rtol=0, atol=1e-9)
    assert calibration.grade is Grade.ADJUSTED


def test_an_upright_image_counts_by_its_longer_side_too() -> None:
    [item] = parsers.decode(xmp(), name="a.xmp", image_size=(3648, 5472))
    K = item.intrinsics
    assert (K.fx, K.cx) == pytest.approx((24.3 / 36 * 5472, 1824 - 0.0022 * 5472))


def test_a_model_uses_its_own_coefficients_only() -> None:
    assert read(xmp()).distortion == BrownConrady(k1=-0.0123, k2=0.0155, p1=0.0, p2=0.0, k3=-0.0174)
    assert read(xmp({"DistortionModel": "perspective"})).distortion == NoDistortion()
    assert read(xmp({"DistortionModel": None})).distortion is None


def test_tangential_terms_ask_for_their_order() -> None:
    data = xmp({"DistortionModel": "brown3t2", "DistortionCoeficients": "-0.01 0.02 0 0 0.0008 -0.0003"})
    with pytest.raises(UnsupportedModelError, match="tangential"):
        read(data)
    assert read(data, tangential="opencv").distortion == BrownConrady(
        k1=-0.01, k2=0.02, p1=0.0008, p2=-0.0003
    )
    assert read(data, tangential="swapped").distortion == BrownConrady(
        k1=-0.01, k2=0.02, p1=-0.0003, p2=0.0008
    )


def test_metashapes_model_takes_the_fourth_radial_term_and_its_own_order() -> None:
    data = xmp({"DistortionModel": "brown4t2", "DistortionCoeficients": "-0.01 0.02 0 0.003 0.0008 -0.0003"})
    assert read(data, tangential="opencv").distortion == MetashapeFrame(
        k1=-0.01, k2=0.02, k3=0.0, k4=0.003, p1=-0.0003, p2=0.0008, p3=0.0, p4=0.0
    )


def test_the_size_is_asked_for() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(xmp(), name="a.xmp")


def test_what_was_taken_for_granted_is_said() -> None:
    calibration = read(xmp({"AspectRatio": "1.001"}))
    assert calibration.intrinsics.fy == pytest.approx(1.001 * calibration.intrinsics.fx)
    assert len(calibration.provenance.assumptions) == 2
    assert ("realitycapture_xmp/CalibrationPrior", "exact") in calibration.extras


@pytest.mark.parametrize(
    ("changes", "message"), [({"DistortionModel": "division"}, "division"), ({"Skew": "0.1"}, "Skew")]
)
def test_what_has_no_counterpart_is_refused_by_name(changes: dict[str, str | None], message: str) -> None:
    with pytest.raises(UnsupportedModelError, match=message):
        read(xmp(changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"FocalLength35mm": None}, "0 descriptions"),
        ({"FocalLength35mm": "24,3"}, "decimal point"),
        ({"FocalLength35mm": "0"}, "focal lengths"),
        ({"DistortionCoeficients": "1 2 3"}, "3 numbers, expected 6"),
        ({"DistortionCoeficients": None}, "no coefficients"),
    ],
)
def test_a_broken_file_names_what_is_wrong(changes: dict[str, str | None], message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(xmp(changes))


def test_a_field_that_stands_twice_is_refused() -> None:
    twice = xmp().replace(b"<xcr:Rotation>", b"<xcr:Skew>0</xcr:Skew><xcr:Rotation>")
    with pytest.raises(ParseError, match="duplicate"):
        read(twice)
