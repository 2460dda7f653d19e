"""Whether the pixels' verdict on K is right: K's that are right and wrong against simulated flights of a dozen images.

    python benchmarks/verify.py [--flights N] [--only WORD]

Flights of a known camera as tracks (normal noise, outliers, no positions); every one is adjusted once, and K's are
held against what was found: right, wrong by 3, 5 and 10 per cent, a crop's, a 35 mm equivalent taken for the focal
length. Wanted on well-conditioned flights: a right K contradicted in at most 2 %, one wrong by 3 % in at least 95 %.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if not TYPE_CHECKING:
    # A program's own folder is where Python looks first.
    sys.path.insert(0, str(Path(__file__).parents[1]))

from calibrary.sfm.pixel_check import PixelVerdict
from tests.sfm.pixel_cases import FLIGHTS, WELL, WRONG, looked_at, scaled_k

AGREEMENT = 0.05


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flights", type=int, default=50)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    print(
        f"{'flights':<34}{'n':>4}{'σ':>8}{'pairs':>7}   {'K':<24}{'agrees':>7}{'contradicts':>12}{'cannot tell':>12}"
    )
    bad = 0
    for name, plan in FLIGHTS.items():
        if given.only not in name:
            continue
        begun = time.process_time()
        looks = [looked_at(plan, seed) for seed in range(given.flights)]
        spent = (time.process_time() - begun) / given.flights
        std = np.median([one.found.std for one in looks if one.found is not None] or [np.nan])
        pairs = sum(one.pairs is not None for one in looks) / len(looks)
        for at, (what, factor) in enumerate(WRONG.items()):
            K = scaled_k(factor)
            counts = Counter(one.check(K, AGREEMENT).verdict for one in looks)
            shares = [counts[verdict] / len(looks) for verdict in PixelVerdict]
            first = f"{name:<34}{len(looks):>4}{std:>8.2%}{pairs:>7.0%}" if at == 0 else " " * 53
            last = f"   {spent:.1f} CPU s a flight" if at == 0 else ""
            print(
                f"{first}   {what:<24}{shares[0]:>7.0%}{shares[1]:>12.0%}{shares[2]:>12.0%}{last}", flush=True
            )
            if name in WELL:
                bad += shares[1] > 0.02 if factor == 1.0 else shares[1] < 0.95
            else:
                bad += shares[1] > 0.02 and factor == 1.0
    print("as wanted" if not bad else f"{bad} rows are not as wanted")


if __name__ == "__main__":
    main()
