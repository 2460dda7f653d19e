"""ContextCapture's .opt, read as BlocksExchange's elements of the same names."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.distortion import BrownConrady
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.samples import Sample

OPT = b"""<?xml version="1.0" encoding="utf-8"?>
<OpticalProperties version="1.0">
  <ImageDimensions><Width>5472</Width><Height>3648</Height></ImageDimensions>
  <SensorSize>13.2</SensorSize>
  <FocalLength>8.8</FocalLength>
  <PrincipalPoint><X>2740.1</X><Y>1820.3</Y></PrincipalPoint>
  <Distortion><K1>-0.1</K1><K2>0.02</K2><K3>0.003</K3><P1>0.0008</P1><P2>-0.0003</P2></Distortion>
</OpticalProperties>
"""

SAMPLES = {"contextcapture_opt": Sample(OPT)}


def test_a_camera_is_read_as_in_blocksexchange_and_says_so() -> None:
    [item] = parsers.decode(OPT, name="camera.opt")
    K = item.intrinsics
    assert (K.cx, K.cy) == (2740.6, 1820.8)
    assert (K.fx, K.fy) == pytest.approx((3648.0, 3648.0), rel=1e-14)
    assert item.distortion == BrownConrady(k1=-0.1, k2=0.02, p1=-0.0003, p2=0.0008, k3=0.003)
    assert "BlocksExchange" in item.notes[0]


def test_a_fisheye_is_refused() -> None:
    fisheye = OPT.replace(b"<SensorSize>", b"<CameraModelType>Fisheye</CameraModelType><SensorSize>")
    with pytest.raises(UnsupportedModelError, match="Fisheye"):
        parsers.decode(fisheye, name="camera.opt")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"8.8", b"8,8", "decimal point"),
        (b"<FocalLength>8.8</FocalLength>", b"", "FocalLength"),
        (b"13.2", b"0", "mm"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: bytes, new: bytes, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parsers.decode(OPT.replace(old, new), name="camera.opt")
