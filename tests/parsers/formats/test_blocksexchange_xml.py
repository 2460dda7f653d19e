"""Bentley's BlocksExchange, against the camera that its own documentation states twice, in pixels and in mm."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey
from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.records import replace
from tests.parsers.cameras import camera

SIZE = "<ImageDimensions><Width>5456</Width><Height>3632</Height></ImageDimensions>"
FOCAL = "<SensorSize>23.5</SensorSize><FocalLength>50.1</FocalLength>"
POINT = "<PrincipalPoint><x>2799.7</x><y>1664.2</y></PrincipalPoint>"
LENS = (
    "<Distortion><K1>0.0918</K1><K2>-0.3898</K2><K3>-0.1645</K3><P1>0.0034</P1><P2>0.0019</P2></Distortion>"
)


def group(*parts: str, name: str = "A5000") -> str:
    return f"<Photogroup><Name>{name}</Name>{''.join(parts)}</Photogroup>"


def block(*groups: str) -> bytes:
    return (
        '<?xml version="1.0"?><BlocksExchange version="3.2"><Block><Photogroups>'
        f"{''.join(groups)}</Photogroups></Block></BlocksExchange>"
    ).encode()


def read(data: bytes) -> Sequence[Calibration]:
    return parsers.decode(data, name="block.xml")


def one(*parts: str) -> Calibration:
    [calibration] = read(block(group(*parts)))
    return calibration


def test_a_camera_projects_by_bentleys_formula() -> None:
    calibration = one(SIZE, FOCAL, POINT, LENS)
    x, y = (c.ravel() for c in np.meshgrid(np.linspace(-0.25, 0.25, 15), np.linspace(-0.17, 0.17, 15)))
    r2 = x**2 + y**2
    radial = 1 + 0.0918 * r2 - 0.3898 * r2**2 - 0.1645 * r2**3
    xd = x * radial + 2 * 0.0019 * x * y + 0.0034 * (r2 + 2 * x**2)
    yd = y * radial + 2 * 0.0034 * x * y + 0.0019 * (r2 + 2 * y**2)
    f = 50.1 * 5456 / 23.5
    # Bentley's first pixel has its centre at (0, 0), ours at (0.5, 0.5).
    wanted = np.column_stack([xd * f + 2799.7, yd * f + 1664.2]) + 0.5
    seen = calibration.project(np.column_stack([x, y, np.ones_like(x)]))
    np.testing.assert_allclose(seen, wanted, rtol=0, atol=1e-9)


def test_the_documentations_own_example_agrees_with_itself() -> None:
    size = "<ImageDimensions><Width>9420</Width><Height>14430</Height></ImageDimensions>"
    focal = "<SensorSize>103.896</SensorSize><FocalLength>100.735601903992</FocalLength>"
    pixels = one(
        size, focal, "<PrincipalPoint><x>4683.755692</x><y>7223.0141002</y></PrincipalPoint>"
    ).intrinsics
    mm = one(
        size,
        "<PixelSize>0.0072</PixelSize><FocalLength>100.735601903992</FocalLength>",
        "<PrincipalPoint><xmm>-0.1853590176</xmm><ymm>0.06130152144</ymm></PrincipalPoint>",
    ).intrinsics
    assert pixels.fx == pixels.fy == pytest.approx(13991.05582, abs=5e-6)
    assert mm.fx == pytest.approx(pixels.fx, rel=1e-12)
    assert (mm.cx, mm.cy) == pytest.approx((pixels.cx, pixels.cy), abs=1e-8)
    assert (pixels.cx, pixels.cy) == pytest.approx((4684.255692, 7223.5141002), abs=1e-9)


def test_a_principal_point_that_is_not_stated_is_the_middle() -> None:
    K = one(SIZE, "<FocalLengthPixels>3650.1</FocalLengthPixels>").intrinsics
    assert (K.cx, K.cy, K.fx, K.fy) == (2728, 1816, 3650.1, 3650.1)


def test_the_aspect_ratio_stretches_y_and_is_an_assumption() -> None:
    calibration = one(SIZE, FOCAL, "<AspectRatio>1.001</AspectRatio><Skew>0</Skew>")
    K = calibration.intrinsics
    assert K.fy == K.fx * 1.001
    assert "AspectRatio" in calibration.provenance.assumptions[0]


def test_a_lens_that_is_not_stated_is_unknown() -> None:
    calibration = one(SIZE, FOCAL)
    assert calibration.distortion is None
    assert "states no distortion" in calibration.notes[0]
    [copy] = read(block(group(SIZE, FOCAL, "<Description>Undistorted photos</Description>")))
    assert "not of the original" in copy.notes[0]
    assert one(SIZE, FOCAL, "<Distortion><K1>0</K1></Distortion>").distortion == NoDistortion()


def test_every_photogroup_comes_in_order_with_its_name() -> None:
    cameras = read(
        block(group(SIZE, FOCAL, name="nadir"), group(SIZE, FOCAL, name=""), group(SIZE, FOCAL, name="left"))
    )
    assert [c.camera.sub_camera for c in cameras] == ["nadir", "photogroup 2", "left"]


def test_a_fisheye_is_left_out_or_refused_alone() -> None:
    fisheye = group(SIZE, "<CameraModelType>Fisheye</CameraModelType>", name="dome")
    [item] = read(block(fisheye, group(SIZE, FOCAL, LENS)))
    assert any("'dome'" in note and "Fisheye" in note for note in item.notes)
    with pytest.raises(UnsupportedModelError, match="Fisheye"):
        read(block(fisheye))


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ("<CameraModelType>Spherical</CameraModelType>", "Spherical"),
        ("<CameraOrientation>XLeftYDown</CameraOrientation>", "XLeftYDown"),
        ("<Skew>0.01</Skew>", "Skew"),
    ],
)
def test_what_has_no_counterpart_is_refused_by_name(part: str, message: str) -> None:
    with pytest.raises(UnsupportedModelError, match=message):
        one(SIZE, FOCAL, part)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([SIZE], "no <FocalLengthPixels>"),
        ([SIZE, "<FocalLength>50</FocalLength>"], "SensorSize"),
        ([SIZE, "<FocalLengthPixels>3650</FocalLengthPixels>", FOCAL], "take the wrong one out"),
        ([SIZE, "<SensorSize>0</SensorSize><FocalLength>50</FocalLength>"], "positive"),
        ([SIZE, FOCAL, "<PrincipalPoint><x>1</x></PrincipalPoint>"], "PrincipalPoint/y"),
        ([SIZE, FOCAL, FOCAL], "2 times"),
        ([SIZE, FOCAL, POINT.replace("2799.7", "2799,7")], "decimal point"),
    ],
)
def test_a_broken_photogroup_names_itself(parts: list[str], message: str) -> None:
    with pytest.raises(ParseError, match=f"photogroup 1, 'A5000'.*{message}"):
        one(*parts)


def test_a_block_without_a_photogroup_holds_no_camera() -> None:
    with pytest.raises(ParseError, match="0 <Photogroup>"):
        read(b"<BlocksExchange/>")


def test_a_photogroup_by_itself_is_read() -> None:
    [item] = read(group(SIZE, FOCAL, LENS).encode())
    assert item.camera.sub_camera == "A5000"


def test_what_bentley_reads_is_written_in_its_terms() -> None:
    K = camera().intrinsics
    named = replace(
        camera(BrownConrady(k1=-0.11, k2=0.02, p1=-0.0003, p2=0.0008, k3=-0.006)),
        camera=CameraKey(sub_camera="A & B", image_size=K.image_size),
        intrinsics=replace(K, fy=K.fx),
    )
    data, _ = parsers.encode([named], "blocksexchange_xml")
    [written] = ET.fromstring(data).iter("Photogroup")  # noqa: S314  our own bytes
    numbers = {
        path: float(written.findtext(path) or "") for path in ("FocalLengthPixels", "PrincipalPoint/x")
    }
    assert numbers == {"FocalLengthPixels": 3650.1, "PrincipalPoint/x": K.cx - 0.5}
    assert [written.findtext(f"Distortion/{name}") for name in ("P1", "P2")] == ["0.0008", "-0.0003"]
    assert written.findtext("Name") == "A & B"


def test_an_unknown_lens_stays_unknown_and_words_survive() -> None:
    original = one(
        SIZE, FOCAL, "<Description>2024 &amp; later</Description><CameraModelBand>Visible</CameraModelBand>"
    )
    data, verdict = parsers.encode([original], "blocksexchange_xml")
    [again] = read(data)
    assert verdict.dropped == ()
    assert (again.distortion, again.extras) == (None, original.extras)
