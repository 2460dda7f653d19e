"""Causes compete: each labelled fault is named, alone or as one of the two likeliest, and never in another's place."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from calibrary.calib.estimation import estimate, other_columns
from calibrary.calib.lens_models import Solvable
from calibrary.calib.misfit import Cause, Misfit, corner_noise, misfit
from calibrary.calib.network import Network
from calibrary.calib.observations import Observations
from calibrary.calib.solve import solve
from calibrary.distortion import KannalaBrandt
from calibrary.errors import CalibrationError
from calibrary.validation import Use
from tests.thorough import every, examples

from .faults import SESSIONS, blurred, flexing, miscounted, refocusing, rolling, stabilised, two_zooms
from .solving import SIZE, Session, camera, moved, shoot

CAUSES = {
    Cause.ROLLING_SHUTTER: rolling,
    Cause.FOCUS_CHANGES: refocusing,
    Cause.TWO_CAMERAS: two_zooms,
    Cause.STABILISED: stabilised,
    Cause.BOARD_FLEXES: flexing,
    Cause.MOTION_BLUR: blurred,
}
SEEDS = tuple(range(examples(1, 16)))


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


@pytest.mark.parametrize(
    "cause", [Cause.ROLLING_SHUTTER, Cause.STABILISED, Cause.BOARD_FLEXES, Cause.MOTION_BLUR]
)
def test_these_leave_their_own_mark_and_are_named_alone(cause: Cause) -> None:
    assert {_named(cause, seed) for seed in SEEDS} == {(cause,)}


def test_two_zooms_and_a_changing_focus_are_told_from_everything_else() -> None:
    for cause in (Cause.TWO_CAMERAS, Cause.FOCUS_CHANGES):
        for seed in SEEDS:
            assert set(_named(cause, seed)) <= {Cause.TWO_CAMERAS, Cause.FOCUS_CHANGES, Cause.STABILISED}


def test_noise_has_no_cause() -> None:
    for seed in SEEDS:
        assert _misfit(shoot(how=Session(views=20), seed=seed)).likely == ()


@pytest.mark.parametrize(("share", "along_px"), [(0.4, 0.25), (1.0, 0.6)])
def test_motion_blur_is_named_in_few_frames_and_in_all_of_them(share: float, along_px: float) -> None:
    for seed in (0, 1):
        (named,) = _misfit(blurred(seed, share, along_px)).likely
        assert named.cause is Cause.MOTION_BLUR


def test_views_that_are_noisier_all_around_are_not_said_to_be_blurred() -> None:
    seen, rng = shoot(how=Session(views=20), seed=3), np.random.default_rng(3)
    for index in range(0, 20, 2):
        seen = moved(seen, index, rng.normal(0, 0.4, (len(seen.views[index].ids), 2)))
    assert Cause.MOTION_BLUR not in {one.cause for one in _misfit(seen).rivals}


@pytest.mark.parametrize("columns", every(2, [8, 10, 12]))
@pytest.mark.parametrize("seed", every(3, range(3)))
def test_a_wrong_number_of_columns_is_named_with_the_right_one(columns: int, seed: int) -> None:
    with pytest.raises(CalibrationError, match="numbered as on a board of 11 columns"):
        estimate(miscounted(seed, columns))


def test_a_board_before_a_fisheye_is_counted_right() -> None:
    fisheye = camera(fx=560.0, fy=560.0, distortion=KannalaBrandt(k1=0.02, k2=-0.01, k3=0.001, k4=0.0))
    assert other_columns(shoot(fisheye, Session(views=20, fill=(0.4, 0.9)))) is None


def test_a_cause_comes_with_what_to_try() -> None:
    result = estimate(SESSIONS["two-cameras"](4))
    found = next(one for one in result.findings if one.rule in {"two-cameras", "unclear-cause"})
    assert "zoom" in found.message
    assert found.remedy is not None
    assert "serial number" in found.remedy
    assert result.verdict is not Use.FIXED
    assert "rolling-shutter" not in result.rules
