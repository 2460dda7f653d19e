"""The rules of an audit, and its findings on the age of a calibration: the part that needs no image."""

from __future__ import annotations

from contextlib import suppress
from datetime import date
from enum import StrEnum

from calibrary.errors import InputError
from calibrary.registry.configuration import Repeat
from calibrary.registry.entry import Entry
from calibrary.registry.firmware import compare as compare_versions
from calibrary.registry.paths import id_of
from calibrary.validation import Finding, Severity


class Rule(StrEnum):
    """Rule that a finding is about, most urgent first; the value is the name shown to the user."""

    NO_ENTRY = "no entry"
    DRAFT = "only proposed"
    RETIRED = "retired in use"
    EXPIRED = "expired in use"
    SEVERAL = "several entries"
    UNLIKELY = "K is unlikely"
    DRIFT = "K drifted"
    PIXELS = "pixels contradict K"
    STEP = "K changed with the firmware"
    TREND = "K drifts"
    UNSTEADY = "K differs between dates"
    BROKEN = "entry unreadable"
    NAMELESS = "no name"
    FIRMWARE = "firmware changed"
    SIZE = "image size changed"
    EDITED = "images changed by a program"
    UNITS = "units differ"
    UNKNOWN_UNITS = "units unknown"
    OVER = "validity over"
    OLD = "calibrated long ago"
    UNDATED = "calibration date unknown"
    FUTURE = "calibration date in the future"
    TAGS = "tags disagree"
    FILE = "a file states another K"
    WAITING = "another K proposed"
    NOT_FLOWN = "not flown"


def age_finding(entry: Entry, today: date, rule: Repeat, *, has_flown: bool) -> Finding | None:
    """Finding on the age of a measured calibration; None if it is recent or was not measured.

    Age counts from the date that its source states, not from the day on which it was added.

    Args:
        entry: an approved entry.
        today: the date that counts as today.
        rule: when it is to be made again.
        has_flown: whether the flights contain images of its camera; if not, a stale calibration is only a note.
    """
    if not entry.calibration.grade.is_measured:
        return None
    id_, stated = id_of(entry.path), entry.calibration.provenance.date
    severity = Severity.WARNING if has_flown else Severity.NOTE
    unflown = "" if has_flown else "; it did not fly"
    remedy = f"calibrate it again: calibrary calibrate FRAMES --as {id_}" if has_flown else None
    if (outdated := _outdated(entry, rule)) is not None:
        message = f"{outdated}{unflown}"
        return Finding(rule=Rule.OLD, severity=severity, place=id_, message=message, remedy=remedy)
    made = _day(stated)
    if made is None:
        found = f"its date {stated!r:.40} is not a day" if stated is not None else "its source states no date"
        return Finding(
            rule=Rule.UNDATED,
            # Some formats never state a date; a warning that the user cannot resolve would hide the others.
            severity=Severity.NOTE,
            place=id_,
            message=f"{found}, so it may be of any age{unflown}",
            remedy="state the day: calibrary registry add FILE --date YYYY-MM-DD, with the file it was added from"
            if has_flown
            else None,
        )
    if made > today:
        return Finding(
            rule=Rule.FUTURE,
            severity=Severity.WARNING,
            place=id_,
            message=f"it is dated {made}, after today, {today}",
            remedy="state the right day: calibrary registry add FILE --date YYYY-MM-DD",
        )
    months = _months(made, today)
    if rule.months is None or months < rule.months:
        return None
    message = f"it was calibrated on {made}, {months} months ago, expected less than {rule.months}{unflown}"
    return Finding(rule=Rule.OLD, severity=severity, place=id_, message=message, remedy=remedy)


def _outdated(entry: Entry, rule: Repeat) -> str | None:
    """Return that a calibration was made under an earlier firmware than its model's rule names; None if not known."""
    made = entry.calibration.provenance.firmware
    with suppress(InputError):
        if made is not None and rule.firmware is not None and compare_versions(made, rule.firmware) < 0:
            return f"it was calibrated under firmware {made}, expected {rule.firmware} or later"
    return None


def due_again(entry: Entry, months: int) -> date | None:
    """Return the day from which a measured calibration is stale; None if it was not measured, or its day is unknown."""
    made = _day(entry.calibration.provenance.date) if entry.calibration.grade.is_measured else None
    if made is None:
        return None
    years, month = divmod(made.year * 12 + made.month - 1 + months, 12)
    if years >= date.max.year:
        return None
    try:
        return date(years, month + 1, made.day)
    except ValueError:  # the month is too short, so that it is over first
        return date(years, month + 2, 1)


def _day(stated: str | None) -> date | None:
    try:
        return date.fromisoformat((stated or "")[:10])
    except ValueError:
        return None


def _months(first: date, last: date) -> int:
    """Number of whole months from one date to another."""
    return (last.year - first.year) * 12 + last.month - first.month - (last.day < first.day)
