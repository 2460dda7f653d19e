"""JPL's camera files are known and refused."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.errors import UnsupportedModelError
from tests.parsers.samples import Sample

SAMPLES = {"cahvor": Sample(b"Dimensions = 1024 768\nModel = CAHVOR = perspective\nC = 0 0 0\nA = 0 0 1\n")}


@pytest.mark.parametrize("model", ["CAHV", "CAHVOR", "CAHVORE3"])
def test_it_is_sent_to_mrcal(model: str) -> None:
    text = f"# a comment\nDimensions = 1024 768\nModel = {model[:7]} = perspective\nC = 0 0 0\nA = 0 0 1\n"
    with pytest.raises(UnsupportedModelError, match="mrcal-from-cahvor"):
        parsers.decode(text.encode(), name="left.cal")
