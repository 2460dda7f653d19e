"""Metashape's cameras.xml and doc.xml: which calibration is taken, and what is known beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import BrownConrady, KannalaBrandt, MetashapeFrame, NoDistortion
from calibrary.errors import ParseError, UnknownFormatError, UnsupportedModelError
from tests.parsers.samples import Sample

ADJUSTED = (
    "<f>3650.7</f><cx>-12.31</cx><cy>8.47</cy><b1>1.13</b1><b2>-23.1</b2>"
    "<k1>-0.1131</k1><k2>0.0247</k2><k3>-0.0062</k3><p1>0.00081</p1><p2>-0.00037</p2>"
)
ABSOLUTE = "<fx>4587.2</fx><fy>4586.1</fy><cx>4053.9</cx><cy>2980.1</cy><skew>2.24</skew>"


def calibration(
    body: str = ADJUSTED, kind: str = "adjusted", model: str = "frame", size: str = "5472x3648"
) -> str:
    width, height = size.split("x")
    return (
        f'<calibration type="{model}" class="{kind}"><resolution width="{width}" height="{height}"/>{body}'
        "</calibration>"
    )


def sensor(
    *parts: str, number: int = 0, label: str = "FC6310, 8.8mm", model: str = "frame", fixed: bool = False
) -> str:
    held = '<property name="fixed" value="true"/>' if fixed else ""
    return (
        f'<sensor id="{number}" label="{label}" type="{model}"><resolution width="5472" height="3648"/>'
        '<property name="pixel_width" value="0.0024"/><property name="focal_length" value="8.8"/>'
        f"{held}{''.join(parts)}</sensor>"
    )


def document(*sensors: str, version: str = "1.5.0") -> bytes:
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<document version="{version}"><chunk label="Chunk 1">'
        f"<sensors>{''.join(sensors)}</sensors></chunk></document>"
    ).encode()


def read(data: bytes, **options: str) -> Sequence[Calibration]:
    return parsers.decode(data, name="cameras.xml", options=options)


DATED = calibration(f"{ADJUSTED}<date>2024-05-17T10:00:00Z</date>")
SAMPLES = {"metashape_document": Sample(document(sensor(DATED)))}


def test_a_sensor_is_what_saving_its_calibration_gives() -> None:
    [item] = read(document(sensor(calibration())))
    head = "<projection>frame</projection><width>5472</width><height>3648</height>"
    alone = f"<calibration>{head}{ADJUSTED}</calibration>"
    [single] = parsers.decode(alone.encode(), name="camera.xml", format="agisoft_xml")
    assert (item.intrinsics, item.distortion) == (single.intrinsics, single.distortion)
    K = item.intrinsics
    assert (K.fx, K.fy, K.skew, K.cx, K.cy) == (3650.7 + 1.13, 3650.7, -23.1, 2736 - 12.31, 1824 + 8.47)
    assert item.distortion == BrownConrady(k1=-0.1131, k2=0.0247, p1=-0.00037, p2=0.00081, k3=-0.0062)


def test_the_adjusted_calibration_goes_before_the_initial_one() -> None:
    initial = calibration("<f>3600</f><k1>-0.1126</k1><k2>0.0251</k2>", "initial")
    [item] = read(document(sensor(initial, calibration())))
    assert item.intrinsics.fy == 3650.7
    assert item.distortion == read(document(sensor(calibration())))[0].distortion
    assert item.grade is Grade.ADJUSTED
    assert "started from" in item.notes[0]


def test_an_initial_calibration_that_was_held_is_a_known_one() -> None:
    [item] = read(document(sensor(calibration(kind="initial"), fixed=True)))
    assert item.grade is Grade.ADJUSTED
    assert "held fixed" in item.notes[0]


def test_an_initial_calibration_that_was_not_held_is_no_more_than_derived() -> None:
    [item] = read(document(sensor(calibration("<f>3666.7</f>", "initial"))))
    assert item.grade is Grade.DERIVED
    assert "started from" in item.notes[0]
    assert item.distortion == NoDistortion()


def test_every_sensor_comes_in_order_with_its_label() -> None:
    cameras = read(
        document(
            sensor(calibration("<f>1278.3</f>"), label="left"),
            sensor(calibration("<f>1279.7</f>"), number=1, label="right"),
        )
    )
    assert [(c.camera.sub_camera, c.intrinsics.fx, c.provenance.tag) for c in cameras] == [
        ("left", 1278.3, "sensor '0'"),
        ("right", 1279.7, "sensor '1'"),
    ]
    assert cameras[0].camera.focal_mm == 8.8


def test_heads_of_one_label_are_told_apart_by_their_band() -> None:
    bands = [
        sensor(calibration(), f'<bands><band label="{band}"/></bands>', number=number, label="RedEdge-M")
        for number, band in enumerate(("Blue", "NIR"))
    ]
    assert [c.camera.sub_camera for c in read(document(*bands))] == ["RedEdge-M, Blue", "RedEdge-M, NIR"]


def test_a_sensor_without_a_calibration_is_left_out_and_named() -> None:
    [item] = read(document(sensor(calibration()), sensor(number=1)))
    assert any("sensor '1' was left out" in note for note in item.notes)
    with pytest.raises(ParseError, match="none of its 1 sensors"):
        read(document(sensor()))


def test_a_sensor_that_is_no_pinhole_is_left_out_or_refused_alone() -> None:
    panorama = sensor(calibration(model="spherical"), number=1, model="spherical")
    [item] = read(document(panorama, sensor(calibration())))
    assert any("spherical" in note for note in item.notes)
    with pytest.raises(UnsupportedModelError, match="spherical"):
        read(document(panorama))


def test_a_fisheye_without_tangential_terms_is_kannala_and_brandts() -> None:
    [item] = read(document(sensor(calibration("<f>1500</f><k1>0.03</k1>", model="fisheye"))))
    assert item.distortion == KannalaBrandt(k1=0.03, k2=0.0, k3=0.0, k4=0.0)


def test_an_old_document_counts_its_principal_point_from_the_corner() -> None:
    old = sensor(calibration(ABSOLUTE, size="8176x6132"))
    chunk = f'<chunk id="0" label="c"><sensors>{old}</sensors></chunk>'
    data = f'<document version="1.2.0"><chunks>{chunk}</chunks></document>'
    [item] = read(data.encode())
    K = item.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy, K.skew) == (4587.2, 4586.1, 4053.9, 2980.1, 2.24)


def test_absolute_numbers_under_the_new_names_are_asked_about() -> None:
    data = document(sensor(calibration("<f>3650.7</f><cx>2741.3</cx><cy>1815.9</cy>")), version="1.2.0")
    with pytest.raises(ParseError, match="principal_point"):
        read(data)
    assert read(data, principal_point="absolute")[0].intrinsics.cx == 2741.3


@pytest.mark.parametrize("inside", [True, False])
def test_the_covariance_becomes_standard_deviations(inside: bool) -> None:
    names = ["f", "b1", "b2", "cx", "cy", "k1", "p1", "p2"]
    rng = np.random.default_rng(7)
    root = rng.normal(size=(8, 8)) * np.array([1, 0.1, 0.1, 0.5, 0.5, 1e-5, 1e-6, 1e-6])
    matrix = root.T @ root
    # Metashape writes exponents of three digits.
    coeffs = " ".join(
        f"{value:.16e}".replace("e-0", "e-00").replace("e+0", "e+00") for value in matrix.ravel()
    )
    covariance = f"<covariance><params>{' '.join(names)}</params><coeffs>{coeffs}</coeffs></covariance>"
    body = sensor(calibration(ADJUSTED + covariance)) if inside else sensor(calibration(), covariance)
    [item] = read(document(body))
    assert item.quality is not None
    std = dict(item.quality.std)
    sigma = dict(zip(names, np.sqrt(np.diag(matrix)), strict=True))
    assert std["fx"] == pytest.approx(math.sqrt(matrix[0, 0] + matrix[1, 1] + 2 * matrix[0, 1]), rel=1e-12)
    wanted = {"fy": "f", "skew": "b2", "cx": "cx", "cy": "cy", "k1": "k1", "p1": "p2", "p2": "p1"}
    assert {name: std[name] for name in wanted} == pytest.approx(
        {name: sigma[theirs] for name, theirs in wanted.items()}, rel=1e-12
    )
    assert std.keys() == {"fx", *wanted}
    assert item.extras == ()


def test_metashapes_own_model_keeps_its_own_order_of_deviations() -> None:
    covariance = "<covariance><params>p1 p2</params><coeffs>4 0 0 9</coeffs></covariance>"
    [item] = read(document(sensor(calibration(f"{ADJUSTED}<k4>0.001</k4>{covariance}"))))
    assert isinstance(item.distortion, MetashapeFrame)
    assert item.quality is not None
    assert dict(item.quality.std) == {"p1": 2.0, "p2": 3.0}


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        ("<params>f cx</params><coeffs>1 0 0</coeffs>", "3 numbers, expected 4"),
        ("<params>f f</params><coeffs>1 0 0 1</coeffs>", "each once"),
        ("<params>f</params><coeffs>nan</coeffs>", "not finite"),
    ],
)
def test_a_broken_covariance_names_its_sensor(covariance: str, message: str) -> None:
    with pytest.raises(ParseError, match=f"sensor '0'.*{message}"):
        read(document(sensor(calibration(f"{ADJUSTED}<covariance>{covariance}</covariance>"))))


def test_a_variance_that_is_negative_is_no_deviation() -> None:
    covariance = "<covariance><params>f cx</params><coeffs>-1 0 0 4</coeffs></covariance>"
    [item] = read(document(sensor(calibration(ADJUSTED + covariance))))
    assert item.quality is not None
    assert dict(item.quality.std) == {"cx": 2.0}


def test_the_chunk_of_a_project_and_a_sensor_by_itself_are_read() -> None:
    chunk = f'<chunk version="1.2.0" label="c"><sensors>{sensor(calibration())}</sensors></chunk>'
    for text in (chunk, sensor(calibration())):
        assert read(text.encode())[0].intrinsics.fy == 3650.7


def test_two_chunks_name_theirs() -> None:
    chunks = "".join(
        f'<chunk label="{name}"><sensors>{sensor(calibration())}</sensors></chunk>'
        for name in ("north", "south")
    )
    cameras = read(f"<document>{chunks}</document>".encode())
    assert [c.provenance.tag for c in cameras] == [
        "sensor '0' of chunk 'north'",
        "sensor '0' of chunk 'south'",
    ]


def test_a_table_of_contents_points_to_its_chunks() -> None:
    toc = b'<document version="1.2.0"><chunks next_id="1"><chunk id="0" path="0/chunk.zip"/></chunks></document>'
    with pytest.raises(UnknownFormatError):
        read(toc)
    with pytest.raises(ParseError, match=r"chunk\.zip"):
        parsers.decode(toc, name="doc.xml", format="metashape_document")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (document(sensor(calibration("<f>0</f>"))), "sensor '0'.*focal lengths"),
        (document(sensor(calibration("<cx>1</cx>"))), "sensor '0'.*no <f>"),
        (document(sensor(calibration(), calibration())), "two calibrations"),
        (document(sensor(calibration(ADJUSTED + "<a/>" * 256))), "sensor '0'.*over 256 elements"),
        (document(*[sensor() for _ in range(1001)]), "1001 sensors"),
        (b"<calibration><sensor/></calibration>", "XML root"),
    ],
)
def test_a_broken_document_names_what_is_wrong(data: bytes, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parsers.decode(data, name="cameras.xml", format="metashape_document")
