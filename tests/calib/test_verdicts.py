"""Labelled sessions: what is refused, what is a start only with a wider σ, and that such a σ holds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from calibrary.calib.estimation import estimate
from calibrary.calib.observations import Observations
from calibrary.calib.result import CalibrationResult
from calibrary.calibration import Grade
from calibrary.records import replace
from calibrary.validation import Use

from .faults import rolling, two_boards
from .solving import SIZE, Session, camera, shoot

PASS, PROVISIONAL, REFUSE = Use


@dataclass(frozen=True, kw_only=True)
class Case:
    """A session and what has to be said of it."""

    make: Callable[[], Observations]
    verdict: Use
    rules: frozenset[str] = frozenset()
    warp: bool = True


def _noise() -> Observations:
    rng, seen = np.random.default_rng(0), shoot(how=Session(views=10))
    views = tuple(replace(view, image_points=rng.uniform(0, 1, (88, 2)) * SIZE) for view in seen.views)
    return replace(seen, views=views)


CASES: dict[str, Case] = {
    "careful": Case(make=lambda: shoot(how=Session(views=25)), verdict=PASS),
    "noisy corners": Case(make=lambda: shoot(how=Session(views=25, sigma_px=0.3)), verdict=PASS),
    "six views": Case(
        make=lambda: shoot(how=Session(views=6)), verdict=PROVISIONAL, rules=frozenset({"few-views"})
    ),
    "rolling shutter": Case(make=rolling, verdict=PROVISIONAL, rules=frozenset({"unstable"})),
    "stretched print": Case(
        make=lambda: shoot(how=Session(views=25, stretch=(1.0, 1.001))),
        verdict=PROVISIONAL,
        rules=frozenset({"stretched-print"}),
    ),
    "bow, not solved for": Case(
        make=lambda: shoot(how=Session(bow_mm=0.3, views=25)),
        verdict=PROVISIONAL,
        rules=frozenset({"board-warp", "unstable"}),
        warp=False,
    ),
    "two boards": Case(make=two_boards, verdict=REFUSE, rules=frozenset({"poor-fit"})),
    "parallel boards": Case(
        make=lambda: shoot(how=Session(tilt_deg=2.0)), verdict=REFUSE, rules=frozenset({"low-tilt"})
    ),
    "centre only": Case(
        make=lambda: shoot(how=Session(reach=0.4, fill=(0.1, 0.35))),
        verdict=PROVISIONAL,
        rules=frozenset({"unproven-region"}),
    ),
    "no board at all": Case(make=_noise, verdict=REFUSE, rules=frozenset({"poor-fit"})),
}


def _furthest(result: CalibrationResult) -> float:
    """The largest of |error| ÷ stated standard deviation over K's four numbers."""
    quality, truth = result.calibration.quality, camera().intrinsics
    assert quality is not None
    wider = math.sqrt(quality.inflation)
    K = result.calibration.intrinsics
    return max(
        float(abs(getattr(K, name) - getattr(truth, name)) / (quality.std[name] * wider))
        for name in ("fx", "fy", "cx", "cy")
    )


@cache
def solved(name: str) -> CalibrationResult:
    """Each session is solved once for all who look at it."""
    case = CASES[name]
    return estimate(case.make(), warp=case.warp)


@pytest.mark.parametrize("name", CASES)
def test_the_verdict_is_the_labelled_one_and_what_is_not_refused_holds(name: str) -> None:
    case, result = CASES[name], solved(name)
    assert result.verdict is case.verdict
    assert case.rules <= set(result.rules)
    if result.verdict is not REFUSE:
        assert _furthest(result) < 3.0


@pytest.mark.parametrize("name", CASES)
def test_only_what_may_be_used_is_graded_as_calibrated(name: str) -> None:
    result = solved(name)
    assert (result.calibration.grade is Grade.CALIBRATED) is (result.verdict is not REFUSE)


def test_a_variance_factor_names_the_limits_that_it_is_judged_by() -> None:
    found = next(finding for finding in solved("rolling shutter").findings if finding.rule == "unstable")
    assert "above 14 K is not kept fixed" in found.message
    assert "every σ is multiplied by 8" in found.message
