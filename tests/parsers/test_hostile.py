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
}


@pytest.mark.parametrize(("record", "data", "message"), BROKEN.values(), ids=BROKEN)
def test_it_is_refused_at_once(record: str, data: bytes, message: str) -> None:
    def decode() -> None:
        with pytest.raises(ParseError, match=message):
            parsers.decode(data, name="hostile", format=record)

    decode()
    # A row of the table takes 1700, a module some hundred; each of the 3000 lines of cameras thirty, an empty one none.
    assert calls(decode) < 2_000 + 35 * data.count(b"=")
