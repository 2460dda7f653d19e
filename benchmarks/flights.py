"""Whether the standard deviations of cameras from flights hold, and whether flights that determine none are reported.

    python -m benchmarks.flights [--sets N] [--only WORD] [--points | --faults | --unseen]

Flights of a known camera as tracks, with normal noise, outliers and positions that drift, nothing rendered. Of each
the true error of fx, fy, cx and cy is divided by the σ × κ that it states: z. Wanted: at least 95 % of the flights
below 3 σ, a root mean square of z near 1, and no flight over flat ground at one height, straight down, that passes.
"noise" is the root mean square of fx's z by the residuals alone, without halves, principal point and next term.
--points flies with ground control: six points, each marked in six images, in another height system unless said.
--faults flies with all at once that residuals do not show, by chance in each flight: positions up to 40 ms late,
antenna up to 15 cm ahead and aside, heights up to 0.4 % off, a shutter that reads for up to 40 ms, a ripple of the lens
of up to 0.3 px. The truth is then the model's camera nearest to the rippled one.
--unseen flies with points in a part of the frame only and prints, of the flights that are kept fixed and of the others,
the largest difference in px to the true camera over the whole frame.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from dataclasses import replace as replace_plan
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

# The matrices are small: threads of BLAS cost more than they save, several times over on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
if not TYPE_CHECKING:
    # A program's own folder is where Python looks first.
    sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from scipy.optimize import least_squares

from calibrary.arrays import FloatArray
from calibrary.calib.lens_change import as_model
from calibrary.calib.lens_models import Solvable
from calibrary.calib.network import State
from calibrary.calibration import Calibration
from calibrary.distortion import KannalaBrandt
from calibrary.errors import CalibrationError
from calibrary.jobs.use import allowed
from calibrary.policy import FLEET
from calibrary.records import replace
from calibrary.rotations import rotation_matrix
from calibrary.sfm.adjust import Adjustment, adjust
from calibrary.sfm.assessment import flight_result
from calibrary.sfm.control import with_survey
from calibrary.sfm.sigma import covariance
from calibrary.validation import Use
from tests.sfm.flights import CAMERA, FISHEYE, PLANS, Plan, fly, rippled
from tests.sfm.surveyed import DATUM, FRAME, survey
from tests.sfm.test_unseen import LENSES, OBLIQUE, PARTS, apart, seen

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


SHARE = 0.75
"""Of the flights, have each fault."""
FAULTY: dict[str, Plan] = {
    name: replace_plan(PLANS[name], gps_m=gps) if gps is not None else PLANS[name]
    for name, gps in (
        ("flat, cross strips", RTK),
        ("two heights, flat, RTK", None),
        ("two heights, relief", None),
        ("oblique, flat", RTK),
        ("oblique, relief, no GPS", None),
        ("oblique, two heights, 3000 points", RTK),
    )
} | {"oblique, flat, fisheye": replace_plan(PLANS["oblique, flat"], gps_m=RTK)}


def camera_of(name: str) -> Calibration:
    """The camera that flies it."""
    return FISHEYE if "fisheye" in name else CAMERA


def faulty(plan: Plan, seed: int) -> Plan:
    """The flight with faults by chance."""
    random = np.random.default_rng((seed, 9))
    most = np.array((0.04, 0.15, 0.15, 0.004, 0.04, 0.3))
    least = most * (-1, -1, -1, -1, 0, 0)
    late, ahead, aside, scale, readout, ripple = random.uniform(least, most) * (random.random(6) < SHARE)
    return replace_plan(
        plan, late_s=late, lever_m=(ahead, aside), height_scale=scale, readout_s=readout, ripple_px=ripple
    )


def nearest(camera: Calibration, ripple_px: float, model: Solvable) -> FloatArray:
    """fx, fy, cx, cy of the camera of the model that is nearest over the frame to the rippled one, free to turn."""
    width, height = camera.intrinsics.image_size
    grid = np.stack(
        np.meshgrid(np.linspace(20, width - 20, 40), np.linspace(20, height - 20, 30)), -1
    ).reshape(-1, 2)
    rays, seen = camera.unproject(grid), rippled(camera, grid, ripple_px)
    kind = Solvable.FISHEYE if isinstance(camera.distortion, KannalaBrandt) else Solvable.BROWN
    truth = State(
        model=kind,
        parameters=kind.values(camera.intrinsics, camera.distortion),
        warp=np.zeros(2),
        rotations=np.eye(3)[None],
        translations=np.zeros((1, 3)),
    )
    start = as_model(truth, model).parameters
    scale, size = np.maximum(np.abs(start), 0.01), len(start)

    def off(x: FloatArray) -> FloatArray:
        lens, turned = np.asarray(start + x[:size] * scale), rays @ rotation_matrix(x[size:] * 1e-3).T
        # Numerator and denominator of a rational lens may grow together, which changes next to nothing.
        free = 1e-3 * lens[9:] if model is Solvable.RATIONAL else ()
        return np.asarray(np.r_[(model.project(lens, turned)[0] - seen).ravel(), free])

    found = least_squares(off, np.zeros(size + 3), x_scale="jac", max_nfev=100)
    return np.asarray((start + found.x[:size] * scale)[:4])


def flown(name: str, seed: int, *, points: bool, faults: bool) -> Adjustment:
    """One flight."""
    if faults:
        return adjust(*fly(faulty(FAULTY[name], seed), seed, camera_of(name)))
    if not points:
        return adjust(*fly(PLANS[name], seed))
    plan, offset, wrong, datum = CONTROLLED[name]
    tracks, scene = fly(plan, seed)
    if offset >= 0:
        given = replace(survey(plan, seed, datum=datum, wrong=wrong), offset_std_m=offset)
        tracks, scene = with_survey(tracks, scene, given, FRAME)
    return adjust(tracks, scene)


def unseen(sets: int, first: int) -> None:
    """Print what flights are good for that show a part of the frame only, and how far off they are over all of it."""
    print(f"{'lens':<10}{'points in':<12}{'n':>4}{'fixed':>7}{'off by':>8}{'start':>7}{'off by':>8}")
    for lens, part in product(LENSES, PARTS):
        off: dict[bool, list[float]] = {True: [], False: []}
        for seed in range(first, first + sets):
            tracks, start = fly(OBLIQUE, seed, LENSES[lens])
            flight = flight_result(adjust(tracks.only(seen(tracks, part)), start))
            use = allowed(flight.calibration, FLEET).use
            off[use is Use.FIXED].append(apart(lens, flight))
        fixed, others = (
            f"{len(off[is_fixed]):>7}{max(off[is_fixed], default=0):>8.2f}" for is_fixed in (True, False)
        )
        print(f"{lens:<10}{part:<12}{sets:>4}{fixed}{others}", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sets", type=int, default=60)
    parser.add_argument("--only", default="")
    for flag in ("--points", "--faults", "--unseen"):
        parser.add_argument(flag, action="store_true")
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    if given.unseen:
        unseen(given.sets, given.first)
        return
    truth = np.array([getattr(CAMERA.intrinsics, name) for name in NAMES])
    heads = "".join(f"{name:>6}" for name in (*NAMES, *NAMES))
    print(f"{'':<34}{'':>4}{'|z| < 3':>24}{'rms z':>24}")
    print(
        f"{'flights':<34}{'n':>4}{heads}{'noise':>7}{'σ(fx)/fx':>10}{'κ²':>6}{'fx by px':>10}"
        f"  fixed (> 3 σ) start (> 3 σ) none  {'CPU s':>6}"
    )
    every = dict.fromkeys(Use, 0), {use: np.zeros(5, dtype=int) for use in Use}
    for name in CONTROLLED if given.points else FAULTY if given.faults else PLANS:
        if given.only not in name:
            continue
        scores, noises, spreads, kappas, weak = [], [], [], [], []
        uses, beyond = dict.fromkeys(Use, 0), {use: np.zeros(5, dtype=int) for use in Use}
        begun = time.process_time()
        for seed in range(given.first, given.first + given.sets):
            try:
                adjusted = flown(name, seed, points=given.points, faults=given.faults)
                result = flight_result(adjusted)
            except CalibrationError:
                uses[Use.NONE] += 1
                continue
            quality, K = result.calibration.quality, result.calibration.intrinsics
            assert quality is not None
            assert result.flown is not None
            std = np.array([quality.std[one] for one in NAMES]) * np.sqrt(quality.inflation)
            found = np.array([getattr(K, one) for one in NAMES])
            if given.faults:
                truth = nearest(
                    camera_of(name), faulty(FAULTY[name], seed).ripple_px, adjusted.bundle.scene.model
                )
            scores.append((found - truth) / std)
            noises.append((found[0] - truth[0]) / np.sqrt(covariance(adjusted.bundle)[0, 0]))
            spreads.append(std[0] / K.fx)
            kappas.append(quality.kappa2 or np.nan)
            weak.append(result.flown.geometry.focal_by_px)
            use, far = allowed(result.calibration, FLEET).use, np.abs(scores[-1]) > 3
            uses[use] += 1
            beyond[use] += np.r_[far, far.any()]
        spent = (time.process_time() - begun) / max(given.sets, 1)
        inside = (np.abs(scores) < 3).mean(axis=0) if scores else np.full(4, np.nan)
        size = np.sqrt(np.square(scores).mean(axis=0)) if scores else np.full(4, np.nan)
        print(
            f"{name:<34}{given.sets:>4}{''.join(f'{one:>6.0%}' for one in inside)}"
            f"{''.join(f'{one:>6.2f}' for one in size)}{np.sqrt(np.square(noises).mean()):>7.2f}"
            f"{np.median(spreads):>10.3%}{np.nanmedian(kappas):>6.2f}{np.median(weak):>10.0%}  "
            f"{uses[Use.FIXED]:>5}{beyond[Use.FIXED][-1]:>8}{uses[Use.START]:>6}{beyond[Use.START][-1]:>8}"
            f"{uses[Use.NONE]:>5}  {spent:>6.1f}",
            flush=True,
        )
        for use in Use:
            every[0][use] += uses[use]
            every[1][use] += beyond[use]
    for use in Use:
        far = ", ".join(f"{name} {count}" for name, count in zip((*NAMES, "any"), every[1][use], strict=True))
        print(f"{use}: {every[0][use]} of {sum(every[0].values())} flights, beyond 3 σ in {far}")


if __name__ == "__main__":
    main()
