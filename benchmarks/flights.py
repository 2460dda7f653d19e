"""Whether the standard deviations of cameras from flights hold, and whether flights that determine none are told.

    python -m benchmarks.flights [--sets N] [--only WORD]

Flights of a known camera as tracks, with normal noise, outliers and positions that drift, nothing rendered. Of each
the true error of fx, fy, cx and cy is held against the σ × κ that it states. Wanted: at least 95 % of the flights below
3 σ, and no flight over flat ground at one height, straight down, that passes.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if not TYPE_CHECKING:
    # A program's own folder is where Python looks first.
    sys.path.insert(0, str(Path(__file__).parents[1]))

from calibrary.calib.verdict import BoardVerdict
from calibrary.errors import CalibrationError
from calibrary.sfm.adjust import adjust
from calibrary.sfm.assessment import flight_result
from tests.sfm.flights import CAMERA, PLANS, fly

NAMES = ("fx", "fy", "cx", "cy")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sets", type=int, default=60)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    truth = np.array([getattr(CAMERA.intrinsics, name) for name in NAMES])
    print(f"{'flights':<28}{'n':>4}  {'|z| < 3: fx':>11}{'fy':>6}{'cx':>6}{'cy':>6}  {'σ(fx)/fx':>9}"
          f"{'κ²':>6}{'fx by px':>10}  PASS PROV REFUSE none  {'CPU s':>6}")  # fmt: skip
    for name, plan in PLANS.items():
        if given.only not in name:
            continue
        scores, spreads, kappas, weak = [], [], [], []
        verdicts = dict.fromkeys(BoardVerdict, 0)
        failed, begun = 0, time.process_time()
        for seed in range(given.sets):
            try:
                flight = flight_result(adjust(*fly(plan, seed)))
            except CalibrationError:
                failed += 1
                continue
            result = flight.result
            quality, K = result.calibration.quality, result.calibration.intrinsics
            assert quality is not None
            std = np.array([quality.std[one] for one in NAMES]) * np.sqrt(quality.inflation)
            found = np.array([getattr(K, one) for one in NAMES])
            scores.append(np.abs(found - truth) / std)
            spreads.append(std[0] / K.fx)
            kappas.append(quality.kappa2 or np.nan)
            weak.append(flight.trust.geometry.focal_by_px)
            verdicts[result.verdict] += 1
        spent = (time.process_time() - begun) / max(given.sets, 1)
        inside = (np.array(scores) < 3).mean(axis=0) if scores else np.full(4, np.nan)
        print(
            f"{name:<28}{given.sets:>4}  {inside[0]:>11.0%}{inside[1]:>6.0%}{inside[2]:>6.0%}{inside[3]:>6.0%}  "
            f"{np.median(spreads):>9.3%}{np.nanmedian(kappas):>6.2f}{np.median(weak):>10.0%}  "
            f"{verdicts[BoardVerdict.PASS]:>4}{verdicts[BoardVerdict.PROVISIONAL]:>5}"
            f"{verdicts[BoardVerdict.REFUSE]:>7}{failed:>5}  {spent:>6.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
