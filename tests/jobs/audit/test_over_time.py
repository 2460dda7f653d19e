"""Labelled cases: what K over time, by the pixels of ordinary flights, may be said to have done."""

from __future__ import annotations

from datetime import date, timedelta
from typing import NamedTuple

import numpy as np
import pytest

from calibrary.jobs.audit.age import Rule
from calibrary.jobs.audit.over_time import Measurement, _change_finding, judge_over_time
from calibrary.jobs.audit.report import Change, UnitOverTime
from calibrary.validation import Severity
from tests.registry.entries import KEY

FX = 3660.0
FIRST = date(2025, 3, 1)


class Case(NamedTuple):
    """One unit's flights.

    Attributes:
        what: in words.
        flights: (days since the first, fx ÷ FX, relative σ, firmware).
        change: the right answer.
        by: how much K changed, relative; None where nothing may be said of that.
        unit_known: whether the images state a serial number.
    """

    what: str
    flights: tuple[tuple[int, float, float, str | None], ...]
    change: Change
    by: float | None = None
    unit_known: bool = True


A, B = "1.0", "2.0"
CASES = (
    Case("no flight that tells", (), Change.UNKNOWN),
    Case("one date", ((0, 1.03, 0.004, A),), Change.UNKNOWN),
    Case("two dates that agree", ((0, 1.002, 0.004, A), (90, 0.998, 0.004, A)), Change.STEADY),
    Case("far apart within a large σ", ((0, 1.04, 0.03, A), (90, 0.96, 0.03, A)), Change.STEADY),
    Case("2.8 σ is no drift", ((0, 1.0, 0.005, A), (90, 1.0198, 0.005, A)), Change.STEADY),
    Case("two dates apart", ((0, 1.0, 0.004, A), (90, 1.03, 0.004, A)), Change.DRIFT, 0.03),
    Case(
        "a drift across dates",
        tuple((60 * n, 1 + 0.006 * n, 0.004, A) for n in range(6)),
        Change.DRIFT,
        0.03,
    ),
    Case(
        "a drift that no two neighbours show",
        tuple((30 * n, 1 - 0.002 * n, 0.004, A) for n in range(10)),
        Change.DRIFT,
        -0.018,
    ),
    Case("two firmware versions apart", ((0, 1.0, 0.004, A), (90, 0.97, 0.004, B)), Change.STEP, -0.03),
    Case(
        "a step at a firmware change",
        tuple((60 * n, 1.0 if n < 3 else 1.025, 0.004, A if n < 3 else B) for n in range(6)),
        Change.STEP,
        0.025,
    ),
    Case(
        "a firmware change without a step",
        tuple((60 * n, 1.0, 0.004, A if n < 3 else B) for n in range(6)),
        Change.STEADY,
    ),
    Case(
        "a step without a firmware change: a lens replaced, another focus",
        tuple((60 * n, 1.0 if n < 3 else 1.05, 0.003, A) for n in range(6)),
        Change.UNSTEADY,
        0.05,
    ),
    Case(
        "to and fro",
        tuple((30 * n, 1.0 + 0.04 * (n % 2), 0.004, A) for n in range(6)),
        Change.UNSTEADY,
        0.04,
    ),
    Case(
        "two units mixed, no serial number",
        tuple((30 * n, 1.0 + 0.04 * (n % 2), 0.004, A) for n in range(6)),
        Change.SEVERAL_UNITS,
        0.04,
        unit_known=False,
    ),
    Case(
        "unit unknown, a trend",
        ((0, 1.0, 0.004, A), (90, 1.03, 0.004, A)),
        Change.SEVERAL_UNITS,
        0.03,
        unit_known=False,
    ),
    Case(
        "unit unknown, all alike",
        ((0, 1.0, 0.004, A), (90, 1.001, 0.004, None)),
        Change.STEADY,
        unit_known=False,
    ),
)


def measurements(flights: tuple[tuple[int, float, float, str | None], ...]) -> list[Measurement]:
    return [
        Measurement(day=FIRST + timedelta(days=day), fx=FX * factor, std=std, firmware=firmware)
        for day, factor, std, firmware in flights
    ]


@pytest.mark.parametrize("case", CASES, ids=[case.what for case in CASES])
def test_what_k_did_over_time(case: Case) -> None:
    found = judge_over_time(measurements(case.flights), unit_known=case.unit_known)
    assert found.change is case.change, found.reason
    if case.by is None:
        assert found.by is None
    else:
        assert found.by is not None
        assert found.std is not None
        assert found.by == pytest.approx(case.by, abs=0.004)
        assert abs(found.by) > 3 * found.std


def test_the_order_in_which_flights_are_given_makes_no_difference() -> None:
    flights = measurements(CASES[9].flights)
    assert judge_over_time(flights[::-1], unit_known=True) == judge_over_time(flights, unit_known=True)


@pytest.mark.parametrize("dates", [2, 4, 8])
def test_noise_alone_is_steady(dates: int) -> None:
    random, changed = np.random.default_rng(dates), 0
    for _ in range(400):
        flights = tuple(
            (40 * n, 1 + 0.005 * float(random.normal()), 0.005, A if n < dates // 2 else B)
            for n in range(dates)
        )
        changed += judge_over_time(measurements(flights), unit_known=True).change is not Change.STEADY
    assert changed <= 0.015 * 400


@pytest.mark.parametrize(
    ("change", "rule", "severity"),
    [
        (Change.DRIFT, Rule.TREND, Severity.WARNING),
        (Change.STEP, Rule.STEP, Severity.WARNING),
        (Change.UNSTEADY, Rule.UNSTEADY, Severity.WARNING),
        (Change.SEVERAL_UNITS, Rule.UNKNOWN_UNITS, Severity.NOTE),
    ],
)
def test_a_change_over_time_asks_for_a_calibration_unless_the_units_are_unknown(
    change: Change, rule: Rule, severity: Severity
) -> None:
    unit = UnitOverTime(
        name="u", camera=KEY, flights=(), change=change, by=0.01, std=0.001, reason="fx moves"
    )
    found = _change_finding("camera", unit)
    assert (found.rule, found.severity, found.message, found.measured) == (rule, severity, "fx moves", 0.01)
    assert (found.remedy is None) is (severity is Severity.NOTE)
