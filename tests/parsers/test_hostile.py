"""Files that once broke a reader's promise: an error of ours or cameras, after a bounded number of calls.

Found by ``make fuzz``, by files grown past all measure, and by the benchmark; each is as small as it became.
"""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.errors import ParseError
from tests.work import calls

BROKEN = {
    "a focal length too small for a division": (
        "artoolkitplus_cal",
        b"ARToolKitPlus_CamCal_Rev02\n1941 1480 970.0 739.5 3.7e-312 3687.8 0 0 0 0 0 0 20\n",
        "of no camera",
    ),
    "a focal length too large for a product": (
        "artoolkitplus_cal",
        b"ARToolKitPlus_CamCal_Rev02\n1941 1480 970.0 739.5 3.7e307 3687.8 0 0 0 0 0 0 20\n",
        "of no camera",
    ),
    "empty lines without end": (
        "orb_slam",
        b"%YAML:1.0\nCamera.fy: 1\n" + b"\n" * 200_000,
        "neither a Camera.fx",
    ),
    "a camera matrix of ten numbers": (
        "hand_made",
        b'{"camera_matrix": {"values": [800, 0, 320, 0, 800, 240, 0, 0, 1, 1]}, "image_size": [640, 480]}',
        "10 numbers of a camera matrix",
    ),
    "comments alone between the marks of documents": ("hand_made", b"# a\n---\n# b: 1\n", "no camera matrix"),
    "a length twice": (
        "pix4d_camera_database",
        b"<camera name='P1'><imageWidth>80</imageWidth><imageHeight>60</imageHeight><pixelSize>4</pixelSize>"
        b"<pixelSize>5</pixelSize><focalLengthmm>35</focalLengthmm></camera>",
        "expected a number",
    ),
    "a coefficient twice": (
        "pix4d_camera_database",
        b"<camera name='P1'><imageWidth>80</imageWidth><imageHeight>60</imageHeight><pixelSize>4</pixelSize>"
        b"<focalLengthmm>35</focalLengthmm><principalPointXmm>.2</principalPointXmm>"
        b"<principalPointYmm>.1</principalPointYmm><lensType>perspective</lensType>"
        b"<radialK1>.1</radialK1><radialK1>.2</radialK1></camera>",
        "6 distortion coefficients",
    ),
}


@pytest.mark.parametrize(("record", "data", "message"), BROKEN.values(), ids=BROKEN)
def test_it_is_refused_at_once(record: str, data: bytes, message: str) -> None:
    def decode() -> None:
        with pytest.raises(ParseError, match=message):
            parsers.decode(data, name="hostile", format=record)

    decode()
    # A row of the table takes 1700, a module some hundred; each of the 3000 lines of cameras thirty, an empty one none.
    assert calls(decode) < 2_000 + 35 * data.count(b"=")
