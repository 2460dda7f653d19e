"""MicMac's XML, against its formulas in pixels written down here once more."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    InverseBrown,
    KannalaBrandt,
    NoDistortion,
    OffCentreBrown,
)
from calibrary.errors import MissingTagError, ParseError, UnsupportedModelError
from calibrary.parsers.format import Fidelity
from tests.parsers.cameras import camera

M2C, C2M = "eConvApero_DistM2C", "eConvApero_DistC2M"
PP, F = (2731.25, 1840.5), 3650.1
RADIAL = (-8.5e-9, 1.4e-16, -2.1e-24, 3.3e-32, -1.2e-40)
OFF = (2741.3, 1815.9)
FRASER = {"P1": 2.24e-8, "P2": -1.27e-8, "b1": 2.1e-4, "b2": -5.5e-5}


def model(
    radial: tuple[float, ...] = RADIAL[:3],
    centre: tuple[float, float] = OFF,
    fraser: dict[str, float] | None = None,
) -> str:
    rows = "".join(f"<CoeffDist> {c!r} </CoeffDist>" for c in radial)
    part = f"<CDist>{centre[0]} {centre[1]}</CDist>{rows}"
    if fraser is None:
        return f"<ModRad>{part}</ModRad>"
    tail = "".join(f"<{name}>{value!r}</{name}>" for name, value in fraser.items())
    return f"<ModPhgrStd><RadialePart>{part}</RadialePart>{tail}</ModPhgrStd>"


def xml(*models: str, convention: str = M2C, extra: str = "", size: str = "<SzIm>5472 3648</SzIm>") -> bytes:
    distortions = "".join(f"<CalibDistortion>{item}</CalibDistortion>" for item in models)
    return (
        f'<?xml version="1.0" ?>\n<ExportAPERO>\n <CalibrationInternConique><KnownConv>{convention}</KnownConv>'
        f"<PP> {PP[0]} {PP[1]} </PP><F> {F} </F>{size}{extra}{distortions}</CalibrationInternConique>\n</ExportAPERO>"
    ).encode()


def read(data: bytes) -> Calibration:
    [calibration] = parsers.decode(data, name="AutoCal.xml")
    return calibration


def micmac(
    px: NDArray[np.float64], radial: tuple[float, ...], centre: tuple[float, float], fraser: dict[str, float]
) -> NDArray[np.float64]:
    """The polynomial in pixels, from the point it takes to the point it gives."""
    u, v = (px - centre).T
    r2 = u**2 + v**2
    growth = np.zeros_like(r2)
    for i, c in enumerate(radial, start=1):
        growth += c * r2**i
    p1, p2, b1, b2 = (fraser.get(name, 0.0) for name in ("P1", "P2", "b1", "b2"))
    du = u * growth + p1 * (2 * u**2 + r2) + 2 * p2 * u * v + b1 * u + b2 * v
    dv = v * growth + p2 * (2 * v**2 + r2) + 2 * p1 * u * v
    moved: NDArray[np.float64] = px + np.column_stack([du, dv])
    return moved


def grid() -> NDArray[np.float64]:
    u, v = np.meshgrid(np.linspace(0, 5471, 21), np.linspace(0, 3647, 21))
    return np.column_stack([u.ravel(), v.ravel()])


CASES = [(RADIAL[:3], PP, {}), (RADIAL, OFF, {}), (RADIAL[:3], OFF, FRASER), (RADIAL[:2], PP, FRASER)]


@pytest.mark.parametrize(("radial", "centre", "fraser"), CASES)
def test_m2c_takes_the_ideal_pixel_to_the_observed_one(
    radial: tuple[float, ...], centre: tuple[float, float], fraser: dict[str, float]
) -> None:
    calibration = read(xml(model(radial, centre, fraser or None)))
    ideal = grid()
    rays = np.column_stack([(ideal - PP) / F, np.ones(len(ideal))])
    observed = micmac(ideal, radial, centre, fraser)
    # MicMac's first pixel is (0, 0), ours (0.5, 0.5).
    np.testing.assert_allclose(calibration.project(rays) - 0.5, observed, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("radial", "centre", "fraser"), CASES)
def test_c2m_takes_the_observed_pixel_to_the_ideal_one(
    radial: tuple[float, ...], centre: tuple[float, float], fraser: dict[str, float]
) -> None:
    radial = tuple(-c for c in radial)
    calibration = read(xml(model(radial, centre, fraser or None), convention=C2M))
    observed = grid()[::7]
    ideal = micmac(observed, radial, centre, fraser)
    rays = calibration.unproject(observed + 0.5)
    np.testing.assert_allclose(rays[:, :2] / rays[:, 2:] * F + PP, ideal, rtol=0, atol=1e-9)
    np.testing.assert_allclose(calibration.project(rays) - 0.5, observed, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("models", "convention", "kind"),
    [
        ([model(centre=PP)], M2C, BrownConrady),
        ([model(centre=PP, fraser={"P1": 1e-8})], M2C, BrownConrady),
        ([model()], M2C, OffCentreBrown),
        ([model(RADIAL, PP)], M2C, OffCentreBrown),
        ([model(centre=PP)], C2M, InverseBrown),
        ([model((), PP)], M2C, NoDistortion),
        (["<ModNoDist/>"], C2M, NoDistortion),
        (["<ModNoDist/>", model(centre=PP)], M2C, BrownConrady),
    ],
)
def test_a_lens_is_the_plainest_model_that_it_is(
    models: list[str], convention: str, kind: type[Distortion]
) -> None:
    assert type(read(xml(*models, convention=convention)).distortion) is kind


def test_the_half_pixel_is_taken_for_granted_and_said() -> None:
    calibration = read(xml(model()))
    K = calibration.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy, K.image_size) == (F, F, PP[0] + 0.5, PP[1] + 0.5, (5472, 3648))
    assert calibration.provenance.assumptions == calibration.notes
    assert "(0, 0)" in calibration.notes[0]
    assert calibration.grade is Grade.ADJUSTED


def test_the_camera_may_stand_without_the_export_around_it() -> None:
    bare = xml(model()).partition(b"<ExportAPERO>\n")[2].removesuffix(b"\n</ExportAPERO>")
    assert read(bare).intrinsics == read(xml(model())).intrinsics


def test_a_template_is_refused() -> None:
    with pytest.raises(ParseError, match="template"):
        read(xml(model()).replace(b"<F> 3650.1 </F>", b"<F> 0 </F>"))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (
            xml("<ModUnif><TypeModele>eModele_FishEye_10_5_5</TypeModele><Params>1</Params></ModUnif>"),
            "FishEye_10_5_5",
        ),
        (xml("<ModGrid/>"), "ModGrid"),
        (xml(model(), model()), "several distortions"),
        (xml(model((*RADIAL, 1e-48))), "6 radial terms"),
        (xml(model(), convention="eConvJaponaise"), "eConvJaponaise"),
        (xml(model(), extra="<OrIntGlob><C2M>true</C2M></OrIntGlob>"), "OrIntGlob"),
        (
            xml(
                model(),
                extra="<OrIntGlob><Affinite><I00>0 0</I00><V10>0 1</V10><V01>1 0</V01></Affinite></OrIntGlob>",
            ),
            "turned or cropped",
        ),
        (xml(model(), extra="<PixelSzIm>100 100</PixelSzIm>"), "PixelSzIm"),
    ],
)
def test_what_has_no_counterpart_is_refused_by_name(data: bytes, message: str) -> None:
    with pytest.raises(UnsupportedModelError, match=message):
        read(data)


def test_an_identity_between_image_and_camera_is_nothing() -> None:
    identity = "<OrIntGlob><Affinite><I00>0 0</I00><V10>1 0</V10><V01>0 1</V01></Affinite><C2M>true</C2M></OrIntGlob>"
    assert read(xml(model(), extra=identity)).intrinsics.fx == F


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (xml(), "no <CalibDistortion>"),
        (xml(model()).replace(b"3650.1 ", b"1,5"), "decimal point"),
        (xml(model()).replace(b"1840.5", b""), "1 numbers, expected 2"),
        (xml(model((1e300, 1e300))), "not finite"),
        (xml(model(fraser={"b1": 0.3})), "b1"),
        (xml("<ModRad/>"), "CDist"),
        (b"<ExportAPERO/>", "0 <CalibrationInternConique>"),
    ],
)
def test_a_broken_file_names_what_is_wrong(data: bytes, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parsers.decode(data, name="AutoCal.xml", format="micmac_xml")


def test_a_file_without_a_size_asks_for_one() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        read(xml(model(), size=""))


def test_what_micmac_reads_is_written_in_its_terms() -> None:
    data, verdict = parsers.encode(
        [read(xml(model(RADIAL, OFF, FRASER), extra="<RayonUtile>2800</RayonUtile>"))], "micmac_xml"
    )
    assert (verdict.outcome, verdict.dropped) == (Fidelity.EXACT, ())
    [root] = ET.fromstring(data)  # noqa: S314  our own bytes
    assert root.findtext("KnownConv") == M2C
    assert root.findtext("RayonUtile") == "2800"
    assert [float(part) for part in (root.findtext("PP") or "").split()] == list(PP)
    part = root.find("CalibDistortion/ModPhgrStd/RadialePart")
    assert part is not None
    assert [float(c.text or "") for c in part.findall("CoeffDist")] == pytest.approx(RADIAL, rel=1e-14)
    assert [float(c) for c in (part.findtext("CDist") or "").split()] == pytest.approx(OFF, rel=1e-14)
    fraser = {name: float(root.findtext(f"CalibDistortion/ModPhgrStd/{name}") or "") for name in FRASER}
    assert fraser == pytest.approx(FRASER, rel=1e-14)


def test_the_direction_is_written_as_it_is() -> None:
    original = read(xml(model(tuple(-c for c in RADIAL)), convention=C2M))
    data, verdict = parsers.encode([original], "micmac_xml")
    assert C2M.encode() in data
    assert verdict.outcome is Fidelity.EXACT
    assert read(data).distortion == original.distortion


def test_a_fisheye_is_not_written_as_a_pinhole() -> None:
    fisheye = camera(KannalaBrandt(k1=0.2, k2=0.05, k3=0.01, k4=0.002))
    with pytest.raises(UnsupportedModelError):
        parsers.encode([fisheye], "micmac_xml")
