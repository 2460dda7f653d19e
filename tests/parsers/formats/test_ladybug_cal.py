"""Ladybug calibrations are known and refused."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.errors import UnknownFormatError, UnsupportedModelError
from tests.parsers.samples import Sample

HEADS = """\
camera_model=Ladybug5 LD5
camera_serialBase=1
camera0_rotX=-2.1
camera0_FocalLen=457.3
camera0_CameraCenterX=1234.7
"""

SAMPLES = {"ladybug_cal": Sample(HEADS.encode())}


@pytest.mark.parametrize(
    "text",
    [HEADS, HEADS.partition("\n")[2], "Triclops 3.2 configuration\n\n0 1 2\n"],
    ids=["whole", "heads", "name"],
)
def test_it_is_sent_to_the_vendors_kit(text: str) -> None:
    with pytest.raises(UnsupportedModelError, match=r"Ladybug SDK"):
        parsers.decode(text.encode(), name="x.cal")


def test_a_word_farther_down_does_not_make_one() -> None:
    with pytest.raises(UnknownFormatError):
        parsers.decode(b"notes\nseen with a ladybug\n", name="x.cal")
