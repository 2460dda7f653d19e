"""lensfun's database is known for what it is, and never becomes a K."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.errors import UnsupportedModelError
from tests.parsers.samples import Sample

LENS = '<lensdatabase version="2"><lens><model>X</model><calibration/></lens></lensdatabase>'

SAMPLES = {"lensfun_xml": Sample(LENS.encode())}


@pytest.mark.parametrize(
    "prolog", ["", '<?xml version="1.0"?>\n', '<!DOCTYPE lensdatabase SYSTEM "lensfun-database.dtd">\n']
)
def test_a_profile_is_refused_with_the_way_out(prolog: str) -> None:
    with pytest.raises(UnsupportedModelError, match=r"lens profile.*Calibrate the camera"):
        parsers.decode((prolog + LENS).encode(), name="actioncams.xml")
