"""Whether the standard deviations of cameras from flights hold, and whether flights that determine none are reported.

    python -m benchmarks.flights [--sets N] [--only WORD] [--points]

Flights of a known camera as tracks, with normal noise, outliers and positions that drift, nothing rendered. Of each
the true error of fx, fy, cx and cy is divided by the σ × κ that it states: z. Wanted: at least 95 % of the flights
below 3 σ, a root mean square of z near 1, and no flight over flat ground at one height, straight down, that passes.
"noise" is the root mean square of fx's z by the residuals alone, without halves, principal point and next term.
--points flies with ground control: six points, each marked in six images, in another height system unless said.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

# The matrices are small: threads of BLAS cost more than they save, several times over on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
if not TYPE_CHECKING:
    # A program's own folder is where Python looks first.
    sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from calibrary.calib.verdict import BoardVerdict
from calibrary.errors import CalibrationError
from calibrary.records import replace
from calibrary.sfm.adjust import Adjustment, adjust
from calibrary.sfm.assessment import flight_result
from calibrary.sfm.control import with_survey
from calibrary.sfm.sigma import covariance
from tests.sfm.flights import CAMERA, PLANS, Plan, fly
from tests.sfm.surveyed import DATUM, FRAME, survey

NAMES = ("fx", "fy", "cx", "cy")
LEVEL = (0.0, 0.0, 0.0)
RTK = (0.02, 0.03)
CONTROLLED: dict[str, tuple[Plan, float, float, tuple[float, float, float]]] = {
    "flat, one height": (PLANS["flat, one height"], math.inf, 0.0, DATUM),
    "flat, one height, no GPS": (Plan(gps_m=None), math.inf, 0.0, DATUM),
    "flat, one height, RTK, no points": (Plan(gps_m=RTK), -1.0, 0.0, DATUM),
    "flat, one height, RTK": (Plan(gps_m=RTK), math.inf, 0.0, DATUM),
    "flat, one height, RTK, same datum": (Plan(gps_m=RTK), 0.05, 0.0, LEVEL),
    "relief 6 %, one height": (PLANS["relief, one height"], math.inf, 0.0, DATUM),
    "relief 20 %, no points": (Plan(relief=0.2), -1.0, 0.0, DATUM),
    "relief 20 %": (Plan(relief=0.2), math.inf, 0.0, DATUM),
    "two heights, flat, RTK": (PLANS["two heights, flat, RTK"], math.inf, 0.0, DATUM),
    "two heights, relief, 10 % wrong": (PLANS["two heights, relief"], math.inf, 0.1, DATUM),
    "oblique, relief, no GPS": (PLANS["oblique, relief, no GPS"], math.inf, 0.0, DATUM),
}
"""Plan, σ of the offset of positions and points in m (below nought: no points), share of wrong marks, that offset."""


def flown(name: str, seed: int, *, points: bool) -> Adjustment:
    """One flight."""
    if not points:
        return adjust(*fly(PLANS[name], seed))
    plan, offset, wrong, datum = CONTROLLED[name]
    tracks, scene = fly(plan, seed)
    if offset >= 0:
        given = replace(survey(plan, seed, datum=datum, wrong=wrong), offset_std_m=offset)
        tracks, scene = with_survey(tracks, scene, given, FRAME)
    return adjust(tracks, scene)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sets", type=int, default=60)
    parser.add_argument("--only", default="")
    parser.add_argument("--points", action="store_true")
    given = parser.parse_args()
    truth = np.array([getattr(CAMERA.intrinsics, name) for name in NAMES])
    heads = "".join(f"{name:>6}" for name in (*NAMES, *NAMES))
    print(f"{'':<34}{'':>4}{'|z| < 3':>24}{'rms z':>24}")
    print(
        f"{'flights':<34}{'n':>4}{heads}{'noise':>7}{'σ(fx)/fx':>10}{'κ²':>6}{'fx by px':>10}"
        f"  PASS PROV REFUSE none  {'CPU s':>6}"
    )
    for name in CONTROLLED if given.points else PLANS:
        if given.only not in name:
            continue
        scores, noises, spreads, kappas, weak = [], [], [], [], []
        verdicts = dict.fromkeys(BoardVerdict, 0)
        failed, begun = 0, time.process_time()
        for seed in range(given.sets):
            try:
                adjusted = flown(name, seed, points=given.points)
                flight = flight_result(adjusted)
            except CalibrationError:
                failed += 1
                continue
            result = flight.result
            quality, K = result.calibration.quality, result.calibration.intrinsics
            assert quality is not None
            std = np.array([quality.std[one] for one in NAMES]) * np.sqrt(quality.inflation)
            found = np.array([getattr(K, one) for one in NAMES])
            scores.append((found - truth) / std)
            noises.append((found[0] - truth[0]) / np.sqrt(covariance(adjusted.bundle)[0, 0]))
            spreads.append(std[0] / K.fx)
            kappas.append(quality.kappa2 or np.nan)
            weak.append(flight.uncertainty.geometry.focal_by_px)
            verdicts[result.verdict] += 1
        spent = (time.process_time() - begun) / max(given.sets, 1)
        inside = (np.abs(scores) < 3).mean(axis=0) if scores else np.full(4, np.nan)
        size = np.sqrt(np.square(scores).mean(axis=0)) if scores else np.full(4, np.nan)
        print(
            f"{name:<34}{given.sets:>4}{''.join(f'{one:>6.0%}' for one in inside)}"
            f"{''.join(f'{one:>6.2f}' for one in size)}{np.sqrt(np.square(noises).mean()):>7.2f}"
            f"{np.median(spreads):>10.3%}{np.nanmedian(kappas):>6.2f}{np.median(weak):>10.0%}  "
            f"{verdicts[BoardVerdict.PASS]:>4}{verdicts[BoardVerdict.PROVISIONAL]:>5}"
            f"{verdicts[BoardVerdict.REFUSE]:>7}{failed:>5}  {spent:>6.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
