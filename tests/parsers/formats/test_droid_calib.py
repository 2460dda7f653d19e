"""DROID-SLAM's line of numbers, against OpenCV."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.distortion import NoDistortion
from calibrary.errors import MissingTagError, ParseError, UnknownFormatError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample

FILE = "433.2 432.9 371.6 238.3 -0.2131 0.0447 -0.00037 8.1e-04 0.0062\n"
SIZE = (752, 480)
SAMPLES = {"droid_calib": Sample(FILE.encode())}


def test_the_coefficients_are_opencvs() -> None:
    [item] = parsers.decode(FILE.encode(), name="euroc.txt", image_size=SIZE)
    assert_projects_as_opencv(
        item, (433.2, 432.9, 371.6, 238.3), (-0.2131, 0.0447, -0.00037, 0.00081, 0.0062)
    )
    assert "nothing in the file says" in item.notes[-1]


def test_four_numbers_are_a_pinhole() -> None:
    [item] = parsers.decode(b"535.4 539.2 320.1 247.6\n", name="tum3.txt", image_size=(640, 480))
    assert item.distortion == NoDistortion()
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(b"535.4 539.2 320.1 247.6\n", name="tum3.txt")


@pytest.mark.parametrize(
    "text", ["1 2 3 4\n", "500 500 320 240 1 2 3\n", "500 900 320 240\n", "500 500 320 240\n1 2\n"]
)
def test_other_numbers_are_not_claimed(text: str) -> None:
    with pytest.raises(UnknownFormatError):
        parsers.decode(text.encode(), name="x.txt", image_size=SIZE)


@pytest.mark.parametrize(
    ("text", "match"),
    [("500 500 320\n", "3 numbers"), ("500 500 320 240\n1\n", "2 lines"), ("500 500 320 240", "not ended")],
)
def test_a_broken_file_names_what_is_wrong(text: str, match: str) -> None:
    with pytest.raises(ParseError, match=match):
        parsers.decode(text.encode(), name="x.txt", format="droid_calib", image_size=SIZE)
