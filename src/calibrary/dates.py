"""Conversion of dates to ISO 8601; ambiguous dates are rejected.

>>> iso_date("Tue Oct  8 10:53:15 2024")
'2024-10-08T10:53:15'
>>> iso_date("2020-05-06T21:47:42Z")
'2020-05-06T21:47:42Z'
>>> iso_date("03/04/2019")   # 3 April or 4 March: ambiguous, so None

A time without a time zone stays without one.
"""

from __future__ import annotations

import re
from datetime import date, time, timedelta, timezone
from functools import cache

LONGEST = 60
"""Characters; a longer text is not a date."""

_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_MONTH = (
    r"(?P<month>jan(?:uary)?|feb(?:ruary)?|mar(?:ch)?|apr(?:il)?|may|june?|july?|aug(?:ust)?|sept?(?:ember)?|"
    r"oct(?:ober)?|nov(?:ember)?|dec(?:ember)?)\.?"
)
_WEEKDAY = r"(?:(?:mon|tues?|wed(?:nes)?|thu(?:rs?)?|fri|sat(?:ur)?|sun)(?:day)?\.?,?\s+)?"
_CLOCK = r"(?P<hour>\d{1,2}):(?P<minute>\d{2})(?::(?P<second>\d{2})(?P<fraction>\.\d{1,9})?)?(?:\s?(?P<half>[ap]m))?"
_ZONE = r"(?:\s?(?P<zone>z|utc|gmt|[+-]\d{2}:?\d{2})|\s(?P<elsewhere>[a-z]{3,5}))?"
_TIME = rf"(?:(?:\s+|,\s*|t){_CLOCK}{_ZONE})?"
_YEAR = r"(?P<year>\d{4})"
_FORMS = (
    # ISO 8601, EXIF, and the same with slashes: with the year first, the order is unambiguous.
    rf"{_YEAR}(?P<mark>[-/.:])(?P<number>\d{{1,2}})(?P=mark)(?P<day>\d{{1,2}}){_TIME}",
    # C's asctime and strftime("%c"), which OpenCV, PhotoModeler and Metashape's OpenCV export use.
    rf"{_WEEKDAY}{_MONTH}\s+(?P<day>\d{{1,2}})\s+{_CLOCK}{_ZONE}\s+{_YEAR}",
    rf"{_WEEKDAY}{_MONTH}\s+(?P<day>\d{{1,2}})(?:st|nd|rd|th)?,?\s+{_YEAR}{_TIME}",
    # MATLAB's datestr, 09-Jan-2012, and dates with month names.
    rf"{_WEEKDAY}(?P<day>\d{{1,2}})(?:st|nd|rd|th)?(?:-|\.?\s+){_MONTH}(?:-|,?\s+){_YEAR}{_TIME}",
    rf"(?P<first>\d{{1,2}})(?P<mark>[-/.])(?P<next>\d{{1,2}})(?P=mark){_YEAR}{_TIME}",
    # Inpho writes the time first.
    rf"{_CLOCK}{_ZONE}\s+(?P<first>\d{{1,2}})(?P<mark>[-/.])(?P<next>\d{{1,2}})(?P=mark){_YEAR}",
)


def iso_date(text: str) -> str | None:
    """Return the date as ISO 8601, with time and zone if stated; None if it is not a date or is ambiguous.

    Numeric day and month are accepted only if they are equal or one of them is above 12.
    """
    text = text.strip()
    if len(text) > LONGEST:
        return None
    for form in _FORMS:
        found = _compiled(form).fullmatch(text)
        if found is not None:
            return _iso(found.groupdict())
    return None


@cache
def _compiled(form: str) -> re.Pattern[str]:
    """Compile a pattern on first use: all take 10 ms, a tenth of the start-up time of a command."""
    return re.compile(form, re.IGNORECASE | re.ASCII)


def _iso(parts: dict[str, str | None]) -> str | None:
    month, day = _month_and_day(parts)
    try:
        made = date(int(parts["year"] or 0), month, day)
        return made.isoformat() if parts.get("hour") is None else f"{made.isoformat()}T{_clock(parts)}"
    except ValueError:  # 30 February, 25 o'clock
        return None


def _month_and_day(parts: dict[str, str | None]) -> tuple[int, int]:
    """Return (month, day); (0, 0), which is not a date, when their order is ambiguous."""
    name = parts.get("month")
    if name is not None:
        return _MONTHS.index(name[:3].lower()) + 1, int(parts["day"] or 0)
    if parts.get("number") is not None:
        return int(parts["number"] or 0), int(parts["day"] or 0)
    first, second = int(parts["first"] or 0), int(parts["next"] or 0)
    if first > len(_MONTHS) or first == second:
        return second, first
    return (first, second) if second > len(_MONTHS) else (0, 0)


def _clock(parts: dict[str, str | None]) -> str:
    hour, minute, second = (int(parts[name] or 0) for name in ("hour", "minute", "second"))
    if parts["half"]:
        if not 1 <= hour <= 12:
            raise ValueError(f"{hour} is not an hour of half a day")
        hour = hour % 12 + (12 if parts["half"].lower() == "pm" else 0)
    clock = time(hour, minute, second).isoformat()
    zone = (parts["zone"] or "").upper()
    if zone in {"Z", "UTC", "GMT"}:
        zone = "Z"
    elif zone:
        hours, minutes = int(zone[1:3]), int(zone[-2:])
        timezone(timedelta(hours=hours, minutes=minutes))  # ValueError beyond a day
        zone = f"{zone[0]}{hours:02}:{minutes:02}"
    return f"{clock}{parts['fraction'] or ''}{zone}"
