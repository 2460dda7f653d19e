"""Flights of one camera solved together: one lens, which may drift with the days, and the rest of each flight apart.

Flights share nothing but the lens. Each is adjusted with the lens held, and its normal equations are reduced to the
lens; their sum, each by its own noise and variance factor, gives the next lens (variable projection). A mean of the
flights' own results is not that: where flights hardly separate the focal length from the height, each ends somewhere
else in a curved valley, and the straight line between two ends leaves it.

The lens drifts at a constant rate of focal length and principal point, with a prior; the result is the lens of the
last day. What the flights have in common because they have one lens (its next term, what departs from every model)
does not become smaller by their number.

Source: G. Golub, V. Pereyra, "Separable nonlinear least squares: the variable projection method and its applications",
2003.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from itertools import combinations, islice
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.result import FlightGeometry
from calibrary.calib.variance_factor import Half, SplitHalf, compared
from calibrary.calibration import Covariance
from calibrary.errors import CalibrationError
from calibrary.records import Record, replace
from calibrary.sfm.adjust import Adjustment, adjust
from calibrary.sfm.bundle import (
    Bundle,
    adjust_bundle,
    inverted,
    lens_block,
    linearise,
    projections,
    unmoved,
)
from calibrary.sfm.nuisances import NONE
from calibrary.sfm.sigma import FEATURE_SIDE, FOCAL_BY_PX, CameraUncertainty, held_in_the_middle
from calibrary.sfm.tracks import Scene, Tracks

FOCAL_RATE_STD: Final = 2e-3
"""Standard deviation of the drift of the focal length, share a year."""
CENTRE_RATE_STD: Final = 5e-4
"""The same of the principal point, share of the longer side a year."""
SHORTEST_YEARS: Final = 0.08
"""Span of days within which no drift is looked for: a month."""
STEPS: Final = 15
HALVINGS: Final = 6
SETTLED: Final = 0.02
"""The search ends at a step below this share of every σ."""
MOST_SPLITS: Final = 15


class Drift(Record):
    """How the lens changed, at a constant rate.

    Attributes:
        focal: change of the focal length, share a year.
        cx, cy: change of the principal point, px a year.
        std: standard deviations of the three.
        years: from the first day to the last.
    """

    focal: float
    cx: float
    cy: float
    std: tuple[float, float, float]
    years: float


class Season(Struct, frozen=True, kw_only=True, eq=False):
    """Flights that were solved together.

    Attributes:
        whole: all flights as one adjustment, at the lens of the last day; the scene of each flight has its own place.
        known: uncertainty of that lens.
        drift: how it changed; None if the days are not known, or all of one month.
    """

    whole: Adjustment
    known: CameraUncertainty
    drift: Drift | None


def of_one_model(found: Sequence[Adjustment]) -> list[Adjustment]:
    """Adjust flights again that chose another lens model than the flight with most observations."""
    model = max(found, key=lambda one: len(one.bundle.tracks.point)).bundle.scene.model
    return [
        one if one.bundle.scene.model is model else adjust(one.everything, one.bundle.scene, model=model)
        for one in found
    ]


def solve_season(
    found: Sequence[Adjustment],
    known: Sequence[CameraUncertainty],
    years: Sequence[float] | None = None,
    labels: Sequence[str] | None = None,
) -> Season:
    """Solve flights together.

    Args:
        found: flights of one camera, each adjusted alone, with one lens model; all lens parameters are free.
        known: their uncertainties alone.
        years: their days, in years; None if not all are known.
        labels: names of the flights, which come before those of their images.

    Raises:
        CalibrationError: the flights do not determine a camera together.
    """
    first, size = found[0].bundle, len(found[0].bundle.scene.parameters)
    span = max(years) - min(years) if years is not None else 0.0
    since = [one - max(years) for one in years] if years is not None and span > SHORTEST_YEARS else None
    drifts, prior = _drifts(first.scene.parameters, first.tracks.image_size, since or [0.0] * len(found))
    search = _Search(
        found=found,
        weights=[1 / (one.bundle.variance * its.inflation) for one, its in zip(found, known, strict=True)],
        drifts=drifts if since is not None else drifts[:, :, :size],
        prior=prior if since is not None else prior[:size],
    )
    x, flights, blocks = search.run()
    C_all = inverted(search.together(blocks)[0])
    C = C_all[:size, :size]
    split = _between_flights(search, blocks, x[:size])
    inflation = max(1.0, split.kappa2) if split is not None else 1.0
    geometry = _geometry(search, blocks, known, float(x[0]))
    between = np.zeros_like(C)
    for by, (matrix, _), one in zip(search.drifts, blocks, known, strict=True):
        carried = (C_all @ by.T @ matrix)[:size]
        between += len(found) * carried @ one.of_lens @ carried.T
    held = held_in_the_middle(
        first.scene.model, x[:size], C * inflation, first.tracks.image_size, geometry.focal_by_px
    )
    if held is not None:
        shift = held.parameters - x[:size]
        between += held.weight * np.outer(shift, shift)
    uncertainty = CameraUncertainty(
        covariance=Covariance.from_matrix(first.scene.model.parameters, C + between / inflation),
        halves=split,
        held=held,
        geometry=geometry,
        fx=float(x[0]),
        separates_height=geometry.focal_by_px <= FOCAL_BY_PX,
        of_lens=between,
        unknown=tuple(dict.fromkeys(what for one in known for what in one.unknown)),
    )
    return Season(
        whole=_as_one(found, flights, x[:size], labels or [str(at) for at in range(1, len(found) + 1)]),
        known=uncertainty,
        drift=_drift(x[size:], C_all[size:, size:] * inflation, first, span) if since is not None else None,
    )


class _Search(Struct, frozen=True, kw_only=True, eq=False):
    """The search for the shared lens.

    Attributes:
        found: the flights alone.
        weights: of their squared residuals.
        drifts: (F, n, n + r) lens of each flight by the lens of the last day and the r rates, in σ of their priors.
        prior: (n + r,) weights of the parameters' priors.
    """

    found: Sequence[Adjustment]
    weights: Sequence[float]
    drifts: FloatArray
    prior: FloatArray

    def run(self) -> tuple[FloatArray, list[Bundle], list[tuple[FloatArray, FloatArray]]]:
        """Return the parameters, the flights at their lens, and the flights' (n, n) and (n,) normal equations."""
        blocks = [self._block(one.bundle, by) for one, by in zip(self.found, self.weights, strict=True)]
        own = [one.bundle.scene.parameters for one in self.found]
        # From the flights' own lenses, as far as each knows it.
        start = [(matrix, matrix @ lens) for (matrix, _), lens in zip(blocks, own, strict=True)]
        matrix, right = self.together(start)
        x = np.asarray(np.linalg.solve(matrix + np.diag(1e-12 * np.diag(matrix)), right), dtype=np.float64)
        flights, cost = self._at(x)
        for _ in range(STEPS):
            blocks = [self._block(one, by) for one, by in zip(flights, self.weights, strict=True)]
            matrix, right = self.together(blocks)
            C = inverted(matrix)
            step = C @ (right - self.prior * x)
            if np.abs(step / np.sqrt(np.diag(C))).max() < SETTLED:
                break
            for _ in range(HALVINGS):
                with suppress(CalibrationError):
                    trial, further = self._at(x + step)
                    if further <= cost:
                        x, flights, cost = x + step, trial, further
                        break
                step = step / 2
            else:
                break
        return x, flights, [self._block(one, by) for one, by in zip(flights, self.weights, strict=True)]

    def together(
        self, blocks: Sequence[tuple[FloatArray, FloatArray]], members: Sequence[int] | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return the (n + r, n + r) normal equations of some flights, with the priors."""
        matrix, right = np.diag(self.prior), np.zeros(len(self.prior))
        for at in range(len(blocks)) if members is None else members:
            by, (own, its) = self.drifts[at], blocks[at]
            matrix = matrix + by.T @ own @ by
            right = right + by.T @ its
        return matrix, right

    def _at(self, x: FloatArray) -> tuple[list[Bundle], float]:
        """Return the flights adjusted at a lens, and the cost of all."""
        flights, cost = [], float(self.prior @ x**2)
        for one, by, weight in zip(self.found, self.drifts, self.weights, strict=True):
            bundle, lens = one.bundle, by @ x
            if not bundle.scene.model.is_possible(lens):
                raise CalibrationError("the flights together ask for a lens that there is none of")
            held = adjust_bundle(
                bundle.tracks,
                replace(bundle.scene, parameters=lens),
                held=bundle.scene.model.parameters,
                place_variance=bundle.place_variance,
            )
            flights.append(replace(held, free=bundle.free))
            cost += weight * held.linear.cost
        return flights, cost

    @staticmethod
    def _block(bundle: Bundle, weight: float) -> tuple[FloatArray, FloatArray]:
        matrix, right, _ = lens_block(bundle.reduced, len(bundle.free))
        return weight * matrix, weight * right


def _drifts(
    lens: FloatArray, image_size: tuple[int, int], since: Sequence[float]
) -> tuple[FloatArray, FloatArray]:
    """Return (F, n, n + 3) each flight's lens by that of the last day and the rates; (n + 3,) weights of the priors."""
    size = len(lens)
    by = np.zeros((len(since), size, size + 3))
    by[:, :, :size] = np.eye(size)
    centre = CENTRE_RATE_STD * max(image_size)
    for at, year in enumerate(since):
        by[at, (0, 1), size] = year * FOCAL_RATE_STD * lens[:2]
        by[at, 2, size + 1] = by[at, 3, size + 2] = year * centre
    return by, np.r_[np.zeros(size), np.ones(3)]


def _drift(rates: FloatArray, C: FloatArray, bundle: Bundle, span: float) -> Drift:
    centre = CENTRE_RATE_STD * max(bundle.tracks.image_size)
    unit = np.array([FOCAL_RATE_STD, centre, centre])
    focal, cx, cy = (rates * unit).tolist()
    a, b, c = (np.sqrt(np.diag(C)) * unit).tolist()
    return Drift(focal=focal, cx=cx, cy=cy, std=(a, b, c), years=span)


def _between_flights(
    search: _Search, blocks: Sequence[tuple[FloatArray, FloatArray]], lens: FloatArray
) -> SplitHalf | None:
    """Compare the lenses of two halves of the flights; each flight's own halves are in its weight already."""
    every, pairs = range(len(blocks)), []
    splits = [*islice(combinations(every, len(blocks) // 2), MOST_SPLITS)]
    for part in splits:
        with suppress(CalibrationError):
            rest = [at for at in every if at not in part]
            pairs.append((_half(search, blocks, part, len(lens)), _half(search, blocks, rest, len(lens))))
    return compared(pairs, lens, len(splits))


def _half(
    search: _Search, blocks: Sequence[tuple[FloatArray, FloatArray]], members: Sequence[int], size: int
) -> Half:
    matrix, right = search.together(blocks, members)
    C = inverted(matrix)
    return (C @ right)[:size], C[:size, :size]


def _geometry(
    search: _Search,
    blocks: Sequence[tuple[FloatArray, FloatArray]],
    known: Sequence[CameraUncertainty],
    fx: float,
) -> FlightGeometry:
    """Return the geometry of the flights: of each thing the best of any, and how well all separate fx from height.

    A pixel of systematic error may be the same in all flights, since one camera took them: more flights of one kind do
    not make that figure better.
    """
    unit = [(own / by, its) for (own, its), by in zip(blocks, search.weights, strict=True)]
    C = inverted(search.together(unit)[0])
    tracks = [one.bundle.tracks for one in search.found]
    px = max(1.0, max(tracks[0].image_size) / FEATURE_SIDE)
    of = [one.geometry for one in known]
    return FlightGeometry(
        focal_by_px=px * math.sqrt(C[0, 0] * sum(2 * len(one.point) for one in tracks)) / fx,
        relief=max(one.relief for one in of),
        height_ratio=max(one.height_ratio for one in of),
        tilt_deg=max(one.tilt_deg for one in of),
        headings_deg=max(one.headings_deg for one in of),
        metres=all(one.metres for one in of),
    )


def _as_one(
    found: Sequence[Adjustment], flights: Sequence[Bundle], lens: FloatArray, labels: Sequence[str]
) -> Adjustment:
    """Join the flights to one adjustment with one lens, as a shutter without a readout would have seen them."""
    images, points, scenes, parts = 0, 0, [], []
    for alone, bundle in zip(found, flights, strict=True):
        tracks, scene = alone.everything, bundle.scene
        last = replace(scene, parameters=lens, nuisances=NONE)
        still = replace(scene, nuisances=NONE)
        moved = projections(tracks, last).pixels - projections(tracks, still).pixels
        pixels = unmoved(tracks, scene) + np.nan_to_num(moved)
        parts.append(replace(tracks, image=tracks.image + images, point=tracks.point + points, pixels=pixels))
        scenes.append(last)
        images, points = images + len(tracks.names), points + len(scene.points)
    everything = Tracks(
        names=tuple(
            f"{label}/{name}" for label, one in zip(labels, parts, strict=True) for name in one.names
        ),
        image_size=parts[0].image_size,
        image=np.concatenate([one.image for one in parts]),
        point=np.concatenate([one.point for one in parts]),
        pixels=np.concatenate([one.pixels for one in parts]),
    )
    scene = Scene(
        model=scenes[0].model,
        parameters=lens,
        rotations=np.concatenate([one.rotations for one in scenes]),
        centres=np.concatenate([one.centres for one in scenes]),
        points=np.concatenate([one.points for one in scenes]),
        nuisances=NONE,
    )
    counts = np.concatenate([one.counts for one in found])
    kept = everything.only(counts)
    linear = linearise(kept, scene, 0.0)
    if linear is None:
        raise CalibrationError("the flights together put a point behind an image that sees it")
    bundle = Bundle(tracks=kept, scene=scene, linear=linear, free=np.arange(len(lens)), place_variance=0.0)
    # What other lenses do where no point was seen is the same for all flights, as what departs from every model.
    rivals = max(found, key=lambda one: len(one.bundle.tracks.point)).rivals
    return Adjustment(
        bundle=bundle, everything=everything, counts=counts, candidates=found[0].candidates, rivals=rivals
    )
