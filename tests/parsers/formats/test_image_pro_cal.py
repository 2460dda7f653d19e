"""Image-Pro's .CAL is known and refused."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.errors import UnknownFormatError, UnsupportedModelError
from tests.parsers.samples import Sample

SAMPLES = {
    "image_pro_cal": Sample(b"[SPATIAL]\r\nCalibName=Lens 4x\r\nUnitName=um\r\nPixPerUnit=1.3,1.3\r\n")
}


@pytest.mark.parametrize(
    "text",
    [
        "[SPATIAL]\r\nCalibName=Lens 4x\r\nUnitName=um\r\nPixPerUnit=1.3,1.3\r\n",
        "[INTENSITY]\nImageClass=1\nName=Grey\nInputRange=0,255\n",
    ],
    ids=["spatial", "intensity"],
)
def test_a_scale_of_pixels_is_no_camera(text: str) -> None:
    with pytest.raises(UnsupportedModelError, match=r"Image-Pro.*board"):
        parsers.decode(text.encode(), name="x.cal")


def test_a_section_alone_does_not_make_one() -> None:
    with pytest.raises(UnknownFormatError):
        parsers.decode(b"[SPATIAL]\nreference = here\n", name="x.cal")
