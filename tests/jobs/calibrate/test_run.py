"""The date of a calibration: of its frames, and where it is from in words."""

from __future__ import annotations

from datetime import date

import pytest

from calibrary.calib.observations import Days
from calibrary.jobs.calibrate.run import calibration_date

TODAY = date(2026, 3, 1)
STATED, FIRST, LAST = date(2020, 2, 29), date(2019, 5, 17), date(2019, 5, 18)


@pytest.mark.parametrize(
    ("stated", "taken", "expected", "origin"),
    [
        (None, (LAST, LAST), LAST, "from the images' EXIF"),
        (None, (FIRST, LAST), LAST, "from the images' EXIF, the last day of 2019-05-17 to 2019-05-18"),
        (None, None, TODAY, "today: the images state no date"),
        (None, (TODAY, TODAY), TODAY, "from the images' EXIF"),
        (
            None,
            (FIRST, date(2031, 1, 1)),
            TODAY,
            "today: the images' EXIF states 2031-01-01, which is in the future",
        ),
        (STATED, (FIRST, LAST), STATED, "as stated"),
        (STATED, None, STATED, "as stated"),
    ],
)
def test_the_date_is_stated_or_of_the_frames_or_today(
    stated: date | None, taken: Days | None, expected: date, origin: str
) -> None:
    assert calibration_date(stated, taken, TODAY) == (expected, origin)
