"""Pix4D's camera database is recognised, and refused with the way out."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.errors import UnsupportedModelError
from tests.parsers.samples import Sample

DATABASE = (
    b'<cameraModelDB><version>19</version><cameras><camera name="A_8.8_5472x3648"/></cameras></cameraModelDB>'
)
SAMPLES = {"pix4d_camera_database": Sample(DATABASE)}


def test_it_is_refused_by_name_with_the_way_out() -> None:
    with pytest.raises(UnsupportedModelError, match=r"Pix4D camera database.*\.cam"):
        parsers.decode(DATABASE, name="cameras.xml")
