"""Labelled cases of a calibration's age, by the date that its source states."""

from __future__ import annotations

from datetime import date

import pytest

from calibrary.calibration import Grade
from calibrary.jobs.audit.findings import age_finding
from calibrary.records import replace
from calibrary.registry.entry import Status
from tests.registry.entries import FILE, an_entry

TODAY = date(2026, 6, 15)

CASES = (
    ("made in 2019", "2019-03-05", "calibrated long ago"),
    ("with a time of day", "2019-03-05T10:11:12Z", "calibrated long ago"),
    ("two years to the day", "2024-06-15", "calibrated long ago"),
    ("a day short of two years", "2024-06-16", None),
    ("this spring", "2026-04-02", None),
    ("today", "2026-06-15", None),
    ("unknown", None, "calibration date unknown"),
    ("not a day", "2019-02-31", "calibration date unknown"),
    ("tomorrow", "2026-06-16", "calibration date in the future"),
    ("by a camera whose clock was never set", "2099-01-01", "calibration date in the future"),
)


@pytest.mark.parametrize(("stated", "rule"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_a_measured_calibration_is_as_old_as_its_source_says(stated: str | None, rule: str | None) -> None:
    entry = an_entry(provenance=replace(FILE, date=stated), status=Status.APPROVED)
    found = age_finding(entry, TODAY, 24, has_flown=True)
    assert (found.rule if found is not None else None) == rule
    level = "note" if rule == "calibration date unknown" else "warning"
    assert found is None or found.severity.value == level


@pytest.mark.parametrize("stated", ["2019-03-05", None])
def test_of_a_camera_that_did_not_fly_it_is_a_note(stated: str | None) -> None:
    found = age_finding(an_entry(provenance=replace(FILE, date=stated)), TODAY, 24, has_flown=False)
    assert found is not None
    assert (found.severity.value, found.message.endswith("; it did not fly")) == ("note", True)


def test_what_was_never_measured_has_no_age() -> None:
    entry = an_entry(provenance=replace(FILE, date="2019-03-05"))
    nominal = replace(entry, calibration=replace(entry.calibration, grade=Grade.DESIGN))
    assert age_finding(nominal, TODAY, 24, has_flown=True) is None
