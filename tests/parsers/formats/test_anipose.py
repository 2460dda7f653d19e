"""Anipose's TOML, against OpenCV."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.errors import MissingTagError, ParseError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample

FILE = """[cam_0]
name = "A"
size = [ 752, 480,]
matrix = [ [ 433.2, 0.0, 371.6,], [ 0.0, 432.9, 238.3,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.2131, 0.0447, -0.00037, 8.1e-04, 0.0062,]
rotation = [ 0.0, 0.0, 0.0,]
translation = [ 0.0, 0.0, 0.0,]

[cam_1]
name = "B"
size = [ 640, 512,]
matrix = [ [ 402.2, 0.0, 321.6,], [ 0.0, 402.9, 248.3,], [ 0.0, 0.0, 1.0,],]
distortions = [ 0.01, 0.0, 0.0, 0.0, 0.0,]

[metadata]
adjusted = false
error = 0.633
"""
SAMPLES = {"anipose": Sample(FILE.encode())}


def read(text: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="calibration.toml")


def test_every_camera_is_opencvs_under_its_name() -> None:
    first, second = read(FILE)
    assert_projects_as_opencv(
        first, (433.2, 432.9, 371.6, 238.3), (-0.2131, 0.0447, -0.00037, 0.00081, 0.0062)
    )
    assert [item.camera.sub_camera for item in (first, second)] == ["A", "B"]
    assert second.intrinsics.image_size == (640, 512)


def test_a_fisheye_is_opencvs_fisheye() -> None:
    text = FILE.replace(
        "-0.2131, 0.0447, -0.00037, 8.1e-04, 0.0062,]", "-0.0292, 0.0208, -0.0319, 0.0166]\nfisheye = true"
    )
    assert_projects_as_opencv(
        read(text)[0], (433.2, 432.9, 371.6, 238.3), (-0.0292, 0.0208, -0.0319, 0.0166), fisheye=True
    )


@pytest.mark.parametrize(
    ("old", "new", "kind", "match"),
    [
        ("0.0062,]", "0.0062, 1.0]", ParseError, r"cam_0\.distortions: 6 numbers"),
        ("[ 0.0, 0.0, 1.0,],]", "[ 0.0, 0.0, 2.0,],]", ParseError, "not a camera matrix"),
        ("[cam_1]", "[cam_0]", ParseError, "not TOML"),
        ("size = [ 752, 480,]\n", "", MissingTagError, "--image-size"),
        ("433.2", "nan", ParseError, "not finite"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: str, new: str, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        read(FILE.replace(old, new))


def test_deep_brackets_are_refused() -> None:
    with pytest.raises(ParseError, match="TOML"):
        parsers.decode(b"a = " + b"[" * 100_000, name="x", format="anipose")
