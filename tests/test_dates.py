"""Dates in files: one meaning, or none."""

from __future__ import annotations

import time
from datetime import datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.dates import iso_date


@pytest.mark.parametrize(
    ("text", "iso"),
    [
        ("2019-05-14", "2019-05-14"),
        ("2019/05/14", "2019-05-14"),
        ("2019:05:14 10:22:31", "2019-05-14T10:22:31"),
        ("2020-05-06T21:47:42Z", "2020-05-06T21:47:42Z"),
        ("2020-08-30 22:55:50.25", "2020-08-30T22:55:50.25"),
        ("2020-08-30 22:55 +0200", "2020-08-30T22:55:00+02:00"),
        ("2020-08-30T22:55:50-07:30", "2020-08-30T22:55:50-07:30"),
        ("Tue Oct  8 10:53:15 2024", "2024-10-08T10:53:15"),
        ("Fri Oct 06 15:18:09 2017", "2017-10-06T15:18:09"),
        ("Tue 14 May 2019 10:22:31 AM CEST", "2019-05-14T10:22:31"),
        ("Tue 14 May 2019 12:22:31 AM UTC", "2019-05-14T00:22:31Z"),
        ("14 May 2019 12:22 pm", "2019-05-14T12:22:00"),
        ("09-Jan-2012 13:57:47", "2012-01-09T13:57:47"),
        ("May 11, 2004", "2004-05-11"),
        ("September 1st, 2004", "2004-09-01"),
        ("02 August, 2006   14:11:14", "2006-08-02T14:11:14"),
        ("19:07:49 17/08/2018", "2018-08-17T19:07:49"),
        ("08/17/2018", "2018-08-17"),
        ("17.8.2018", "2018-08-17"),
        ("04/04/2019", "2019-04-04"),
    ],
)
def test_a_date_with_one_meaning_is_read(text: str, iso: str) -> None:
    assert iso_date(text) == iso
    datetime.fromisoformat(iso)


@pytest.mark.parametrize(
    "text",
    [
        "", "03/04/2019", "3.4.2019", "10:00:00 03-04-2019", "14/05/19", "May 2019", "2019", "20190514", "last Tuesday",
        "30/02/2019", "2019-13-01", "2019-05-14 25:00:00", "2019-05-14 10:61", "14 May 2019 13:00 pm", "Mai 11 2004",
        "2019-05-14T10:00:00+29:00", "1 2 2019", "2019-05/14", "x" * 10_000, "٢٠١٩-٠٥-١٤",
    ],
)  # fmt: skip
def test_what_is_none_or_has_two_meanings_is_not_guessed(text: str) -> None:
    assert iso_date(text) is None


@given(st.datetimes(min_value=datetime(1000, 1, 1), max_value=datetime(9999, 12, 31)))
def test_c_and_iso_times_come_back(made: datetime) -> None:
    second = made.replace(microsecond=0)
    assert iso_date(time.asctime(second.timetuple())) == second.isoformat()
    assert iso_date(second.isoformat(" ")) == second.isoformat()
    assert iso_date(made.date().isoformat()) == made.date().isoformat()


@given(st.text(max_size=80))
def test_any_text_is_a_date_or_none(text: str) -> None:
    found = iso_date(text)
    assert found is None or datetime.fromisoformat(found).year >= 1
