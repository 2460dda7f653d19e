"""Flights of one simulated camera, solved together."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.calib.lens_models import Solvable
from calibrary.records import replace
from calibrary.sfm.adjust import Adjustment, adjust
from calibrary.sfm.assessment import flight_result
from calibrary.sfm.season import of_one_model, solve_season
from calibrary.sfm.sigma import CameraUncertainty, camera_uncertainty
from tests.sfm.flights import CAMERA, Plan, fly

RTK = Plan(gps_m=(0.02, 0.03), rows=3, columns=5, points=400)
NAMES = ("fx", "fy", "cx", "cy")
TRUTH = np.array([getattr(CAMERA.intrinsics, name) for name in NAMES])


def flown(plan: Plan, count: int, growth: float = 0.0) -> tuple[list[Adjustment], list[CameraUncertainty]]:
    """Flights at equal distances of time; the focal length grows by a share until the last."""
    K, found = CAMERA.intrinsics, []
    for at in range(count):
        by = 1.0 - growth * (1.0 - at / (count - 1))
        camera = replace(CAMERA, intrinsics=replace(K, fx=K.fx * by, fy=K.fy * by))
        found.append(adjust(*fly(plan, 70 + at, camera), model=Solvable.BROWN, readout_s=(0.0, 0.0)))
    return found, [camera_uncertainty(one) for one in found]


def test_flights_together_know_the_lens_better_than_any_alone_and_rightly() -> None:
    found, known = flown(RTK, 4)
    season = solve_season(found, known)
    result = flight_result(season.whole, known=season.known).result
    quality, K = result.calibration.quality, result.calibration.intrinsics
    assert quality is not None
    std = np.array([quality.std[name] for name in NAMES]) * np.sqrt(quality.inflation)
    assert np.abs((np.array([getattr(K, name) for name in NAMES]) - TRUTH) / std).max() < 3
    best = min(np.sqrt(one.covariance.matrix[0, 0] * one.inflation) for one in known)
    assert std[0] < 0.75 * best
    assert len(result.observations.views) == 60
    assert len({view.name for view in result.observations.views}) == 60


def test_flights_of_one_kind_separate_focal_length_and_height_no_better_by_their_number() -> None:
    found, known = flown(replace_plan(gps_m=(1.5, 2.5)), 3)
    alone = [one.geometry.focal_by_px for one in known]
    assert 0.7 * min(alone) < solve_season(found, known).known.geometry.focal_by_px < 1.4 * max(alone)


def test_a_lens_that_grows_is_that_of_the_last_day_and_the_drift_is_found() -> None:
    found, known = flown(replace_plan(gps_m=(0.02, 0.03), heights=(1.0, 1.5), cross=True), 4, growth=0.009)
    years = [2021.0, 2022.0, 2023.0, 2024.0]
    season = solve_season(found, known, years)
    assert season.drift is not None
    assert abs(season.drift.focal - 0.003) < 3 * season.drift.std[0]
    assert season.drift.focal > 3 * season.drift.std[0]
    assert abs(season.known.fx - TRUTH[0]) < 3 * np.sqrt(season.known.covariance.matrix[0, 0])


def test_within_a_month_no_drift_is_looked_for() -> None:
    found, known = flown(replace_plan(rows=2, columns=4, gps_m=(0.02, 0.03)), 2)
    assert solve_season(found, known, [2024.0, 2024.05]).drift is None


def test_what_one_lens_does_to_all_flights_does_not_shrink_with_their_number() -> None:
    found, known = flown(replace_plan(rows=2, columns=4, gps_m=(0.02, 0.03)), 2)
    bent = [replace(one, of_lens=one.of_lens + np.diag([25.0, *[0.0] * 8])) for one in known]
    by = [solve_season([found[0]] * n, [bent[0]] * n).known.of_lens[0, 0] for n in (2, 4)]
    assert by[0] >= 24.0
    assert by[1] == pytest.approx(by[0], rel=0.05)


def test_flights_that_chose_other_lens_models_get_that_of_the_largest() -> None:
    small = adjust(*fly(replace_plan(rows=2, columns=4), 1), model=Solvable.RATIONAL)
    large = adjust(*fly(replace_plan(rows=3, columns=4), 2), model=Solvable.BROWN)
    alike = of_one_model([small, large])
    assert alike[1] is large
    assert alike[0].bundle.scene.model is Solvable.BROWN


def replace_plan(**changes: object) -> Plan:
    """A small flight."""
    return Plan(**{"rows": 3, "columns": 5, "points": 300} | changes)  # type: ignore[arg-type]
