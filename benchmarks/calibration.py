"""How right calibrations from boards are, how honest, and how fast: a table of what was measured beside what is wanted.

    python -m benchmarks.calibration [--seeds N] [--large] [--only WORD]
        [--mrcal-python /usr/bin/python3] [--lensboy-python PATH]

Cameras are known exactly. Most of it is done on corners alone, with normal noise; the runs on frames draw the board
pixel by pixel and look for it again. Peers are asked where a Python that has them is named: each solves the same
corners in a process of its own.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.table import in_turns, machine, show
from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.corners_arrays import Corners
from calibrary.calib.corners_file import write_corners
from calibrary.calib.detection import detect
from calibrary.calib.estimation import estimate
from calibrary.calib.found import NotFound
from calibrary.calib.lens_models import Solvable
from calibrary.calib.model_choice import warp_test
from calibrary.calib.network import Network
from calibrary.calib.observations import Observations, View
from calibrary.calib.projection_difference import pixel_grid, projection_difference
from calibrary.calib.rejection import Gate
from calibrary.calib.result import CalibrationResult
from calibrary.calib.solve import solve
from calibrary.calib.synthesis import Settings, Shutter, poses, render
from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance
from calibrary.distortion import BrownConrady
from calibrary.errors import CalibrationError
from calibrary.jobs.calibrate import calibrate
from calibrary.records import replace
from tests.calib.observing import observe

BOARD = Board(columns=11, rows=8, square_mm=40.0)
LENS = BrownConrady(k1=-0.2687, k2=0.1147, p1=1.5e-4, p2=-4.7e-4, k3=-0.035)
PINHOLE = ("fx", "fy", "cx", "cy")
HARD = Settings(blur_px=1.5, noise=5.0, quality=75)


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of the table; no verdict where there is no goal."""

    what: str
    measured: str
    goal: str
    good: bool | None


def camera(size: ImageSize) -> Calibration:
    """A survey camera, its focal length as a Phantom 4 RTK's in its frame's width, off-centre."""
    width, height = size
    fx = 0.7554 * width
    return Calibration(
        camera=CameraKey(image_size=size),
        intrinsics=Intrinsics(fx=fx, fy=0.998 * fx, cx=0.5033 * width, cy=0.497 * height, image_size=size),
        distortion=LENS,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="synthetic"),
    )


def shoot(
    seed: int, *, views: int = 25, sigma: float = 0.05, tilt: float = 35.0, **more: Any
) -> Observations:
    """Corners of a session at 1920 × 1440."""
    truth = camera((1920, 1440))
    fill, reach = more.pop("fill", (0.3, 0.85)), more.pop("reach", 1.0)
    held = poses(BOARD, truth, views, seed, tilt, fill, roll_deg=180.0, reach=reach)
    return observe(BOARD, truth, held, sigma, seed, **more)


def photograph(size: ImageSize, seed: int, views: int, settings: Settings, board: Board) -> Observations:
    """Frames, drawn, and the board found in them again."""
    truth, found = camera(size), []
    for number, pose in enumerate(poses(board, truth, views, seed, roll_deg=180.0)):
        frame = render(board, truth, pose, settings, 1000 * seed + number)
        seen = detect(frame.astype(np.uint8, copy=False), board)
        if isinstance(seen, NotFound):
            continue
        found.append(View(name=f"{number}.jpg", ids=seen.ids, image_points=seen.points))
    return Observations(board=board, image_size=size, views=tuple(found), camera=truth.camera)


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Of fx, fy, cx, cy over several sessions: relative of fx, and in standard deviations as each session states."""

    fx_percent: FloatArray
    z: FloatArray

    @classmethod
    def of(cls, results: list[CalibrationResult], truth: Calibration) -> Errors:
        """Compare with the truth."""
        z, fx = [], []
        for result in results:
            K, quality = result.calibration.intrinsics, result.calibration.quality
            assert quality is not None
            errors = [getattr(K, name) - getattr(truth.intrinsics, name) for name in PINHOLE]
            z.append([error / quality.std[name] for error, name in zip(errors, PINHOLE, strict=True)])
            fx.append(100 * errors[0] / truth.intrinsics.fx)
        return cls(fx_percent=np.array(fx), z=np.array(z))

    @property
    def worst_fx(self) -> float:
        """Largest |relative error| of fx, %."""
        return float(np.abs(self.fx_percent).max())

    @property
    def z_rms(self) -> float:
        """Over all four."""
        return float(np.sqrt((self.z**2).mean()))

    @property
    def within_three(self) -> float:
        """Fraction of |z| < 3."""
        return float((np.abs(self.z) < 3).mean())


def clean(seeds: int) -> Iterator[Row]:
    """Nothing wrong: errors as stated, no false alarms."""
    runs = [estimate(shoot(seed)) for seed in range(seeds)]
    errors = Errors.of(runs, camera((1920, 1440)))
    kappa = [run.evidence.kappa2 or np.inf for run in runs]
    warped = np.mean([run.evidence.is_warped for run in runs])
    passed = sum(run.verdict.value == "pass" for run in runs)
    models = {model.value: sum(run.model is model for run in runs) for model in Solvable}
    yield _at_most("corners, σ 0.05: worst fx", errors.worst_fx, 0.03, "%")
    yield _row(
        "  |z| < 3 (fx fy cx cy)", f"{errors.within_three:.1%}", "≥ 95 %", good=errors.within_three >= 0.95
    )
    yield _row("  z rms", f"{errors.z_rms:.2f}", "0.7 … 1.4", good=0.7 <= errors.z_rms <= 1.4)
    yield _at_most(f"  κ², worst (median {np.median(kappa):.2f})", max(kappa), 2.5, "")
    yield _row("  flat boards taken for bent", f"{warped:.1%}", "≤ 2 %", good=bool(warped <= 0.02))
    yield _row("  models chosen", ", ".join(f"{name} {n}" for name, n in models.items() if n), "", good=None)
    yield _row("  verdict pass", f"{passed}/{seeds}", "all", good=passed == seeds)


def false_positives(seeds: int) -> Iterator[Row]:
    """The F-test alone, on more sets: its level is 1 %."""
    number, bent = 8 * seeds, 0
    for seed in range(number):
        found = solve(Network.of(shoot(5000 + seed, views=15)), (1920, 1440), model=Solvable.BROWN)
        bent += found.is_warped
    share = bent / number
    yield _row(f"  F-test false positives, {number} sets", f"{share:.1%}", "≤ 2 %", good=share <= 0.02)


def bow(seeds: int) -> Iterator[Row]:
    """0.2 mm over 400 mm."""
    sets = [shoot(100 + seed, bow_mm=0.2) for seed in range(seeds)]
    runs = [estimate(each) for each in sets]
    errors = Errors.of(runs, camera((1920, 1440)))
    power = np.mean([run.evidence.is_warped for run in runs])
    flat = [estimate(each, warp=False) for each in sets]
    planar = Errors.of(flat, camera((1920, 1440)))
    kappa = [run.evidence.kappa2 or 0.0 for run in flat]
    flagged = np.mean([run.verdict.value == "refuse" for run in flat])
    yield _at_most("bow 0.2 mm: worst fx, warp solved for", errors.worst_fx, 0.03, "%")
    yield _row("  z rms", f"{errors.z_rms:.2f}", "0.7 … 1.4", good=0.7 <= errors.z_rms <= 1.4)
    yield _row("  F-test power", f"{power:.0%}", "≥ 95 %", good=bool(power >= 0.95))
    yield _row("  worst fx, taken for flat", f"{planar.worst_fx:.4f} %", "", good=None)
    yield _row("  κ² taken for flat, least", f"{min(kappa):.1f}", "> 4", good=min(kappa) > 4)
    yield _row("  refused when taken for flat", f"{flagged:.0%}", "all", good=bool(flagged == 1))


def low_tilt(seeds: int) -> Iterator[Row]:
    """Up to 10°: the start alone may end in a wrong minimum."""
    number = 4 * seeds
    wrong = 0
    for seed in range(number):
        found = solve(Network.of(shoot(200 + seed, tilt=10.0)), (1920, 1440), model=Solvable.BROWN)
        wrong += found.adjusted.rms_px > 0.08
    yield _row(f"tilt ≤ 10°: wrong minima in {number} sets", f"{wrong}", "0", good=wrong == 0)


def _bad_corners(seed: int) -> Observations:
    rng, seen = np.random.default_rng(seed), shoot(300 + seed)
    by = np.zeros((2, 88, 2))
    for view in by:
        view[rng.choice(88, 2, replace=False)] = rng.normal(0, 6, (2, 2)) + 3
    return _moved(seen, {3: by[0], 11: by[1]})


def _dragged(seed: int) -> Observations:
    x, y = np.mgrid[:8, :11][1].ravel() / 10, np.mgrid[:8, :11][0].ravel() / 7
    return _moved(shoot(400 + seed), {7: 3.0 * np.column_stack([y**2, x * y])})


def _moved(seen: Observations, by: dict[int, FloatArray]) -> Observations:
    views = [
        replace(view, image_points=view.image_points + by[index][view.ids]) if index in by else view
        for index, view in enumerate(seen.views)
    ]
    return replace(seen, views=tuple(views))


def _burst(seed: int) -> Observations:
    seen, rng = shoot(500 + seed, views=8), np.random.default_rng(seed)
    views = [
        replace(
            v, name=f"{v.name}-{n}", image_points=v.image_points + rng.normal(0, 0.05, v.image_points.shape)
        )
        for v in seen.views
        for n in range(4)
    ]
    return replace(seen, views=tuple(views))


def _rolling(seed: int) -> Observations:
    truth, rng, views = camera((1920, 1440)), np.random.default_rng(seed), []
    for index, pose in enumerate(poses(BOARD, truth, 25, 600 + seed, roll_deg=180.0)):
        a, b, c = rng.normal(0, 1.0, 3)
        shutter = Shutter(readout_s=0.03, rate_deg_s=(a, b, c))
        seen = observe(BOARD, truth, [pose], 0.05, 1000 * seed + index, shutter=shutter)
        views.append(replace(seen.views[0], name=f"{index}"))
    return replace(seen, views=tuple(views))


FAULTS: dict[str, Callable[[int], Observations]] = {
    "duplicates": _burst,
    "views-rejected": _dragged,
    "corners-rejected": _bad_corners,
    "rolling-shutter": _rolling,
    "centre-only": lambda seed: shoot(700 + seed, reach=0.4, fill=(0.1, 0.35)),
    "low-tilt": lambda seed: shoot(800 + seed, tilt=4.0),
    "stretched-print": lambda seed: shoot(900 + seed, stretch=(1.0, 1.001)),
    "board-warp": lambda seed: shoot(1000 + seed, bow_mm=0.2),
}


def named(seeds: int) -> Iterator[Row]:
    """Each fault by its name, and no other fault by that name."""
    named_in: dict[str, list[tuple[str, ...]]] = {
        fault: [estimate(make(seed)).rules for seed in range(seeds)] for fault, make in FAULTS.items()
    }
    for fault, codes in named_in.items():
        caught = sum(fault in each for each in codes)
        # A fault may bring another with it: motion sets views aside, a burst is few views.
        rivals = ("rolling-shutter", "stretched-print", "duplicates", "centre-only", "low-tilt")
        others = sorted({code for each in codes for code in each if code in rivals and code != fault})
        yield _row(
            f"{fault}: caught by name", f"{caught}/{seeds}" + (f", also {', '.join(others)}" if others else ""), "all",
            good=caught == seeds,
        )  # fmt: skip


def frames(seeds: int, *, large: bool) -> Iterator[Row]:
    """Drawn frames, found corners."""
    small = Board(columns=9, rows=6, square_mm=40.0)
    runs: list[tuple[str, ImageSize, int, Settings, float, int, Board]] = [
        ("1280×960 × 15", (1280, 960), 15, Settings(), 0.06, seeds, small),
        ("1920×1440 × 25, clean", (1920, 1440), 25, Settings(), 0.03, seeds // 2, BOARD),
        ("1920×1440 × 25, blur 1.5, noise 5, q75", (1920, 1440), 25, HARD, 0.05, seeds // 2, BOARD),
    ]
    if large:
        runs.append(("5472×3648 × 25", (5472, 3648), 25, Settings(), 0.02, 2, BOARD))
    for name, size, views, settings, goal, number, board in runs:
        sets = [photograph(size, 40 + seed, views, settings, board) for seed in range(max(1, number))]
        results = [estimate(each) for each in sets]
        errors = Errors.of(results, camera(size))
        found = sum(len(each.views) for each in sets)
        yield _at_most(f"frames {name}: worst fx of {len(sets)}", errors.worst_fx, goal, "%")
        yield _row(
            "  |z| < 3, z rms, found",
            f"{errors.within_three:.1%}, {errors.z_rms:.2f}, {found}/{views * len(sets)}",
            "≥ 95 %, 0.7 … 1.4",
            good=errors.within_three >= 0.95 and 0.7 <= errors.z_rms <= 1.4,
        )


def speed(mrcal_python: str) -> Iterator[Row]:
    """CPU seconds on one thread, at the public door, beside OpenCV and, where there is one, mrcal."""
    has_mrcal = not subprocess.run(
        [mrcal_python, "-c", "import mrcal"], capture_output=True, check=False
    ).returncode
    cv2.setNumThreads(1)
    for views, limit, repeats in ((25, 0.1, 9), (100, 0.4, 5), (400, 2.2, 1)):
        seen = shoot(1, views=views)
        points = [seen.object_points(view).astype(np.float32) for view in seen.views]
        pixels = [view.image_points.astype(np.float32) for view in seen.views]
        corners = Corners(object_points=points, image_points=pixels, image_size=seen.image_size)
        # With standard deviations OpenCV needs 20 s for 400 views.
        extended = views <= 100
        call = cv2.calibrateCameraExtended if extended else cv2.calibrateCamera
        costs = in_turns(
            {
                "ours": partial(calibrate, corners=corners),
                "cv2": partial(call, points, pixels, seen.image_size, np.eye(3), np.zeros(5)),
            },
            repeats,
        )
        ours, theirs = ([cost.cpu_s for cost in costs[name]] for name in ("ours", "cv2"))
        what = f"{views} views × 88 corners"
        yield _at_most(f"{what}: model, σ and verdict", min(ours), limit, "s CPU")
        yield _row(
            f"  cv2, lens {'and σ' if extended else 'without σ'}", f"{min(theirs):.4f} s CPU", "", good=None
        )
        if has_mrcal:
            solved = _by_peer("mrcal", mrcal_python, seen)
            yield _row("  mrcal, lens without σ", f"{solved['flat']['seconds']:.4f} s CPU", "", good=None)


def _by_peer(name: str, python: str, seen: Observations) -> dict[str, Any]:
    """What a peer makes of the same corners.

    Raises:
        CalibrationError: it failed, with its last words.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "corners.json"
        write_corners(seen, path)
        script = Path(__file__).with_name(f"peer_{name}.py")
        run = subprocess.run([python, str(script), str(path)], capture_output=True, text=True, check=False)
    if run.returncode:
        raise CalibrationError(run.stderr.strip().splitlines()[-1][:60])
    found: dict[str, Any] = json.loads(run.stdout.strip().splitlines()[-1])
    return found


def peers(mrcal_python: str | None, lensboy_python: str | None) -> Iterator[Row]:
    """The same corners solved elsewhere."""
    for name, python in (("mrcal", mrcal_python), ("lensboy", lensboy_python)):
        if python is None:
            yield _row(f"{name}: same corners", "skipped: no --" + f"{name}-python", "", good=None)
            continue
        for label, seen in (("flat board", shoot(1)), ("bow 0.3 mm", shoot(2, bow_mm=0.3))):
            try:
                found = _by_peer(name, python, seen)
            except CalibrationError as error:
                yield _row(f"{name}: {label}", f"failed: {error}", "", good=False)
                continue
            yield from _compared(name, label, seen, found)


def _compared(name: str, label: str, seen: Observations, theirs: dict[str, Any]) -> Iterator[Row]:
    keep = Gate(corner_sigmas=1e9, view_mads=1e9)
    flat = solve(Network.of(seen), seen.image_size, model=Solvable.BROWN, warp=False, gate=keep).adjusted
    for key, ours in (("flat", flat), ("bent", warp_test(flat)[2])):
        gap = abs(float(ours.state.parameters[0]) - theirs[key]["parameters"][0])
        yield _at_most(
            f"{name}, {label}, {'with' if key == 'bent' else 'no'} warp: |Δfx|", gap, 0.02, "px", digits=5
        )
    if "difference_px" in theirs:
        cameras = [_calibration(theirs[key]["parameters"], seen.image_size) for key in ("flat", "bent")]
        disc = np.linalg.norm(pixel_grid(seen.image_size) - np.array(seen.image_size) / 2, axis=-1)
        weights = (disc < min(seen.image_size) / 4).astype(np.float64)
        ours_px = projection_difference(cameras[0], cameras[1], weights=weights).rms_px
        theirs_px = float(np.sqrt(np.mean(np.square(theirs["difference_px"]))))
        yield _at_most(
            f"{name}, {label}: projection difference {theirs_px:.3f} px rms, |Δ|",
            abs(ours_px - theirs_px),
            0.02,
            "px",
        )


def _calibration(parameters: list[float], size: ImageSize) -> Calibration:
    """From OpenCV's numbers and its pixel origin."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = parameters
    K = Intrinsics(fx=fx, fy=fy, cx=cx + 0.5, cy=cy + 0.5, image_size=size)
    return replace(camera(size), intrinsics=K, distortion=BrownConrady(k1=k1, k2=k2, p1=p1, p2=p2, k3=k3))


def _cpu(work: Callable[[], object]) -> float:
    began = time.process_time()
    work()
    return time.process_time() - began


def _row(what: str, measured: str, goal: str, *, good: bool | None) -> Row:
    return Row(what=what, measured=measured, goal=goal, good=good)


def _at_most(what: str, value: float, limit: float, unit: str, *, digits: int = 4) -> Row:
    return _row(
        what, f"{value:.{digits}f} {unit}".strip(), f"≤ {limit:g} {unit}".strip(), good=value <= limit
    )


def main() -> int:
    """Measure and print; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description="What calibrations from boards are worth.")
    parser.add_argument("--seeds", type=int, default=12, metavar="N", help="sessions of each kind")
    parser.add_argument(
        "--large", action="store_true", help="also draw frames of 20 megapixels: some minutes"
    )
    parser.add_argument("--only", metavar="WORD", help="only the part of this name")
    parser.add_argument("--mrcal-python", metavar="PATH", help="a Python that has mrcal")
    parser.add_argument("--lensboy-python", metavar="PATH", help="a Python that has lensboy")
    args = parser.parse_args()
    parts: dict[str, Callable[[], Iterator[Row]]] = {
        "clean": lambda: clean(args.seeds),
        "false-positives": lambda: false_positives(args.seeds),
        "bow": lambda: bow(args.seeds),
        "low-tilt": lambda: low_tilt(args.seeds),
        "named": lambda: named(args.seeds),
        "speed": lambda: speed(args.mrcal_python or "/usr/bin/python3"),
        "peers": lambda: peers(args.mrcal_python, args.lensboy_python),
        "frames": lambda: frames(args.seeds, large=args.large),
    }
    if args.only is not None and args.only not in parts:
        parser.error(f"--only {args.only}: wanted one of {', '.join(parts)}")
    missed = 0
    print(machine())
    for name, part in parts.items():
        if args.only in {None, name}:
            for row in part():
                show(row.what, row.measured, limit=row.goal, met=row.good)
                missed += row.good is False
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
