"""Flights of a known camera through pixels: images rendered, matched, reconstructed, adjusted and judged.

    python benchmarks/rendered_flights.py [--sets N] [--first SEED] [--only WORD] [--width PX]

Every pixel's ray is cast onto a textured height field by our own camera model (Brown, 5 terms), blurred, given noise
and compressed; the whole of ``calibrate flight`` follows, pycolmap's part included. Flights differ in their seed:
ground, texture, poses and noise. Each line is a flight: the error of fx, the σ × κ that it states, z of fx, fy, cx
and cy, and the verdict. Wanted: |z| < 3, and no flight over flat ground at one height, straight down, that passes.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

# The matrices are small: threads of BLAS cost more than they save, several times over on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
if not TYPE_CHECKING:
    # A program's own folder is where Python looks first.
    sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from calibrary.calibration import Calibration
from calibrary.errors import CalibrationError
from calibrary.jobs.calibrate_flight.run import FlightRequest, calibrate_flight_from
from tests.sfm.flights import CAMERA, Plan
from tests.sfm.rendered import render_flight

NAMES = ("fx", "fy", "cx", "cy")
FLIGHTS = {
    "nadir, flat": Plan(rows=4, columns=5),
    "nadir, cross strips, flat": Plan(heights=(1.0, 1.0), cross=True, rows=3, columns=4),
    "nadir, relief 6 %": Plan(relief=0.06, rows=4, columns=5),
    "two heights, cross, relief 6 %": Plan(relief=0.06, heights=(1.0, 1.5), cross=True, rows=3, columns=4),
    "two heights, cross, flat, RTK": Plan(
        heights=(1.0, 1.5), cross=True, rows=3, columns=4, gps_m=(0.02, 0.03)
    ),
    "30° oblique, cross, flat": Plan(heights=(1.0, 1.0), cross=True, oblique_deg=30.0, rows=3, columns=4),
    "30° oblique, two heights, relief": Plan(
        relief=0.04, heights=(1.0, 1.3), cross=True, oblique_deg=30.0, rows=3, columns=4
    ),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sets", type=int, default=6)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--only", default="")
    parser.add_argument("--width", type=int, default=600, help="px of an image")
    given = parser.parse_args()
    camera = CAMERA.scaled((given.width, given.width * 2 // 3))
    print(f"{'flight':<34}{'fx off':>9}{'σ × κ':>9}{'z: fx':>7}{'fy':>6}{'cx':>6}{'cy':>6}{'κ²':>7}{'rms px':>8}"
          f"{'points':>8}  {'verdict':<12}{'CPU s':>6}")  # fmt: skip
    for seed in range(given.first, given.first + given.sets):
        for name, plan in FLIGHTS.items():
            if given.only in name:
                print(f"{name:<34}{_flown(plan, camera, seed)}", flush=True)


def _flown(plan: Plan, camera: Calibration, seed: int) -> str:
    truth = np.array([getattr(camera.intrinsics, one) for one in NAMES])
    with tempfile.TemporaryDirectory() as folder:
        paths = render_flight(Path(folder) / "flight", plan, camera, seed)
        begun = _cpu_s()
        try:
            result, _ = calibrate_flight_from(paths, FlightRequest(), lambda key: key)
        except CalibrationError as error:
            return f"  {error}"
        spent = _cpu_s() - begun
    quality, K = result.calibration.quality, result.calibration.intrinsics
    assert quality is not None
    std = np.array([quality.std[one] for one in NAMES]) * np.sqrt(quality.inflation)
    off = np.array([getattr(K, one) for one in NAMES]) - truth
    z = off / std
    return (
        f"{off[0] / truth[0]:>+9.3%}{std[0] / truth[0]:>9.3%}{z[0]:>+7.1f}{''.join(f'{one:>+6.1f}' for one in z[1:])}"
        f"{quality.kappa2 or np.nan:>7.1f}{quality.rms_px:>8.2f}{quality.points:>8}  {result.verdict:<12}{spent:>6.0f}"
    )


def _cpu_s() -> float:
    """Of this process and of those that it has started and that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


if __name__ == "__main__":
    main()
