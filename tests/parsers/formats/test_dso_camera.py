"""DSO's camera.txt, against OpenCV and DSO's own rescaling."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import FieldOfView, NoDistortion
from calibrary.errors import ParseError, UnknownFormatError, UnsupportedModelError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample

FILE = "RadTan 433.2 432.9 371.6 238.3 -0.2131 0.0447 -0.00037 8.1e-04\n752 480\ncrop\n640 480\n"
OPENCV = (433.2, 432.9, 371.6, 238.3)
SAMPLES = {"dso_camera": Sample(FILE.encode())}


def read(text: str) -> Calibration:
    [calibration] = parsers.decode(text.encode(), name="camera.txt")
    return calibration


@pytest.mark.parametrize("name", ["RadTan ", ""])
def test_eight_numbers_are_opencvs_k_and_first_four(name: str) -> None:
    item = read(FILE.replace("RadTan ", name))
    assert_projects_as_opencv(item, OPENCV, (-0.2131, 0.0447, -0.00037, 0.00081))
    assert item.intrinsics.image_size == (752, 480)


@pytest.mark.parametrize("name", ["EquiDistant", "Equidistant", "KannalaBrandt"])
def test_the_fisheyes_are_opencvs(name: str) -> None:
    text = FILE.replace("RadTan", name).replace("-0.2131", "-0.0131")
    assert_projects_as_opencv(read(text), OPENCV, (-0.0131, 0.0447, -0.00037, 0.00081), fisheye=True)


@pytest.mark.parametrize("name", ["FOV ", ""])
def test_fractions_count_from_the_corner(name: str) -> None:
    item = read(f"{name}0.53 0.84 0.49 0.52 0.93\n1280 1024\nfull\n640 480\n")
    assert item.distortion == FieldOfView(omega=0.93)
    K = item.intrinsics
    # DSO: K(0,2) = width·cx − 0.5 from the pixel's centre.
    assert (K.fx, K.fy, K.cx, K.cy) == pytest.approx((0.53 * 1280, 0.84 * 1024, 0.49 * 1280, 0.52 * 1024))


@pytest.mark.parametrize(
    "first", ["0.53 0.84 0.49 0.52 0", "Pinhole 0.53 0.84 0.49 0.52 0", "Pinhole 0.53 0.84 0.49 0.52 0 0 0 0"]
)
def test_a_rectified_camera_has_no_distortion(first: str) -> None:
    assert read(f"{first}\n1280 1024\n0.4 0.5 0.5 0.5 0\n640 480\n").distortion == NoDistortion()


@pytest.mark.parametrize(
    ("text", "kind", "match"),
    [
        (FILE.replace("RadTan", "Ocam"), UnsupportedModelError, "Ocam"),
        (FILE.replace("RadTan", "Pinhole"), ParseError, "no distortion"),
        (FILE.replace(" 8.1e-04", ""), ParseError, "7 numbers, expected 8"),
        (FILE.replace("752 480", "752"), ParseError, "1 numbers, expected 2"),
        (FILE.replace("433.2", "-433.2"), ParseError, "focal"),
        ("RadTan 1 2\n", ParseError, "1 lines"),
    ],
)
def test_a_broken_file_names_what_is_wrong(text: str, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        parsers.decode(text.encode(), name="camera.txt", format="dso_camera")


def test_four_other_lines_are_not_claimed() -> None:
    with pytest.raises(UnknownFormatError):
        read("1 2 3 4 5\n6 7\nhigh\n8 9\n")
