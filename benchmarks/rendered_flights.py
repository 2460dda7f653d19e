"""Flights of a known camera through pixels: images rendered, matched, reconstructed, adjusted and judged.

    python benchmarks/rendered_flights.py [--sets N] [--first SEED] [--only WORD] [--width PX] [--boards | --faults]

Every pixel's ray is cast onto a textured height field by our own camera model (Brown, 5 terms), blurred, given noise
and compressed; the whole of ``calibrate flight`` follows, pycolmap's part included. Flights differ in their seed:
ground, texture, poses and noise. Each line is a flight: the error of fx, the σ × κ that it states, z of fx, fy, cx
and cy, and the verdict. Wanted: |z| < 3, and no flight over flat ground at one height, straight down, that passes.

With --boards each seed is another camera, which is calibrated twice: by rendered frames of a board, and by a flight of
the kind that --only names first. The difference of the two is divided by the σ × κ of both together.

With --faults each flight has by chance what ``benchmarks.flights --faults`` has, the shutter's row by row, and
every other camera is a fisheye; three images were saved again by a viewer, cut and enlarged. The
last lines count by use.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

# The matrices are small: threads of BLAS cost more than they save, several times over on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
if not TYPE_CHECKING:
    # A program's own folder is where Python looks first.
    sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from benchmarks.flights import faulty, nearest
from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.detection import detect
from calibrary.calib.estimation import estimate
from calibrary.calib.found import NotFound
from calibrary.calib.observations import Observations, View
from calibrary.calib.result import CalibrationResult
from calibrary.calib.synthesis import Settings, poses, render
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady
from calibrary.errors import CalibrationError
from calibrary.jobs.calibrate.run import Told
from calibrary.jobs.calibrate_flight.run import FlightOptions, SolvedFlight, solve_images
from calibrary.jobs.use import Use, allowed
from calibrary.policy import FLEET
from calibrary.records import replace
from tests.sfm.flights import CAMERA, FISHEYE, Plan
from tests.sfm.rendered import render_flight

BOARD = Board(columns=11, rows=8, square_mm=40.0)
VIEWS = 20
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
    parser.add_argument("--boards", action="store_true", help="against boards")
    parser.add_argument("--faults", action="store_true", help="with faults by chance")
    given = parser.parse_args()
    size = given.width, given.width * 2 // 3
    flights = {name: plan for name, plan in FLIGHTS.items() if given.only in name}
    seeds = range(given.first, given.first + given.sets)
    z = f"{'z: fx':>8}{'fy':>6}{'cx':>6}{'cy':>6}"
    if given.boards:
        name, plan = next(iter(flights.items()))
        print(f"camera: fx px, board's σ × κ and verdict, that of the flight ({name}), {z}")
        for seed in seeds:
            print(_compared(plan, _unit(size, seed), seed), flush=True)
        return
    heads = f"{'κ²':>7}{'rms px':>8}{'points':>8}  {'verdict':<12}{'use':<6}{'CPU s':>6}"
    print(f"{'flight':<34}{'fx off':>9}{'σ × κ':>9}{z}{heads}")
    counts: Counter[tuple[Use, bool]] = Counter()
    for number, seed in enumerate(seeds):
        for name, plan in flights.items():
            lens = FISHEYE if given.faults and number % 2 else CAMERA
            flight = faulty(plan, seed) if given.faults else plan
            print(
                f"{name:<34}{_flown(flight, lens.scaled(size), seed, 3 * given.faults, counts)}", flush=True
            )
    for use in Use:
        print(f"{use}: {counts[use, False] + counts[use, True]}, beyond 3 σ {counts[use, True]}")


def _flown(plan: Plan, camera: Calibration, seed: int, edited: int, counts: Counter[tuple[Use, bool]]) -> str:
    begun = _cpu_s()
    try:
        solved = _solved(plan, camera, seed, edited)
        result = solved.calibrated(Told())[0]
    except CalibrationError as error:
        counts[Use.NONE, False] += 1
        return f"  {error}"
    truth, (found, std), quality = _pinhole(camera), _measured(result), result.calibration.quality
    assert quality is not None
    if plan.ripple_px:
        truth = nearest(camera, plan.ripple_px, solved.found.bundle.scene.model)
    use = allowed(result.calibration, FLEET).use
    counts[use, bool((np.abs((found - truth) / std) > 3).any())] += 1
    return (
        f"{found[0] / truth[0] - 1:>+9.3%}{std[0] / truth[0]:>9.3%}  {_scores((found - truth) / std)}"
        f"{quality.kappa2 or np.nan:>7.1f}{quality.rms_px:>8.2f}{quality.points:>8}  {result.verdict:<12}"
        f"{use:<6}{_cpu_s() - begun:>6.0f}"
    )


def _compared(plan: Plan, camera: Calibration, seed: int) -> str:
    by_board, by_flight = _by_board(camera, seed), _solved(plan, camera, seed).calibrated(Told())[0]
    (a, a_std), (b, b_std) = _measured(by_board), _measured(by_flight)
    return (
        f"{camera.intrinsics.fx:>7.1f}  {a_std[0] / a[0]:.3%} {by_board.verdict:<12} {b_std[0] / b[0]:.3%} "
        f"{by_flight.verdict:<12}  {_scores((b - a) / np.hypot(a_std, b_std))}"
    )


def _solved(plan: Plan, camera: Calibration, seed: int, edited: int = 0) -> SolvedFlight:
    with tempfile.TemporaryDirectory() as folder:
        paths = render_flight(Path(folder) / "flight", plan, camera, seed, edited=edited)
        return solve_images(paths, Told(), FlightOptions())


def _by_board(camera: Calibration, seed: int) -> CalibrationResult:
    views = []
    for number, pose in enumerate(poses(BOARD, camera, VIEWS, seed, roll_deg=180.0)):
        frame = render(BOARD, camera, pose, Settings(), 1000 * seed + number)
        seen = detect(frame.astype(np.uint8, copy=False), BOARD)
        if not isinstance(seen, NotFound):
            views.append(View(name=f"{number}.jpg", ids=seen.ids, image_points=seen.points))
    size = camera.intrinsics.image_size
    return estimate(Observations(board=BOARD, image_size=size, views=tuple(views), camera=camera.camera))


def _unit(size: tuple[int, int], seed: int) -> Calibration:
    """Another camera by every seed."""
    random, (width, height) = np.random.default_rng((seed, 11)), size
    fx = random.uniform(0.65, 0.95) * width
    camera = CAMERA.scaled(size)
    K = replace(
        camera.intrinsics,
        fx=fx,
        fy=fx * random.normal(1.0, 5e-4),
        cx=width * random.normal(0.5, 0.005),
        cy=height * random.normal(0.5, 0.005),
    )
    lens = BrownConrady(
        k1=random.uniform(-0.2, 0.05),
        k2=random.uniform(-0.02, 0.06),
        p1=random.normal(0, 3e-4),
        p2=random.normal(0, 3e-4),
        k3=random.uniform(-0.02, 0.01),
    )
    return replace(camera, intrinsics=K, distortion=lens)


def _pinhole(calibration: Calibration) -> FloatArray:
    return np.array([getattr(calibration.intrinsics, name) for name in NAMES])


def _measured(result: CalibrationResult) -> tuple[FloatArray, FloatArray]:
    """fx, fy, cx, cy and their σ × κ."""
    quality = result.calibration.quality
    assert quality is not None
    return _pinhole(result.calibration), np.array([quality.std[name] for name in NAMES]) * np.sqrt(
        quality.inflation
    )


def _scores(z: FloatArray) -> str:
    return "".join(f"{one:>+6.1f}" for one in z)


def _cpu_s() -> float:
    """Of this process and of those that it has started and that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


if __name__ == "__main__":
    main()
