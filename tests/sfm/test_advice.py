"""What would help a flight now: what it says of σ is what comes out when it is done."""

from __future__ import annotations

import math
from functools import cache

import pytest

from calibrary.calib.result import CalibrationResult
from calibrary.records import replace
from calibrary.sfm.adjust import Adjustment, adjust
from calibrary.sfm.advice import helps
from calibrary.sfm.assessment import flight_result
from calibrary.sfm.control import with_survey
from calibrary.sfm.sigma import CameraUncertainty, camera_uncertainty
from tests.sfm.flights import Plan, fly
from tests.sfm.surveyed import FRAME, survey

RTK = Plan(gps_m=(0.02, 0.03))
SEED = 7


def sigma(flight: CalibrationResult) -> float:
    quality = flight.calibration.quality
    assert quality is not None
    return quality.std["fx"] * math.sqrt(quality.inflation) / flight.calibration.intrinsics.fx


@cache
def flown() -> Adjustment:
    return adjust(*fly(RTK, SEED))


@cache
def known() -> CameraUncertainty:
    return camera_uncertainty(flown())


def promised(word: str) -> float | None:
    found = helps(flown().bundle, known(), 0)
    return next((one.sigma for one in found if word in one.measure), None)


@pytest.fixture(scope="module")
def flat() -> CalibrationResult:
    return flight_result(flown(), left_out=24)


@pytest.mark.thorough
def test_surveyed_points_help_by_what_they_are_said_to(flat: CalibrationResult) -> None:
    tracks, scene = fly(RTK, SEED)
    given = replace(survey(RTK, SEED, datum=(0.0, 0.0, 0.0), wrong=0.0), offset_std_m=0.05)
    done = sigma(flight_result(adjust(*with_survey(tracks, scene, given, FRAME))))
    said = promised("--same-datum-m 0.05")
    assert said is None or said == pytest.approx(done, rel=0.3)
    assert (said is not None) == (done < 0.8 * sigma(flat))


def test_what_would_help_is_a_note_and_names_the_images_that_were_left_out(flat: CalibrationResult) -> None:
    [note] = [one for one in flat.findings if one.rule == "would-help"]
    assert "--images 48: 24 images were not chosen (σ of fx 0." in note.message
    assert note.severity.value == "note"


def test_no_more_images_are_advised_than_can_be_asked_for() -> None:
    found = helps(flown().bundle, known(), 900)
    assert any(one.measure == "--images 200: 900 images were not chosen" for one in found)


@pytest.mark.parametrize(
    "other", [{"separates_height": False}, {"fx": 1e9}], ids=["it cannot help", "it is not needed"]
)
def test_nothing_is_advised_where(other: dict[str, object]) -> None:
    assert helps(flown().bundle, known(), 900)
    assert helps(flown().bundle, replace(known(), **other), 900) == []


@pytest.mark.thorough
@pytest.mark.parametrize(
    "plan", [Plan(), Plan(relief=0.04, heights=(1.0, 1.4), cross=True, oblique_deg=30.0, gps_m=None)]
)
def test_a_flight_that_needs_nothing_or_that_nothing_helps_is_told_nothing(plan: Plan) -> None:
    flight = flight_result(adjust(*fly(plan, SEED)), left_out=24)
    assert "would-help" not in {one.rule for one in flight.findings}
