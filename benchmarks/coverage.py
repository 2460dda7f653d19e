"""Whether the standard deviations of board calibrations hold: wherever they are proven, and parameter by parameter.

    python -m benchmarks.coverage [--sets N] [--only WORD]

Sets of 20 views by known cameras, as corners with normal noise, nothing rendered. Of each calibration that may be
kept fixed the true error is held against the standard deviation that it states, the variance factor included: at the
worst of the 27 × 21 places of the frame that are proven, after the best turn of the camera, over √(σx² + σy²), and
for every parameter of the true model. A bulge of the lens is part of the truth in the frame, but of no parameter.
Where σ is exactly right 1 % of sets exceed 3 somewhere. Wanted: at most 2 % of what may be kept fixed, 98 % of the
parameters below 3 σ, and no set with a rolling shutter or a stretched print among them. The medians of what is stated
stand beside it: σ is to be true, and as small as it can be.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if not TYPE_CHECKING:
    # A program's own folder is where Python looks first.
    sys.path.insert(0, str(Path(__file__).parents[1]))

from calibrary.arrays import FloatArray
from calibrary.calib.assessment import MAP_SHAPE
from calibrary.calib.estimation import estimate
from calibrary.calib.geometry import near_corners
from calibrary.calib.observations import Observations
from calibrary.calib.projection_difference import projection_difference
from calibrary.calib.result import CalibrationResult
from calibrary.calibration import Calibration, Covariance
from calibrary.distortion import BrownConrady, KannalaBrandt, Rational, Unified
from calibrary.errors import CalibrationError
from calibrary.records import replace
from calibrary.validation import Use
from tests.calib.faults import bumped, rolling, s_curved, twisted
from tests.calib.solving import SIZE, Session, camera, shoot

FAR = 3.0
TURN = 1e-6
LEAST_PX = 0.01
"""Below it an error is none; where the turn of the camera is fitted best σ may be a thousandth of a pixel."""
MOST_FAR, LEAST_NEAR = 0.02, 0.98
BULGES_PX = {f"lens-bulge-{px:g}px": px for px in (0.05, 0.1, 0.15, 0.4)} | {"fisheye-bulge-0.15px": 0.15}
FORCED = {"rational-by-brown": "brown"}
"""Lens models that are asked for; else they are chosen."""
NEVER_FIXED = ("rolling-shutter", "stretch")


@dataclass(kw_only=True)
class Tally:
    """What the sets of one kind said.

    Attributes:
        worst: of the passing sets, |error| ÷ σ at the worst place of the frame.
        parameters: |z| of every parameter of the passing sets.
        verdicts: how many sets got which.
        focal_std: of the passing sets, relative, of the focal length near the axis, the variance factor included.
        edge_px: of the passing sets, the largest standard deviation in the frame.
        seconds: CPU time.
    """

    worst: list[float] = field(default_factory=list)
    parameters: list[float] = field(default_factory=list)
    verdicts: dict[Use, int] = field(default_factory=lambda: dict.fromkeys(Use, 0))
    focal_std: list[float] = field(default_factory=list)
    edge_px: list[float] = field(default_factory=list)
    seconds: float = 0.0


def errors(
    result: CalibrationResult, truth: Calibration, departs: Callable[[FloatArray], FloatArray] | None = None
) -> tuple[float, list[float]]:
    """|error| ÷ √(σx² + σy²) at the worst place where K is proven, and |z| of each parameter.

    ``departs`` is what the true lens adds to the true camera's pixels, (N, 2) px.
    """
    quality, stated = result.calibration.quality, result.uncertainty
    assert quality is not None
    assert quality.covariance is not None
    assert stated is not None
    names, matrix = quality.covariance.names, quality.covariance.matrix * quality.inflation
    exact = Covariance.from_matrix(("fx",), [[0.0]])
    seen = projection_difference(
        result.calibration,
        truth,
        shape=MAP_SHAPE,
        covariances=(Covariance.from_matrix(names, matrix), exact),
    )
    assert seen.std_px is not None
    assert seen.noise is not None
    found, true = (_values(one) for one in (result.calibration, truth))
    same = type(result.calibration.distortion) is type(truth.distortion)
    # fx of a sphere model is (1 + ξ) times that of every other one.
    named = set() if isinstance(truth.distortion, Unified) else {"fx", "fy", "cx", "cy"}
    std = np.sqrt(np.diag(matrix))
    own = [
        abs(found[name] - true[name]) / float(sigma)
        for name, sigma in zip(names, std, strict=True)
        if same or name in named
    ]
    # What the field of residuals adds to σ is stated along the worst direction only.
    both = (seen.noise**2).sum(axis=(-2, -1)) + np.maximum(stated.std_px**2 - seen.std_px**2, 0.0)
    error = seen.vectors
    if departs is not None:
        flat = seen.pixels.reshape(-1, 2)
        error = error + departs(flat + error.reshape(-1, 2)).reshape(error.shape)
        # The camera turns to where this, too, fits best.
        rays = result.calibration.unproject(flat)
        turns = [result.calibration.project(rays + TURN * np.cross(axis, rays)) - flat for axis in np.eye(3)]
        J = np.stack(turns, axis=-1).reshape(-1, 3) / TURN
        root = np.repeat(1 / np.sqrt(both + LEAST_PX**2).ravel(), 2)
        known = np.isfinite(J).all(axis=1) & np.isfinite(error.ravel()) & np.isfinite(root)
        turn = np.linalg.lstsq(J[known] * root[known, None], error.ravel()[known] * root[known], rcond=None)[
            0
        ]
        error = error - (J @ turn).reshape(error.shape)
    lengths = np.linalg.norm(error, axis=-1)
    corners = np.concatenate([view.image_points for view in result.observations.views])
    size = result.observations.image_size
    proven = near_corners(seen.pixels.reshape(-1, 2), corners, size).reshape(both.shape)
    proven &= np.nan_to_num(stated.std_px, nan=np.inf) <= result.policy.fixed_sigma_px
    z = np.where(proven, lengths / np.sqrt(both + LEAST_PX**2), np.nan)
    return float(np.nanmax(z)), own


def _values(calibration: Calibration) -> dict[str, float]:
    K, lens = calibration.intrinsics, calibration.distortion
    return {"fx": K.fx, "fy": K.fy, "cx": K.cx, "cy": K.cy} | dict(
        lens.coefficients if lens is not None else {}
    )


def _middle(numbers: list[float]) -> float:
    return float(np.median(numbers)) if numbers else math.nan


def bulge(seed: int, px: float) -> Callable[[FloatArray], FloatArray]:
    """What a lens departs from its model by: up to ``px`` around one place."""
    rng = np.random.default_rng([seed, 9])
    at, way = rng.uniform(0.2, 0.8, 2) * SIZE, rng.normal(size=2)
    way *= px / np.linalg.norm(way)

    def departs(pixels: FloatArray) -> FloatArray:
        near = np.exp(-((pixels - at) ** 2).sum(axis=1) / (2 * (0.09 * SIZE[0]) ** 2))
        return np.asarray(near[:, None] * way)

    return departs


def bulged(seed: int, px: float, truth: Calibration | None = None) -> Observations:
    """Views by such a lens."""
    seen, departs = shoot(truth, Session(views=20), seed), bulge(seed, px)
    return replace(
        seen,
        views=tuple(
            replace(one, image_points=one.image_points + departs(one.image_points)) for one in seen.views
        ),
    )


def kinds() -> dict[str, tuple[Callable[[int], Observations], Calibration]]:
    """Sessions by seed, each with its true camera."""
    plain, twenty = camera(), Session(views=20)
    faint = camera(distortion=BrownConrady(k1=-0.01, k2=0.004, p1=2e-5, p2=-3e-5, k3=0.001))
    tele = camera(
        fx=4.0 * SIZE[0],
        fy=4.0 * SIZE[0],
        distortion=BrownConrady(k1=-0.05, k2=0.3, p1=3e-4, p2=-4e-4, k3=0.0),
    )
    rational = camera(
        distortion=Rational(k1=0.25, k2=0.02, p1=2e-4, p2=-2e-4, k3=0.001, k4=0.5, k5=0.06, k6=0.002)
    )
    strong = camera(
        fx=1000.0,
        fy=1000.0,
        distortion=Rational(k1=1.2, k2=0.25, p1=2e-4, p2=-2e-4, k3=0.005, k4=1.55, k5=0.5, k6=0.03),
    )
    mei = camera(fx=2100.0, fy=2098.0, distortion=Unified(xi=1.2, k1=-0.08, k2=0.01, p1=2e-4, p2=-3e-4))
    fisheye = camera(fx=1000.0, fy=1000.0, distortion=KannalaBrandt(k1=0.02, k2=-0.01, k3=0.001, k4=0.0))
    return {
        "clean": (lambda seed: shoot(how=twenty, seed=seed), plain),
        **{
            name: (partial(bulged, px=px), plain) for name, px in BULGES_PX.items() if name.startswith("lens")
        },
        "fisheye-bulge-0.15px": (partial(bulged, px=0.15, truth=fisheye), fisheye),
        "far": (lambda seed: shoot(how=Session(views=20, fill=(0.12, 0.3)), seed=seed), plain),
        "few-views": (lambda seed: shoot(how=Session(views=10), seed=seed), plain),
        "rolling-shutter": (rolling, plain),
        "stretch-0.1%": (lambda seed: shoot(how=Session(views=20, stretch=(1.0, 1.001)), seed=seed), plain),
        "weak-distortion": (lambda seed: shoot(faint, twenty, seed), faint),
        "tele": (lambda seed: shoot(tele, twenty, seed), tele),
        "bow-0.3mm": (lambda seed: shoot(how=Session(views=20, bow_mm=0.3), seed=seed), plain),
        "bump-0.5mm": (bumped, plain),
        "twist-0.5mm": (lambda seed: twisted(seed, 0.5), plain),
        "s-curve-0.5mm": (s_curved, plain),
        "rational-by-brown": (lambda seed: shoot(rational, twenty, seed), rational),
        "rational-lens": (lambda seed: shoot(rational, twenty, seed), rational),
        "strong-rational-lens": (lambda seed: shoot(strong, twenty, seed), strong),
        "fisheye-lens": (lambda seed: shoot(fisheye, Session(views=20, fill=(0.25, 0.7)), seed), fisheye),
        "mei-lens": (lambda seed: shoot(mei, Session(views=20, fill=(0.25, 0.7)), seed), mei),
    }


def main() -> int:
    """Calibrate every set and print a line for each kind; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description="Whether stated standard deviations hold.")
    parser.add_argument("--sets", type=int, default=6, help="of each kind")
    parser.add_argument("--only", metavar="WORD", default="", help="kinds with this in their name")
    parser.add_argument("--quick", action="store_true", help="accepted as by every benchmark; it is quick")
    given = parser.parse_args()
    missed = False
    print(
        f"{'sets':22}{'fixed':>6}{'start':>6}{'no':>4}{'> 3':>8}{'worst':>7}{'|z| < 3':>9}{'σ of f':>9}"
        f"{'edge px':>9}{'CPU s':>7}"
    )
    for name, (make, truth) in kinds().items():
        if given.only not in name:
            continue
        tally = Tally()
        for seed in range(given.sets):
            seen, began = make(seed), time.process_time()
            try:
                result = estimate(seen, FORCED.get(name, "auto"))
            except CalibrationError as error:
                print(f"{name} {seed}: {error}")
                missed = True
                continue
            tally.seconds += time.process_time() - began
            tally.verdicts[result.verdict] += 1
            if result.verdict is Use.FIXED:
                bulges = bulge(seed, BULGES_PX[name]) if name in BULGES_PX else None
                worst, own = errors(result, truth, bulges)
                tally.worst.append(worst)
                tally.parameters += own
                tally.focal_std.append(result.evidence.sigma_focal)
                tally.edge_px.append(result.evidence.edge_px or math.inf)
        far = float(np.mean(np.array(tally.worst) > FAR)) if tally.worst else 0.0
        near = float(np.mean(np.array(tally.parameters) < FAR)) if tally.parameters else 1.0
        missed |= far > MOST_FAR or near < LEAST_NEAR
        missed |= name.startswith(NEVER_FIXED) and tally.verdicts[Use.FIXED] > 0
        counts = tuple(tally.verdicts.values())
        print(
            f"{name:22}{counts[0]:6}{counts[1]:6}{counts[2]:4}{far:8.1%}{max(tally.worst, default=0.0):7.1f}"
            f"{near:9.1%}{_middle(tally.focal_std):9.4%}{_middle(tally.edge_px):9.2f}"
            f"{tally.seconds / given.sets:7.2f}",
            flush=True,
        )
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
