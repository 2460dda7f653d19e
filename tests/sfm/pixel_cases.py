"""Labelled cases: simulated flights of a dozen images, and K's that are right and wrong for them."""

from __future__ import annotations

from itertools import combinations
from typing import Final

import numpy as np

from calibrary.calibration import Calibration
from calibrary.errors import CalibrationError
from calibrary.jobs.verify.look import Look, looked
from calibrary.records import replace
from calibrary.sfm.engine import Matches
from calibrary.sfm.tracks import Tracks
from tests.sfm.flights import CAMERA, PLANS, Plan, fly


def of_twelve(name: str) -> Plan:
    """A plan of the flights with twelve images, and no positions unless said otherwise."""
    plan = PLANS[name]
    return replace(plan, rows=2, columns=3 if len(plan.heights) > 1 else 6, gps_m=None)


WELL: Final = (
    "two heights, relief",
    "oblique, flat",
    "oblique, relief, no GPS",
    "oblique, noise 0.8, 8 % out",
)
"""Flights that determine a focal length."""

RTK_M: Final = (0.03, 0.05)

FLIGHTS: Final = {
    **{name: of_twelve(name) for name in WELL},
    "relief, one height": of_twelve("relief, one height"),
    "flat, one height": of_twelve("flat, one height"),
    "flat, cross strips": of_twelve("flat, cross strips"),
    "flat, two heights": of_twelve("two heights, flat, RTK"),
    "flat, one height, RTK": replace(of_twelve("flat, one height"), gps_m=RTK_M),
    "flat, two heights, RTK": replace(of_twelve("two heights, flat, RTK"), gps_m=RTK_M),
    "relief, six images": replace(of_twelve("relief, one height"), columns=3),
}

WRONG: Final = {
    "right": 1.0,
    "3 % too long": 1.03,
    "3 % too short": 0.97,
    "5 % too long": 1.05,
    "10 % too short": 0.9,
    "of the frame, cropped 1.25×": 0.8,
    "35 mm equivalent as mm": 2.7,
}
"""K's factor; of a crop the pixels' focal length is that much longer than K's for the whole frame at this size."""


def scaled_k(factor: float, camera: Calibration = CAMERA) -> Calibration:
    """The camera's K with its focal lengths off by a factor."""
    K = camera.intrinsics
    return replace(camera, intrinsics=replace(K, fx=K.fx * factor, fy=K.fy * factor))


def looked_at(plan: Plan, seed: int, camera: Calibration = CAMERA) -> Look:
    """A simulated flight as the job looks at a real one, from tracks on."""
    tracks, scene = fly(plan, seed, camera)
    try:
        return looked(tracks, scene, pairs_of(tracks), camera)
    except CalibrationError as error:
        return Look(chosen=int(tracks.used.sum()), reason=str(error))


def pairs_of(tracks: Tracks) -> list[Matches]:
    """What each pair of images shares."""
    found = []
    for first, second in combinations(range(len(tracks.names)), 2):
        one, other = np.flatnonzero(tracks.image == first), np.flatnonzero(tracks.image == second)
        points, a, b = np.intersect1d(tracks.point[one], tracks.point[other], return_indices=True)
        if len(points) >= 15:
            found.append(
                Matches(
                    first=first,
                    second=second,
                    pixels_first=tracks.pixels[one][a],
                    pixels_second=tracks.pixels[other][b],
                    by_homography=False,
                )
            )
    return found
