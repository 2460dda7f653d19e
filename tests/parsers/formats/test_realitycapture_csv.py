"""RealityCapture's CSV, held against the XMP sidecar of the same camera and Brush's own arithmetic."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, MetashapeFrame, NoDistortion
from calibrary.errors import MissingTagError, ParseError, UnsupportedModelError
from calibrary.parsers.format import Fidelity
from calibrary.records import replace
from tests.parsers.cameras import BROWN, camera

FILE = """#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2
a.jpg,44.5,138.8,6.8,170.3,85.1,-22.7,24.3,-2.2e-003,-0.0048,0.0031,0.0040,-0.0018,0,0,0
b.jpg,44.6,138.8,6.8,170.3,85.1,-22.7,24.3,-2.2e-003,-0.0048,0.0031,0.0040,-0.0018,0,0,0
c.jpg,44.6,138.8,6.8,170.3,85.1,-22.7,31.5,0,0,0,0,0,0,0,0
"""
SIZE = (3840, 2880)


def read(text: str, **options: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="cameras.csv", image_size=SIZE, options=options)


def test_images_of_one_camera_are_read_once() -> None:
    first, last = read(FILE)
    K = first.intrinsics
    # Brush: focal·max(w, h)/36, and px·max(w, h) + w/2 from the image's corner.
    assert (K.fx, K.fy) == pytest.approx((24.3 * 3840 / 36,) * 2)
    assert (K.cx, K.cy) == pytest.approx((1920 - 0.0022 * 3840, 1440 - 0.0048 * 3840))
    assert first.distortion == BrownConrady(k1=0.0031, k2=0.0040, k3=-0.0018, p1=0.0, p2=0.0)
    assert (last.camera.sub_camera, last.distortion) == ("c.jpg", NoDistortion())


def test_it_is_the_camera_of_the_sidecar() -> None:
    xmp = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        '<rdf:Description xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#" xcr:DistortionModel="brown4t2" '
        'xcr:FocalLength35mm="24.3" xcr:PrincipalPointU="-0.0022" xcr:PrincipalPointV="-0.0048">'
        "<xcr:DistortionCoeficients>0.0031 0.0040 -0.0018 0.0002 0.0001 -0.0003</xcr:DistortionCoeficients>"
        "</rdf:Description></rdf:RDF></x:xmpmeta>"
    )
    row = FILE.splitlines()[1].replace("-0.0018,0,0,0", "-0.0018,0.0002,0.0001,-0.0003")
    for order in ("opencv", "swapped"):
        [item] = read(f"{FILE.splitlines()[0]}\n{row}\n", tangential=order)
        [peer] = parsers.decode(xmp.encode(), name="a.xmp", image_size=SIZE, options={"tangential": order})
        assert (item.intrinsics, item.distortion) == (peer.intrinsics, peer.distortion)
        assert isinstance(item.distortion, MetashapeFrame)


def test_the_order_of_the_tangential_terms_is_asked() -> None:
    with pytest.raises(UnsupportedModelError, match="tangential=swapped"):
        read(FILE.replace("-0.0018,0,0,0", "-0.0018,0,0.1,0"))


def test_columns_may_be_left_out() -> None:
    [item] = read("#name,x,y,alt,heading,pitch,roll,f\na.jpg,1,2,3,4,5,6,20\n")
    assert item.distortion == NoDistortion()
    assert (item.intrinsics.cx, item.intrinsics.cy) == (1920, 1440)


def test_the_image_size_has_to_be_given() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(FILE.encode(), name="cameras.csv")


def test_tangential_terms_are_refitted_rather_than_guessed_at() -> None:
    item = camera(BROWN)
    square = replace(item, intrinsics=replace(item.intrinsics, fy=item.intrinsics.fx))
    _, verdict = parsers.encode([square], "realitycapture_csv", name="a.csv", max_error_px=20)
    assert verdict.outcome is Fidelity.REFITTED


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("24.3,", "wide,", "line 2, f"),
        ("24.3,", "", "15 fields, expected 16"),
        (",f,", ",focal,", "no columns name and f"),
        (",px,py", ",px,px", "twice"),
        ("24.3,", "-24.3,", "focal"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: str, new: str, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        parsers.decode(
            FILE.replace(old, new).encode(), name="a.csv", format="realitycapture_csv", image_size=SIZE
        )
