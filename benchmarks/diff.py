"""How often `calibrary diff` raises a false alarm and how often it misses a change: a table beside what is wanted.

    python -m benchmarks.diff [--pairs N] [--corner-pairs N] [--draws N] [--large] [--cache DIR] [--only WORD]
        [--mrcal-python /usr/bin/python3]

A pair is two sessions with one camera: 25 frames of a board each, drawn pixel by pixel, written as JPEGs, collected,
calibrated and compared as the command line does it. Between the sessions nothing changes but the noise and the
poses, or one thing. Beside it, more pairs on corners alone, with the noise that the detector has on such frames:
with 25 views and with 10, with a warped board, with another lens model in the later session, and with a later
calibration that states no uncertainty. And many more pairs drawn from the covariances of such solves.

A change of 0.1 % in f is twice the limit; a distortion that is stronger by 0.9 % differs by 0.8 px rms, which is less
than twice.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import multiprocessing.pool
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from scipy.interpolate import RegularGridInterpolator

from benchmarks.table import show
from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.corners_file import read_corners, write_corners
from calibrary.calib.detection import detect_all
from calibrary.calib.estimation import estimate
from calibrary.calib.observations import Observations
from calibrary.calib.projection_difference import pixel_grid, projection_difference
from calibrary.calib.synthesis import Settings, Sheet, Truth, poses
from calibrary.calib.synthesis.cameras import head
from calibrary.calib.synthesis.files import write_frames
from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance
from calibrary.distortion import BrownConrady, Rational
from calibrary.jobs.diff.comparison import DiffReport, compare
from calibrary.jobs.diff.verdicts import Kind
from calibrary.records import replace
from tests.calib.observing import observe

BOARD = Board(columns=11, rows=8, square_mm=40.0)
LENS = BrownConrady(k1=-0.2687, k2=0.1147, p1=1.5e-4, p2=-4.7e-4, k3=-0.035)
VIEWS = 25
DETECTOR_PX = 0.03
"""Noise of one coordinate on corners alone: somewhat more than the detector has on these frames."""
BOW_MM = 0.2
DRAWN_FROM = 8
"""Solves whose covariances the pairs are drawn from."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of the table; no verdict where there is no goal."""

    what: str
    measured: str
    goal: str = ""
    good: bool | None = None


@dataclass(frozen=True, kw_only=True)
class Change:
    """What is different in the later session.

    Attributes:
        focal: relative, of fx and fy.
        centre_px: of cx.
        lens: factor on every coefficient of the distortion; 0 is a frame that the camera corrected.
    """

    focal: float = 0.0
    centre_px: float = 0.0
    lens: float = 1.0

    def __str__(self) -> str:
        parts = [
            f"f {self.focal:+.2%}" if self.focal else "",
            f"cx {self.centre_px:+g} px" if self.centre_px else "",
            f"distortion × {self.lens:g}" if self.lens != 1 else "",
        ]
        return ", ".join(part for part in parts if part) or "nothing"


@dataclass(frozen=True, kw_only=True)
class Session:
    """Frames of one camera; what they yield is written to a file of this name in the cache.

    Attributes:
        size: of the frames.
        seed: of poses and noise.
        change: of the camera.
        bow_mm: of the board.
        drawn: whether frames are drawn, else corners.
        views: how many.
    """

    size: ImageSize
    seed: int
    change: Change
    bow_mm: float = 0.0
    drawn: bool = True
    views: int = VIEWS

    @property
    def name(self) -> str:
        """Of its file."""
        what = "frames" if self.drawn else "corners"
        change = f"{self.change.focal:g}_{self.change.centre_px:g}_{self.change.lens:g}"
        return f"{what}_{self.size[0]}_{self.seed}_{change}_{self.bow_mm:g}_{self.views}.json"


NOTHING = Change()
TWICE_F, TWICE_PX = Change(focal=0.001), Change(lens=1.009)


def camera(size: ImageSize, change: Change = NOTHING) -> Calibration:
    """A survey camera, its focal length as a Phantom 4 RTK's in its frame's width, off-centre."""
    width, height = size
    fx = 0.7554 * width * (1 + change.focal)
    values = {name: value * change.lens for name, value in LENS.coefficients.items()}
    return Calibration(
        camera=CameraKey(make="Example", model="Diff", focal_mm=4.8, image_size=size),
        intrinsics=Intrinsics(
            fx=fx,
            fy=0.998 * fx,
            cx=0.5033 * width + change.centre_px,
            cy=0.497 * height,
            image_size=size,
        ),
        distortion=BrownConrady(**values),
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="synthetic"),
    )


def shoot(session: Session, cache: Path) -> Path:
    """The session's corners, drawn, written, read and found; as a file that stays."""
    path = cache / session.name
    if path.exists():
        return path
    cv2.setNumThreads(1)
    truth = camera(session.size, session.change)
    held = poses(BOARD, truth, session.views, session.seed, roll_deg=180.0)
    if session.drawn:
        settings = Settings(sheet=Sheet.bowed(BOARD, session.bow_mm))
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "frames"
            made = Truth(board=BOARD, calibration=truth, poses=held, settings=settings)
            write_frames(out, made, session.seed, partial(head, truth, None))
            seen = detect_all(sorted(out.glob("*.jpg")), BOARD, workers=1).observations
    else:
        seen = observe(BOARD, truth, held, DETECTOR_PX, session.seed, bow_mm=session.bow_mm)
    unfinished = path.with_suffix(f".{session.seed}.part")
    write_corners(seen, unfinished)
    unfinished.rename(path)
    return path


def solved(path: Path, *, warp: bool, model: str) -> Calibration:
    """The calibration from a session's corners."""
    cv2.setNumThreads(1)
    seen: Observations = read_corners(path)
    return estimate(seen, model, warp=warp).calibration


@dataclass(frozen=True, kw_only=True)
class Tally:
    """What the comparisons of several pairs came to."""

    pairs: tuple[DiffReport, ...]

    @property
    def alarms(self) -> float:
        """Share of the pairs."""
        return float(np.mean([pair.alarm for pair in self.pairs]))

    def named(self, kind: Kind) -> float:
        """Share of the pairs that are told to be of a kind."""
        return float(np.mean([any(one.kind is kind for one in pair.structural) for pair in self.pairs]))

    def __str__(self) -> str:
        numbers = [pair.numbers for pair in self.pairs if pair.numbers is not None]
        verdicts = Counter(pair.verdict.value for pair in self.pairs)
        rms = float(np.median([number.projection.rms_px for number in numbers]))
        said = ", ".join(f"{verdict} {count}" for verdict, count in verdicts.most_common())
        return f"{self.alarms:6.1%} of {len(self.pairs)}; {rms:.2f} px rms; {said}"


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Where sessions are kept, and who makes them.

    Attributes:
        cache: folder of corners.
        size: of the frames.
        pool: processes.
    """

    cache: Path
    size: ImageSize
    pool: multiprocessing.pool.Pool

    def calibrations(
        self,
        seeds: Sequence[int],
        change: Change,
        *,
        bow_mm: float = 0.0,
        drawn: bool = True,
        warp: bool = True,
        views: int = VIEWS,
        model: str = "auto",
    ) -> list[Calibration]:
        """One from each session."""
        sessions = [
            Session(size=self.size, seed=seed, change=change, bow_mm=bow_mm, drawn=drawn, views=views)
            for seed in seeds
        ]
        paths = self.pool.map(partial(shoot, cache=self.cache), sessions, chunksize=1)
        return self.pool.map(partial(solved, warp=warp, model=model), paths, chunksize=1)

    def tally(self, earlier: Sequence[Calibration], later: Sequence[Calibration]) -> Tally:
        """Compare pair by pair."""
        return Tally(pairs=tuple(self.pool.starmap(compare, zip(earlier, later, strict=True), chunksize=4)))


FALSE = "alarms ≤ 2 %"
POWER = "alarms ≥ 95 %"


def changes(bench: Bench, pairs: int, *, drawn: bool) -> Iterator[Row]:
    """One thing changes, or nothing does."""
    how = f"frames {bench.size[0]}×{bench.size[1]}" if drawn else f"corners, σ {DETECTOR_PX:g} px"
    yield Row(what=f"{how}, {VIEWS} views, what changed:", measured="alarms; median difference; verdicts")
    earlier = bench.calibrations(range(pairs), NOTHING, drawn=drawn)
    goals: list[tuple[Change, str]] = [
        (NOTHING, FALSE),
        (Change(focal=0.0002), FALSE),
        (Change(focal=0.0005), ""),
        (TWICE_F, POWER),
        (Change(centre_px=0.5), FALSE),
        (TWICE_PX, POWER),
    ]
    for change, goal in goals:
        found = bench.tally(earlier, bench.calibrations(range(1000, 1000 + pairs), change, drawn=drawn))
        yield _row(f"  {change}", found, goal)
    dewarped = bench.calibrations(range(1000, 1000 + pairs), Change(lens=0.0), drawn=drawn)
    found = bench.tally(earlier, dewarped)
    yield _row("  distortion removed in the camera", found, POWER)
    share = found.named(Kind.DEWARP_ON)
    yield Row(what="    and named so", measured=f"{share:6.1%}", goal="≥ 95 %", good=share >= 0.95)
    back = bench.tally(dewarped, earlier).named(Kind.DEWARP_OFF)
    yield Row(
        what="    and named the other way round", measured=f"{back:6.1%}", goal="≥ 95 %", good=back >= 0.95
    )


def bowed(bench: Bench, pairs: int, *, drawn: bool) -> Iterator[Row]:
    """A board that is not flat: solved for, and taken for flat."""
    yield Row(what=f"{'frames' if drawn else 'corners'}, board bowed by {BOW_MM:g} mm:", measured="")
    for warp in (True, False):
        earlier, later = (
            bench.calibrations(range(seed, seed + pairs), NOTHING, bow_mm=BOW_MM, drawn=drawn, warp=warp)
            for seed in (0, 1000)
        )
        how = "solved for" if warp else "taken for flat"
        yield _row(f"  {how}, nothing", bench.tally(earlier, later), FALSE)
        if not warp:
            plain = bench.tally([_trusting(a) for a in earlier], [_trusting(b) for b in later])
            yield _row("    the same without κ²", plain, "")
        for change in (TWICE_F, Change(focal=0.005)):
            seeds = range(1000, 1000 + pairs)
            moved = bench.calibrations(seeds, change, bow_mm=BOW_MM, drawn=drawn, warp=warp)
            goal = POWER if warp or change.focal >= 0.005 else ""
            yield _row(f"  {how}, {change}", bench.tally(earlier, moved), goal)


def _trusting(calibration: Calibration) -> Calibration:
    """As if the covariance were all there is."""
    assert calibration.quality is not None
    return replace(calibration, quality=replace(calibration.quality, kappa2=None))


def harder(bench: Bench, pairs: int) -> Iterator[Row]:
    """Ten views, another model in the later session, a later calibration that states no uncertainty."""
    for views, rational, one_sided in (
        (10, False, False),
        (VIEWS, True, False),
        (VIEWS, False, True),
        (10, False, True),
        (10, True, True),
    ):
        told = f"{views} views" + rational * ", later rational" + one_sided * ", σ on one side"
        earlier = bench.calibrations(range(pairs), NOTHING, drawn=False, views=views)
        for change, goal in ((NOTHING, FALSE), (TWICE_F, POWER), (TWICE_PX, POWER)):
            seeds = range(1000, 1000 + pairs)
            later = bench.calibrations(seeds, change, drawn=False, views=views)
            if rational:
                later = [_rational(one) for one in later]
            if one_sided:
                later = [_silent(one) for one in later]
            yield _row(f"  {told}, {change}", bench.tally([_dated(one) for one in earlier], later), goal)


def _rational(calibration: Calibration) -> Calibration:
    """Another model, whose further coefficients are fixed at 0: compared through the projections alone."""
    lens = calibration.distortion
    assert lens is not None
    return replace(calibration, distortion=Rational(**lens.coefficients, k4=0, k5=0, k6=0))


def _dated(calibration: Calibration) -> Calibration:
    return replace(calibration, provenance=replace(calibration.provenance, date="2026-01-01"))


def _silent(calibration: Calibration) -> Calibration:
    """As a program hands it over that knows no standard deviations; of a later day."""
    provenance = replace(calibration.provenance, date="2026-07-01")
    return replace(calibration, quality=None, provenance=provenance)


def draws(bench: Bench, pairs: int) -> Iterator[Row]:
    """Pairs drawn from the covariances of real solves around the truth."""
    for views in (VIEWS, 10):
        solves = bench.calibrations(range(DRAWN_FROM), NOTHING, drawn=False, views=views, model="brown")
        earlier = [_drawn(solves[at % DRAWN_FROM], NOTHING, bench.size, at) for at in range(pairs)]
        for change, goal in ((NOTHING, FALSE), (TWICE_F, POWER), (TWICE_PX, POWER)):
            later = [
                _drawn(solves[(at + 1) % DRAWN_FROM], change, bench.size, pairs + at) for at in range(pairs)
            ]
            yield _row(f"  drawn, {views} views, {change}", bench.tally(earlier, later), goal)
            one_sided = bench.tally([_dated(one) for one in earlier], [_silent(one) for one in later])
            yield _row("    the same, σ on one side", one_sided, goal)


def _drawn(solve: Calibration, change: Change, size: ImageSize, seed: int) -> Calibration:
    """The true camera with an error drawn from a solve's covariance, which it states."""
    assert solve.quality is not None
    assert solve.quality.covariance is not None
    names, C = solve.quality.covariance.names, solve.quality.covariance.matrix * solve.quality.inflation
    error = dict(
        zip(names, np.random.default_rng(seed).multivariate_normal(np.zeros(len(C)), C), strict=True)
    )
    true = camera(size, change)
    K, lens = true.intrinsics, true.distortion
    assert lens is not None
    return replace(
        true,
        intrinsics=replace(
            K, **{name: getattr(K, name) + error.get(name, 0.0) for name in ("fx", "fy", "cx", "cy")}
        ),
        distortion=replace(
            lens, **{name: value + error.get(name, 0.0) for name, value in lens.coefficients.items()}
        ),
        quality=solve.quality,
    )


def parity(bench: Bench, python: str | None) -> Iterator[Row]:
    """`mrcal.projection_diff` on the same pairs, both turned by the rotation of a disc about the middle."""
    if python is None:
        yield Row(what="mrcal.projection_diff, same pair", measured="skipped: no --mrcal-python")
        return
    (earlier,) = bench.calibrations([0], NOTHING)
    cases = [NOTHING, Change(focal=0.001), Change(focal=0.005), Change(centre_px=0.5), Change(lens=1.01)]
    pairs = [(change, bench.calibrations([1000], change)[0]) for change in cases]
    document = {
        "image_size": bench.size,
        "pairs": [[_opencv(earlier), _opencv(later)] for _, later in pairs],
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pairs.json"
        path.write_text(json.dumps(document), encoding="utf-8")
        script = str(Path(__file__).parent / "peer_mrcal.py")
        run = subprocess.run([python, script, str(path)], capture_output=True, text=True, check=False)
    if run.returncode:
        reason = (run.stderr.strip().splitlines() or ["no word"])[-1]
        yield Row(what="mrcal.projection_diff", measured=f"failed: {reason[:60]}", good=False)
        return
    for (change, later), theirs in zip(pairs, json.loads(run.stdout.splitlines()[-1]), strict=True):
        ours, mrcals = _lengths_at_pixel_centres(earlier, later), np.array(theirs)
        gap = float(np.sqrt(np.mean((ours - mrcals) ** 2)))
        rms = float(np.sqrt(np.mean(mrcals**2)))
        yield Row(
            what=f"mrcal.projection_diff, {change}: {rms:.3f} px rms",
            measured=f"{gap:.5f} px rms apart",
            goal="≤ 0.02 px",
            good=gap <= 0.02,
        )


def _lengths_at_pixel_centres(a: Calibration, b: Calibration) -> FloatArray:
    """On mrcal's grid, which runs from the centre of the first pixel to that of the last; ours runs edge to edge."""
    size, shape = a.intrinsics.image_size, (129, 97)
    disc = np.linalg.norm(pixel_grid(size, shape) - np.array(size) / 2, axis=-1) < min(size) / 4
    found = projection_difference(a, b, shape=shape, weights=disc.astype(np.float64))
    rows, columns = (np.linspace(0, side, count) for side, count in zip(size[::-1], shape[::-1], strict=True))
    between = RegularGridInterpolator((rows, columns), found.vectors)
    y, x = np.meshgrid(
        np.linspace(0.5, size[1] - 0.5, 25), np.linspace(0.5, size[0] - 0.5, 33), indexing="ij"
    )
    vectors = between(np.column_stack([y.ravel(), x.ravel()]))
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def _opencv(calibration: Calibration) -> list[float]:
    """OpenCV's nine numbers, in its pixel origin."""
    K, lens = calibration.intrinsics, calibration.distortion
    assert isinstance(lens, BrownConrady)
    return [K.fx, K.fy, K.cx - 0.5, K.cy - 0.5, lens.k1, lens.k2, lens.p1, lens.p2, lens.k3]


def _row(what: str, found: Tally, goal: str) -> Row:
    good = {FALSE: found.alarms <= 0.02, POWER: found.alarms >= 0.95}.get(goal)
    return Row(what=what, measured=str(found), goal=goal, good=good)


def main() -> int:
    """Measure and print; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description="What a comparison of two calibrations is worth.")
    parser.add_argument("--pairs", type=int, default=40, metavar="N", help="of drawn sessions, each kind")
    parser.add_argument(
        "--corner-pairs", type=int, default=100, metavar="N", help="of sessions of corners alone"
    )
    parser.add_argument("--draws", type=int, default=1000, metavar="N", help="pairs drawn from covariances")
    parser.add_argument("--large", action="store_true", help="draw 1920×1440 px instead of 1280×960")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="keep what was found in the frames there")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes")
    parser.add_argument("--only", metavar="WORD", help="only the part of this name")
    parser.add_argument("--mrcal-python", metavar="PATH", help="a Python that has mrcal")
    args = parser.parse_args()
    missed = 0
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder, context.Pool(args.jobs) as pool:
        cache = args.cache or Path(folder)
        cache.mkdir(parents=True, exist_ok=True)
        bench = Bench(cache=cache, size=(1920, 1440) if args.large else (1280, 960), pool=pool)
        on_corners = replace(bench, size=(1920, 1440))
        parts: dict[str, Callable[[], Iterator[Row]]] = {
            "frames": lambda: changes(bench, args.pairs, drawn=True),
            "bowed": lambda: bowed(bench, args.pairs, drawn=True),
            "corners": lambda: changes(on_corners, args.corner_pairs, drawn=False),
            "bowed-corners": lambda: bowed(on_corners, args.corner_pairs, drawn=False),
            "harder": lambda: harder(on_corners, args.corner_pairs),
            "draws": lambda: draws(on_corners, args.draws),
            "peer": lambda: parity(bench, args.mrcal_python),
        }
        if args.only is not None and args.only not in parts:
            parser.error(f"--only {args.only}: wanted one of {', '.join(parts)}")
        for name, part in parts.items():
            if args.only in {None, name}:
                for row in part():
                    show(row.what, row.measured, limit=row.goal, met=row.good)
                    missed += row.good is False
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
