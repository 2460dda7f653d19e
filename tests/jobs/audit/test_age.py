"""Labelled cases of a calibration's age, by the date that its source states."""

from __future__ import annotations

from datetime import date

import pytest

from calibrary.calibration import Grade
from calibrary.jobs.audit.age import age_finding
from calibrary.records import replace
from calibrary.registry.configuration import Repeat, parse_configuration
from calibrary.registry.entry import Status
from tests.registry.entries import FILE, an_entry

TODAY = date(2026, 6, 15)
RULE = Repeat(of="dji", months=24)

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
    found = age_finding(entry, TODAY, RULE, has_flown=True)
    assert (found.rule if found is not None else None) == rule
    level = "note" if rule == "calibration date unknown" else "warning"
    assert found is None or found.severity.value == level


@pytest.mark.parametrize("stated", ["2019-03-05", None])
def test_of_a_camera_that_did_not_fly_it_is_a_note(stated: str | None) -> None:
    found = age_finding(an_entry(provenance=replace(FILE, date=stated)), TODAY, RULE, has_flown=False)
    assert found is not None
    assert (found.severity.value, found.message.endswith("; it did not fly")) == ("note", True)


def test_what_was_never_measured_has_no_age() -> None:
    entry = an_entry(provenance=replace(FILE, date="2019-03-05"))
    nominal = replace(entry, calibration=replace(entry.calibration, grade=Grade.DESIGN))
    assert age_finding(nominal, TODAY, RULE, has_flown=True) is None


RULES = """\
schema: "calibrary/registry-1"
layout: 3
repeat:
  - {of: "dji", months: 18}
  - {of: "DJI/FC6310R/", firmware: "01.02.0000"}
"""


@pytest.mark.parametrize(
    ("path", "rule"),
    [
        ("cameras/dji/fc6310r/5472x3648.yaml", Repeat(of="DJI/FC6310R/", months=24, firmware="01.02.0000")),
        ("cameras/dji/fc6310/5472x3648.yaml", Repeat(of="dji", months=18)),
        ("cameras/sony/ilce-7rm4/9504x6336.yaml", Repeat(of="sony/ilce-7rm4/9504x6336", months=24)),
    ],
    ids=["the longest name counts", "of a maker", "as the command says"],
)
def test_a_registry_says_by_model_when_its_calibrations_are_made_again(path: str, rule: Repeat) -> None:
    assert parse_configuration(RULES.encode()).repeat_of(path, 24) == rule


@pytest.mark.parametrize(
    ("made_under", "again"),
    [("01.01.0128", True), ("1.2", False), ("01.10.0", False), (None, False), ("another numbering", False)],
)
def test_a_calibration_made_under_an_earlier_firmware_is_made_again(
    made_under: str | None, again: bool
) -> None:
    entry = an_entry(provenance=replace(FILE, date="2026-04-02", firmware=made_under))
    found = age_finding(entry, TODAY, replace(RULE, firmware="01.02.0000"), has_flown=True)
    assert (found.message if found is not None else None) == (
        f"it was calibrated under firmware {made_under}, expected 01.02.0000 or later" if again else None
    )
