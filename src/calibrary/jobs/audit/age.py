"""Age of an entry's calibration, counted from the date that its source states, not from the day it was added."""

from __future__ import annotations

from datetime import date

from calibrary.jobs.audit.agreement import MEASURED
from calibrary.jobs.audit.rules import Rule
from calibrary.registry.entry import Entry
from calibrary.registry.paths import id_of
from calibrary.validation import Finding, Severity

__all__ = ["age_finding"]


def age_finding(entry: Entry, today: date, stale_months: int, *, has_flown: bool) -> Finding | None:
    """Finding on the age of a measured calibration; None if it is recent or was not measured.

    Args:
        entry: an approved or held entry.
        today: the date that counts as today.
        stale_months: age in whole months from which a calibration is stale.
        has_flown: whether the flights contain images of its camera; if not, a stale calibration is only a note.
    """
    if entry.calibration.grade not in MEASURED:
        return None
    id_, stated = id_of(entry.path), entry.calibration.provenance.date
    severity = Severity.WARNING if has_flown else Severity.NOTE
    unflown = "" if has_flown else "; it did not fly"
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
    if months < stale_months:
        return None
    return Finding(
        rule=Rule.OLD,
        severity=severity,
        place=id_,
        message=f"it was calibrated on {made}, {months} months ago, expected less than {stale_months}{unflown}",
        remedy=f"calibrate it again: calibrary calibrate FRAMES --as {id_}" if has_flown else None,
    )


def _day(stated: str | None) -> date | None:
    try:
        return date.fromisoformat((stated or "")[:10])
    except ValueError:
        return None


def _months(first: date, last: date) -> int:
    """Number of whole months from one date to another."""
    return (last.year - first.year) * 12 + last.month - first.month - (last.day < first.day)
