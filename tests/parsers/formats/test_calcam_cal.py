"""CalCam files are known and refused."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.errors import UnknownFormatError, UnsupportedModelError
from tests.parsers.samples import Sample

SAMPLES = {"calcam_cal": Sample(b"CalCam calibration\n1 2 3\n")}


def test_it_is_sent_to_agisofts_xml() -> None:
    with pytest.raises(UnsupportedModelError, match="export Agisoft XML"):
        parsers.decode(b"CalCam calibration\n1 2 3\n", name="x.cal")


def test_the_name_must_stand_at_the_top() -> None:
    with pytest.raises(UnknownFormatError):
        parsers.decode(b"one\ntwo\nthree\nfour\nfive\nsix of CalCam\n", name="x.cal")
