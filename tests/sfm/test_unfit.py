"""Why images do not fit together: labelled cases of what they have in common, and what is said of each."""

from __future__ import annotations

from itertools import combinations
from typing import Final

import numpy as np
import pytest

from calibrary.arrays import FloatArray
from calibrary.rotations import rotation_matrix
from calibrary.sfm.engine import Matches
from calibrary.sfm.mapping import obvious_reason_unfit, reason_unfit
from tests.sfm.flights import CAMERA, DOWN, HEIGHT_M, SIZE

IMAGES: Final = 8
MANY: Final = [2000] * IMAGES
EMPTY: Final = "{} of 8 images show fewer than 50 points"
ALONE: Final = "of 8 images {} show the same points, need 3"
ONE_VIEW: Final = "the camera did not move"
ONE_PLACE: Final = "were taken from one place"
NO_THREE: Final = "no 3 fit together"


def shared(centres: FloatArray, tilt_deg: float = 2.0, noise_px: float = 0.3) -> list[Matches]:
    """What images of flat ground share that look straight down from there, but for wind."""
    random = np.random.default_rng(4)
    points = np.column_stack([random.uniform(-110, 110, (2500, 2)), np.zeros(2500)])
    seen = []
    for centre in centres:
        turn = rotation_matrix(np.radians(random.normal(0, tilt_deg, 3) * (1, 1, 3))) @ DOWN
        pixels = CAMERA.project((points - centre) @ turn.T)
        pixels[~((pixels > 0) & (pixels < SIZE)).all(axis=1)] = np.nan
        seen.append(pixels + random.normal(0, noise_px, pixels.shape))
    return [
        Matches(
            first=a,
            second=b,
            pixels_first=seen[a][rows],
            pixels_second=seen[b][rows],
            by_homography=True,
        )
        for a, b in combinations(range(len(centres)), 2)
        if len(rows := np.flatnonzero(np.isfinite(seen[a] + seen[b]).all(axis=1))) >= 15
    ]


OVER_ONE_SPOT: Final = np.tile([0.0, 0.0, HEIGHT_M], (IMAGES, 1))
STRIP: Final = OVER_ONE_SPOT + np.arange(IMAGES)[:, None] * (0.0, 12.0, 0.0)
WIND: Final = OVER_ONE_SPOT + np.random.default_rng(2).normal(0, 0.3, (IMAGES, 3))


@pytest.mark.parametrize(
    ("features", "matches", "said"),
    [
        ([0] * IMAGES, [], EMPTY.format(8)),
        ([*MANY[:2], *[12] * 6], shared(STRIP[:2]), EMPTY.format(6)),
        (MANY, [], ALONE.format("no two")),
        (MANY, shared(STRIP[:2]), ALONE.format("no more than 2")),
        (MANY, shared(OVER_ONE_SPOT, tilt_deg=0.0), ONE_VIEW),
        (MANY, shared(STRIP[:3]), None),
        (MANY, shared(STRIP), None),
        (MANY, shared(OVER_ONE_SPOT), None),
    ],
    ids=["blank", "two not blank", "no overlap", "a pair", "one view", "three", "strip", "hover"],
)
def test_what_is_plain_before_a_reconstruction(
    features: list[int], matches: list[Matches], said: str | None
) -> None:
    reason = obvious_reason_unfit(features, matches, SIZE)
    assert (reason is None) if said is None else said in (reason or "")


@pytest.mark.parametrize(
    ("matches", "said"),
    [
        (shared(OVER_ONE_SPOT), ONE_PLACE),
        (shared(WIND), ONE_PLACE),
        (shared(STRIP), NO_THREE),
        (shared(STRIP, tilt_deg=0.0), NO_THREE),
        (shared(OVER_ONE_SPOT * (1, 1, 0) + np.linspace(40, 120, IMAGES)[:, None] * (0, 0, 1)), NO_THREE),
        ([], NO_THREE),
    ],
    ids=["hover", "hover in wind", "strip", "strip in still air", "climb", "nothing in common"],
)
def test_one_place_is_named_where_a_turn_explains_the_matches(matches: list[Matches], said: str) -> None:
    reason = reason_unfit(IMAGES, matches, SIZE)
    assert said in reason
    assert "give images" in reason
