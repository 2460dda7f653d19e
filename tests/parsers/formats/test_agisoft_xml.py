"""Agisoft's XML, against Metashape's formula written down here once more."""

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
    KannalaBrandt,
    MetashapeFrame,
    NoDistortion,
    Rational,
    ThinPrismFisheye,
)
from calibrary.errors import MissingTagError, ParseError, UnknownFormatError, UnsupportedModelError
from calibrary.parsers.format import Fidelity
from calibrary.quality import Covariance, Quality
from calibrary.records import replace
from tests.parsers.cameras import BROWN, SIZE, camera

FRAME = {
    "projection": "frame", "width": "5472", "height": "3648", "f": "3650.7", "cx": "-12.31", "cy": "8.47",
    "b1": "1.13", "b2": "-23.1", "k1": "-0.1131", "k2": "0.0247", "k3": "-0.0062", "p1": "0.00081", "p2": "-0.00037",
    "date": "2024-05-17T10:00:00Z",
}  # fmt: skip
OLD = {
    "projection": "frame", "width": "8176", "height": "6132", "fx": "4587.2", "fy": "4586.1", "cx": "4053.9",
    "cy": "2980.1", "skew": "2.24", "k1": "-0.0084", "k2": "-0.0025", "k3": "0.012", "k4": "-0.0054",
    "p1": "-0.0014", "p2": "-0.00047",
}  # fmt: skip


def xml(fields: dict[str, str], **changes: str | None) -> bytes:
    rows = "".join(f"  <{k}>{v}</{k}>\n" for k, v in (fields | changes).items() if v is not None)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<calibration>\n{rows}</calibration>\n'.encode()


def read(data: bytes, **options: str) -> Calibration:
    [calibration] = parsers.decode(data, name="camera.xml", options=options)
    return calibration


def rays() -> NDArray[np.float64]:
    u, v = np.meshgrid(np.linspace(-0.7, 0.7, 25), np.linspace(-0.48, 0.48, 25))
    return np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])


def metashape(fields: dict[str, str], xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """The user manual's appendix on camera models, word for word, in px from the image's corner."""
    c = {name: float(value) for name, value in fields.items() if name not in {"projection", "date"}}
    k1, k2, k3, k4, p1, p2, p3, p4 = (c.get(n, 0.0) for n in ("k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4"))
    x, y = xy.T
    if fields["projection"] == "fisheye":
        r0 = np.maximum(np.hypot(x, y), 1e-300)
        x, y = x * np.arctan(r0) / r0, y * np.arctan(r0) / r0
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4
    growth = 1 + p3 * r2 + p4 * r2**2
    if "fx" in c and not (p3 or p4):
        # Agisoft Lens 0.4, the formula of fx, fy and skew: x' = … + P2(r² + 2x²) + 2·P1·x·y.
        p1, p2 = p2, p1
    xd = x * radial + (p1 * (r2 + 2 * x**2) + 2 * p2 * x * y) * growth
    yd = y * radial + (p2 * (r2 + 2 * y**2) + 2 * p1 * x * y) * growth
    if "fx" in c:
        return np.stack([c["cx"] + xd * c["fx"] + yd * c["skew"], c["cy"] + yd * c["fy"]], axis=1)
    b1, b2 = c.get("b1", 0.0), c.get("b2", 0.0)
    u = c["width"] * 0.5 + c.get("cx", 0.0) + xd * c["f"] + xd * b1 + yd * b2
    return np.stack([u, c["height"] * 0.5 + c.get("cy", 0.0) + yd * c["f"]], axis=1)


@pytest.mark.parametrize(
    "fields",
    [
        FRAME,
        OLD,
        OLD | {"p3": "-0.31", "p4": "0.12"},
        FRAME | {"k4": "0.0021"},
        FRAME | {"k4": "0.0021", "p3": "-0.31", "p4": "0.12"},
        {**FRAME, "projection": "fisheye", "k4": "0.0021", "p1": "0", "p2": "0.0"},
        {**FRAME, "projection": "fisheye", "k4": "0.0021"},
    ],
    ids=["frame", "absolute", "absolute p3 p4", "k4", "p3 p4", "fisheye", "fisheye p1 p2"],
)
def test_a_camera_projects_by_metashapes_own_formula(fields: dict[str, str]) -> None:
    calibration = read(xml(fields))
    seen = calibration.project(rays())
    np.testing.assert_allclose(seen, metashape(fields, rays()[:, :2]), rtol=0, atol=1e-9)
    np.testing.assert_allclose(calibration.project(calibration.unproject(seen)), seen, rtol=0, atol=1e-9)


def test_k_holds_the_affinity_and_the_skew_exactly() -> None:
    K = read(xml(FRAME)).intrinsics
    assert (K.fx, K.fy, K.skew) == (3650.7 + 1.13, 3650.7, -23.1)
    assert (K.cx, K.cy) == (5472 / 2 - 12.31, 3648 / 2 + 8.47)


def test_the_tangential_terms_change_places() -> None:
    assert read(xml(FRAME)).distortion == BrownConrady(
        k1=-0.1131, k2=0.0247, p1=-0.00037, p2=0.00081, k3=-0.0062
    )


def test_the_older_layouts_order_is_stated_and_can_be_chosen() -> None:
    calibration = read(xml(OLD, k4=None))
    assert calibration.distortion == BrownConrady(k1=-0.0084, k2=-0.0025, k3=0.012, p1=-0.0014, p2=-0.00047)
    [assumption] = calibration.provenance.assumptions
    assert "OpenCV's was taken, as in the manual of Agisoft Lens 0.4" in assumption
    assert assumption in calibration.notes
    swapped = read(xml(OLD, k4=None), tangential="swapped")
    assert swapped.distortion == BrownConrady(k1=-0.0084, k2=-0.0025, k3=0.012, p1=-0.00047, p2=-0.0014)
    assert "as the caller says" in swapped.provenance.assumptions[0]
    for absent in ("p1", "p2"):
        assert len(read(xml(OLD, k4=None, **{absent: None})).provenance.assumptions) == 1
    for newer in ({"p3": "0.1"}, {"p4": "0.1"}):
        assert "p3 and p4" in read(xml(OLD, **newer)).provenance.assumptions[0]


def test_the_order_is_no_matter_where_there_are_no_terms_or_the_layout_tells() -> None:
    assert read(xml(OLD, p1=None, p2="0")).provenance.assumptions == ()
    assert read(xml(FRAME)).provenance.assumptions == ()
    assert read(xml(FRAME), tangential="opencv").distortion == BrownConrady(
        k1=-0.1131, k2=0.0247, p1=0.00081, p2=-0.00037, k3=-0.0062
    )


def test_what_is_left_out_is_zero() -> None:
    calibration = read(xml({"projection": "frame", "width": "8192.0", "height": "5460", "f": "8215.9"}))
    K = calibration.intrinsics
    assert (K.cx, K.cy, K.skew, K.fx, K.image_size) == (4096.0, 2730.0, 0.0, 8215.9, (8192, 5460))
    assert calibration.distortion == NoDistortion()


def test_it_comes_from_a_bundle_adjustment() -> None:
    assert read(xml(FRAME)).grade is Grade.ADJUSTED


def test_the_older_layout_counts_from_the_corner_and_says_so() -> None:
    calibration = read(xml(OLD))
    K = calibration.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy, K.skew) == (4587.2, 4586.1, 4053.9, 2980.1, 2.24)
    assert "corner" in calibration.notes[0]


def test_offsets_that_look_absolute_are_asked_about() -> None:
    data = xml(FRAME, cx="2741.3", cy="1815.9")
    with pytest.raises(ParseError, match="principal_point"):
        read(data)
    assert read(data, principal_point="absolute").intrinsics.cx == 2741.3
    assert read(data, principal_point="offset").intrinsics.cx == 2736 + 2741.3


def test_absolute_numbers_that_look_like_offsets_are_asked_about() -> None:
    data = xml(OLD, cx="-34.1", cy="-85.9")
    with pytest.raises(ParseError, match="principal_point"):
        read(data)
    assert read(data, principal_point="offset").intrinsics.cx == 4088 - 34.1


def test_the_older_layout_needs_its_principal_point() -> None:
    with pytest.raises(ParseError, match="no <cx>"):
        read(xml(OLD, cx=None))


def test_the_two_layouts_do_not_mix() -> None:
    with pytest.raises(ParseError, match="two layouts"):
        read(xml(OLD, b1="0.3"))


@pytest.mark.parametrize("projection", ["spherical", "cylindrical", "rpc", "equisolid_fisheye"])
def test_a_projection_without_a_counterpart_is_refused_by_name(projection: str) -> None:
    with pytest.raises(UnsupportedModelError, match=projection):
        read(xml(FRAME, projection=projection))


def test_a_fisheye_with_tangential_terms_is_colmaps_thin_prism_fisheye() -> None:
    lens = read(xml(FRAME, projection="fisheye")).distortion
    assert isinstance(lens, ThinPrismFisheye)
    assert (lens.p1, lens.p2) == (float(FRAME["p2"]), float(FRAME["p1"]))
    assert (lens.sx1, lens.sy1) == (0, 0)


def test_a_fisheye_whose_tangential_terms_grow_is_refused() -> None:
    with pytest.raises(UnsupportedModelError, match="p3"):
        read(xml(FRAME, projection="fisheye", p3="0.1"))


def test_a_file_without_a_size_asks_for_one() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        read(xml(FRAME, width=None, height=None))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"f": None}, "no <f>"),
        ({"f": "3650,7"}, "decimal point"),
        ({"f": "nan"}, "not finite"),
        ({"f": "0"}, "focal lengths"),
        ({"k1": ""}, "not a number"),
        ({"k1": "1e999"}, "not finite"),
        ({"height": None}, "no <height>"),
        ({"width": "-5472"}, "image size"),
        ({"width": "5472.5"}, "image size"),
        ({"f": "1</f><f>2"}, "duplicate"),
        ({"date": "</calibration>"}, "XML"),
    ],
)
def test_a_broken_file_names_what_is_wrong(changes: dict[str, str | None], message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parsers.decode(xml(FRAME, **changes), name="camera.xml", format="agisoft_xml")


def test_an_entity_is_refused() -> None:
    bomb = b'<!DOCTYPE calibration [<!ENTITY f "3650">]>' + xml(FRAME).partition(b"\n")[2]
    with pytest.raises(ParseError, match="DTD"):
        parsers.decode(bomb, name="camera.xml", format="agisoft_xml")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "iso-8859-1"])
def test_every_xml_encoding_is_read(encoding: str) -> None:
    text = xml(FRAME, label="Süd").decode().replace("UTF-8", encoding.removesuffix("-sig"))
    calibration = read(text.replace("\n", "\r\n").encode(encoding))
    assert ("agisoft_xml/label", "Süd") in calibration.extras


def test_other_roots_are_not_claimed() -> None:
    with pytest.raises(UnknownFormatError, match="no format claims it"):
        read(b"<document><chunk/></document>")


def test_the_date_and_what_is_not_known_here_survive() -> None:
    data = xml(FRAME, note="a &lt;b&gt; &amp; c").replace(
        b"</calibration>", b"<x y='1'><z>2</z></x></calibration>"
    )
    original = read(data)
    again, verdict = parsers.encode([original], "agisoft_xml")
    assert verdict.dropped == ()
    assert read(again).extras == original.extras
    root = ET.fromstring(again)  # noqa: S314  our own bytes
    assert root.findtext("date") == "2024-05-17T10:00:00Z"
    assert root.findtext("note") == "a <b> & c"
    assert root.findtext("x/z") == "2"


def test_what_metashape_reads_is_written_in_its_terms() -> None:
    data, verdict = parsers.encode([camera(BROWN, skew=-23.1)], "agisoft_xml")
    root = ET.fromstring(data)  # noqa: S314  our own bytes
    numbers = {child.tag: child.text for child in root}
    assert verdict.outcome is Fidelity.EXACT
    assert numbers == {
        "projection": "frame", "width": "5472", "height": "3648", "f": "3648.7", "cx": repr(2741.3 - 2736.0),
        "cy": repr(1815.9 - 1824.0), "b1": repr(3650.1 - 3648.7), "b2": "-23.1", "k1": "-0.1131", "k2": "0.0247",
        "k3": "-0.0062", "p1": "0.00081", "p2": "-0.00037",
    }  # fmt: skip


def test_an_unknown_lens_is_written_with_a_word() -> None:
    _, verdict = parsers.encode([camera(None)], "agisoft_xml")
    assert (
        "that the distortion is unknown (its coefficients are zero, for the program to find)"
        in verdict.dropped
    )


def test_a_fisheye_goes_there_and_back() -> None:
    original = replace(
        camera(KannalaBrandt(k1=0.031, k2=-0.0072, k3=0.0041, k4=-0.0011)), grade=Grade.ADJUSTED
    )
    data, verdict = parsers.encode([original], "agisoft_xml")
    assert str(verdict) == "exact (0.000 px)"
    assert read(data).distortion == original.distortion


def test_a_fisheye_with_tangential_terms_goes_there_and_back() -> None:
    lens = ThinPrismFisheye(k1=0.031, k2=-0.0072, p1=4e-4, p2=-7e-4, k3=0.0041, k4=-0.0011, sx1=0.0, sy1=0.0)
    original = replace(camera(lens), grade=Grade.ADJUSTED)
    data, verdict = parsers.encode([original], "agisoft_xml")
    assert str(verdict) == "exact (0.000 px)"
    assert read(data).distortion == lens
    assert b"<p1>-0.0007</p1>" in data


@pytest.mark.parametrize(("sx1", "sy1"), [(2e-3, 0.0), (0.0, 2e-3)])
def test_a_prism_has_no_place_in_a_fisheye_and_is_refitted_or_refused(sx1: float, sy1: float) -> None:
    lens = ThinPrismFisheye(k1=0.031, k2=-0.0072, p1=4e-4, p2=-7e-4, k3=0.0041, k4=-0.0011, sx1=sx1, sy1=sy1)
    with pytest.raises(UnsupportedModelError, match="--max-error-px"):
        parsers.encode([camera(lens)], "agisoft_xml", max_error_px=1e-6)


def test_a_lens_that_metashape_lacks_is_refitted_within_the_limit() -> None:
    rational = Rational(k1=0.31, k2=0.05, p1=-0.0004, p2=0.0008, k3=-0.002, k4=0.42, k5=0.02, k6=0.001)
    original = camera(rational)
    data, verdict = parsers.encode([original], "agisoft_xml")
    assert verdict.outcome is Fidelity.REFITTED
    assert 0 < verdict.max_px < 0.05
    assert isinstance(read(data).distortion, MetashapeFrame)
    with pytest.raises(UnsupportedModelError, match="--max-error-px"):
        parsers.encode([original], "agisoft_xml", max_error_px=1e-9)


def test_the_size_a_file_states_is_the_image_size() -> None:
    assert read(xml(FRAME)).camera.image_size == SIZE


def _measured(kappa2: float | None = None, distortion: Distortion = BROWN) -> Calibration:
    names = ("fx", "fy", "cx", "cy", *distortion.names())
    sizes = np.array([1.0, 1.1, 0.6, 0.7, *(1e-4 for _ in distortion.names())])
    root = np.random.default_rng(5).normal(size=(len(names), len(names))) * sizes
    covariance = Covariance.from_matrix(names, root.T @ root)
    return replace(
        camera(distortion),
        quality=Quality(std=covariance.std, covariance=covariance, kappa2=kappa2),
    )


def _written(calibration: Calibration) -> bytes:
    return parsers.encode([calibration], "agisoft_xml")[0]


@pytest.mark.parametrize("distortion", [BROWN, KannalaBrandt(k1=0.03, k2=-0.01, k3=0.002, k4=0.0)])
def test_a_covariance_comes_back_as_it_was_written(distortion: Distortion) -> None:
    before = _measured(distortion=distortion)
    after = read(_written(before))
    assert before.quality is not None
    assert before.quality.covariance is not None
    assert after.quality is not None
    assert after.quality.covariance is not None
    assert after.quality.covariance.names == before.quality.covariance.names
    np.testing.assert_allclose(
        after.quality.covariance.matrix, before.quality.covariance.matrix, rtol=1e-9, atol=1e-18
    )
    assert dict(after.quality.std) == pytest.approx(dict(before.quality.std), rel=1e-9)


def test_the_variance_factor_becomes_part_of_the_covariance() -> None:
    after = read(_written(_measured(kappa2=4.0)))
    alone = read(_written(_measured()))
    assert after.quality is not None
    assert alone.quality is not None
    assert after.quality.kappa2 is None
    assert dict(after.quality.std) == pytest.approx(
        {name: 2 * value for name, value in alone.quality.std.items()}, rel=1e-9
    )


def test_a_covariance_that_metashapes_parameters_cannot_say_is_not_written() -> None:
    lens = Rational(k1=-0.1, k2=0.02, p1=0.0, p2=0.0, k3=0.001, k4=0.0, k5=0.0, k6=0.0)
    before = _measured(distortion=lens)
    assert b"covariance" not in _written(before)


def test_a_matrix_that_is_no_covariance_gives_standard_deviations_alone() -> None:
    covariance = "<covariance><params>f cx</params><coeffs>1 5 5 4</coeffs></covariance>"
    data = xml(FRAME).replace(b"</calibration>", covariance.encode() + b"</calibration>")
    quality = read(data).quality
    assert quality is not None
    assert quality.covariance is None
    assert dict(quality.std) == {"fx": 1.0, "fy": 1.0, "cx": 2.0}
