"""Causes compete: each labelled fault is named, alone or as one of the two likeliest, and never in another's place."""

from __future__ import annotations

from functools import cache

import pytest

from calibrary.calib.estimation import estimate
from calibrary.calib.lens_models import Solvable
from calibrary.calib.misfit import Cause, Misfit, corner_noise, misfit
from calibrary.calib.network import Network
from calibrary.calib.observations import Observations
from calibrary.calib.solve import solve
from calibrary.calib.verdict import BoardVerdict

from .faults import SESSIONS, flexing, refocusing, rolling, stabilised, two_zooms
from .solving import SIZE, Session, shoot

CAUSES = {
    Cause.ROLLING_SHUTTER: rolling,
    Cause.FOCUS_CHANGES: refocusing,
    Cause.TWO_CAMERAS: two_zooms,
    Cause.STABILISED: stabilised,
    Cause.BOARD_FLEXES: flexing,
}
SEEDS = (1, 2, 3, 4)


def _misfit(seen: Observations) -> Misfit:
    adjusted = solve(Network.of(seen), SIZE, model=Solvable.BROWN).adjusted
    found = misfit(adjusted, SIZE, corner_noise(seen))
    assert found is not None
    return found


@cache
def _named(cause: Cause, seed: int) -> tuple[Cause, ...]:
    return tuple(one.cause for one in _misfit(CAUSES[cause](seed)).likely)


@pytest.mark.parametrize("cause", CAUSES)
@pytest.mark.parametrize("seed", SEEDS)
def test_what_is_named_alone_is_the_cause_and_of_two_it_is_one(cause: Cause, seed: int) -> None:
    named = _named(cause, seed)
    assert not named or cause in named


@pytest.mark.parametrize("cause", [Cause.ROLLING_SHUTTER, Cause.STABILISED, Cause.BOARD_FLEXES])
def test_these_leave_their_own_mark_and_are_named_alone(cause: Cause) -> None:
    assert {_named(cause, seed) for seed in SEEDS} == {(cause,)}


def test_two_zooms_and_a_changing_focus_are_told_from_everything_else() -> None:
    for cause in (Cause.TWO_CAMERAS, Cause.FOCUS_CHANGES):
        for seed in SEEDS:
            assert set(_named(cause, seed)) <= {Cause.TWO_CAMERAS, Cause.FOCUS_CHANGES, Cause.STABILISED}


def test_noise_has_no_cause() -> None:
    for seed in range(4):
        assert _misfit(shoot(how=Session(views=20), seed=seed)).likely == ()


def test_a_cause_comes_with_what_to_try() -> None:
    result = estimate(SESSIONS["two-cameras"](4))
    found = next(one for one in result.findings if one.rule in {"two-cameras", "unclear-cause"})
    assert "zoom" in found.message
    assert found.remedy is not None
    assert "serial number" in found.remedy
    assert result.verdict is not BoardVerdict.PASS
    assert "rolling-shutter" not in result.rules
