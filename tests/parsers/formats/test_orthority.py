"""orthority's interior parameters, against the K of its own formula and OpenCV's lenses."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import NoDistortion, ThinPrism
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample

FILE = """Acme DMC:
    k1: -0.2131
    k2: 0.0447
    p1: -0.00037
    p2: 8.1e-04
    k3: 0.0062
    cx: 0.01
    cy: -0.02
    sensor_size: [7.52, 4.80]
    focal_len: 4.33
    im_size: [752, 480]
    type: brown
"""
# orthority: c = (im_size − 1)/2 + max(im_size)·(cx, cy), from the pixel's centre.
OPENCV = (4.33 * 752 / 7.52, 4.33 * 480 / 4.80, 375.5 + 7.52, 239.5 - 15.04)
SAMPLES = {"orthority": Sample(FILE.encode())}


def read(text: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="int_param.yaml")


def test_brown_is_opencvs_first_five_at_orthoritys_k() -> None:
    [item] = read(FILE)
    assert_projects_as_opencv(item, OPENCV, (-0.2131, 0.0447, -0.00037, 0.00081, 0.0062))
    assert item.grade is Grade.DERIVED
    assert "does not say" in item.provenance.assumptions[0]


def test_fisheye_and_opencv_have_their_own_names() -> None:
    four = FILE.replace("brown", "fisheye").replace("p1", "k4").replace("    p2: 8.1e-04\n", "")
    assert_projects_as_opencv(read(four)[0], OPENCV, (-0.2131, 0.0447, 0.0062, -0.00037), fisheye=True)
    twelve = FILE.replace("brown", "opencv").replace("    cx", "    s4: 0.001\n    cx")
    lens = read(twelve)[0].distortion
    assert isinstance(lens, ThinPrism)
    assert lens.s4 == 0.001


def test_the_tilt_of_opencv_has_orthoritys_names() -> None:
    tilted = FILE.replace("brown", "opencv").replace("    cx", "    tx: 0.01\n    ty: -0.02\n    cx")
    coefficients = (-0.2131, 0.0447, -0.00037, 0.00081, 0.0062, 0, 0, 0, 0, 0, 0, 0, 0.01, -0.02)
    assert_projects_as_opencv(read(tilted)[0], OPENCV, coefficients)


def test_without_a_sensor_size_the_focal_length_is_of_the_width() -> None:
    text = (
        FILE.replace("    sensor_size: [7.52, 4.80]\n", "").replace("4.33", "0.6").replace("brown", "pinhole")
    )
    [item] = read(text)
    assert (item.intrinsics.fx, item.intrinsics.fy) == (0.6 * 752, 0.6 * 752)
    assert item.distortion == NoDistortion()


def test_several_cameras_have_their_names() -> None:
    assert [item.camera.sub_camera for item in read(FILE + FILE.replace("Acme DMC", "Acme X"))] == [
        "Acme DMC",
        "Acme X",
    ]


@pytest.mark.parametrize(
    ("old", "new", "kind", "match"),
    [
        ("brown", "omni", UnsupportedModelError, "omni"),
        ("[7.52, 4.80]", "[7.52, 0]", ParseError, "not positive"),
        ("4.33", "[1, 2, 3]", ParseError, "3 numbers"),
        ("im_size: [752, 480]", "im_size: [752]", ParseError, "1 numbers"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: str, new: str, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        read(FILE.replace(old, new))
