"""Parts of the frame that no point of a flight shows: labelled cases of what the camera is then good for.

The label is the largest difference, px, to the true camera over the whole frame, the camera free to turn.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace as changed
from functools import cache
from typing import Final

import numpy as np
import pytest

from calibrary.arrays import BoolArray
from calibrary.calib.lens_models import Solvable
from calibrary.calib.model_choice import RivalLens
from calibrary.calib.projection_difference import projection_difference
from calibrary.calib.result import CalibrationResult
from calibrary.calibration import Covariance
from calibrary.distortion import Rational
from calibrary.records import replace
from calibrary.sfm.adjust import adjust
from calibrary.sfm.assessment import flight_result
from calibrary.sfm.tracks import Tracks
from calibrary.validation import Finding, Use
from tests.sfm.flights import CAMERA, FISHEYE, PLANS, fly
from tests.thorough import every

OBLIQUE: Final = changed(PLANS["oblique, flat"], gps_m=(0.02, 0.03))
LENSES: Final = {
    "brown": CAMERA,
    "fisheye": FISHEYE,
    "rational": replace(
        CAMERA,
        intrinsics=replace(CAMERA.intrinsics, fx=672.5, fy=672.7),
        distortion=Rational(
            k1=0.6568, k2=0.1676, p1=-3e-5, p2=-4e-5, k3=0.01464, k4=0.8163, k5=0.2271, k6=0.04976
        ),
    ),
}


PARTS: Final = ("whole", "no corner", "no strip", "centre")


def seen(tracks: Tracks, part: str) -> BoolArray:
    """Which observations lie in a part of the frame."""
    x, y = (tracks.pixels / tracks.image_size).T
    where = {
        "whole": x > 0,
        "no corner": (x > 0.3) | (y > 0.3),
        "no strip": y > 0.18,
        "centre": (abs(x - 0.5) < 0.35) & (abs(y - 0.5) < 0.35),
    }
    return np.asarray(where[part], dtype=np.bool_)


@cache
def flown(lens: str, part: str) -> CalibrationResult:
    """What a flight tells whose images show points in a part of the frame only."""
    tracks, start = fly(OBLIQUE, 3, LENSES[lens])
    return flight_result(adjust(tracks.only(seen(tracks, part)), start))


def apart(lens: str, of: CalibrationResult) -> float:
    """The largest difference to the true camera over the whole frame, px, the camera turned by what is known best."""
    found = of.calibration
    assert found.quality is not None
    known = found.quality.covariance
    assert known is not None
    exact = Covariance.from_matrix(("fx",), np.zeros((1, 1)))
    by = Covariance.from_matrix(known.names, known.matrix * found.quality.inflation)
    return projection_difference(LENSES[lens], found, covariances=(exact, by), trusted_px=math.inf).max_px


def edge(of: CalibrationResult) -> Finding | None:
    return next((one for one in of.findings if one.rule == "uncertain-edge"), None)


@pytest.mark.parametrize(
    ("lens", "part"),
    every(4, [("brown", "no corner"), ("brown", "whole"), ("brown", "no strip"), ("fisheye", "no corner")]),
)
def test_a_lens_that_is_known_in_all_of_the_frame_is_kept_fixed(lens: str, part: str) -> None:
    found = flown(lens, part)
    assert found.verdict is Use.FIXED, found.rules
    assert apart(lens, found) < 1.5


@pytest.mark.thorough
@pytest.mark.parametrize("lens", ["brown", "fisheye"])
def test_a_lens_that_is_seen_in_the_middle_only_is_a_start(lens: str) -> None:
    found = flown(lens, "centre")
    assert apart(lens, found) > 5
    told = edge(found)
    assert found.verdict is Use.START
    assert told is not None
    assert re.search(r"no point was seen in [34]\d% of the frame", told.message), told.message
    assert told.remedy is not None
    assert "start from it" in told.remedy


@pytest.mark.thorough
def test_a_lens_beside_which_another_does_as_well_is_a_start() -> None:
    """A fisheye is chosen for a rational lens, which gains too little where points are: it is off in a corner."""
    found = flown("rational", "whole")
    told = edge(found)
    assert found.model is Solvable.FISHEYE
    assert apart("rational", found) > 3
    assert found.verdict is Use.START
    assert told is not None
    assert "a rational lens explains the images as well" in told.message


@pytest.mark.thorough
def test_what_a_rival_differs_by_is_in_sigma_as_far_as_it_is_plausible() -> None:
    tracks, start = fly(OBLIQUE, 3)
    alone = adjust(tracks, start, model=Solvable.BROWN)
    lens = alone.bundle.scene.parameters
    moved = lens * np.where(np.arange(len(lens)) == 8, 1.5, 1.0)

    def edge_px(*weights: float) -> float:
        rivals = tuple(
            RivalLens(model=Solvable.BROWN, parameters=moved, beside=lens, weight=one) for one in weights
        )
        found = flight_result(replace(alone, rivals=rivals)).evidence.edge_px
        assert found is not None
        return found

    none, half, whole = edge_px(), edge_px(0.5), edge_px(1.0)
    assert whole > 2 * none
    assert half**2 - none**2 == pytest.approx((whole**2 - none**2) / 2, rel=0.05)
