"""Self-calibration from tracks and a first reconstruction: rejects outliers, weights positions, chooses the lens model.

Adjustment and rejection of outliers alternate until nothing changes, as for boards; each round tests all observations
again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.least_squares import REGULAR, condition, marginal, reduce
from calibrary.calib.lens_change import as_model
from calibrary.calib.lens_models import Solvable
from calibrary.calib.model_choice import (
    FIRST_ORDER_SHARE,
    FISHEYE_FROM_RAD,
    PENALTY,
    Candidate,
    RivalLens,
    promised_gain,
    reason_unfit,
)
from calibrary.calib.network import State
from calibrary.calib.rejection import RAYLEIGH_MEDIAN, Gate
from calibrary.calib.result import ControlFit
from calibrary.errors import CalibrationError
from calibrary.records import replace
from calibrary.sfm.bundle import (
    Bundle,
    adjust_bundle,
    linearise,
    projections,
)
from calibrary.sfm.control import fit_of, on_control, restated, within_marks
from calibrary.sfm.engine import MAX_SIDE
from calibrary.sfm.nuisances import PRECISE_M, READOUT_S, NuisancePriors
from calibrary.sfm.tracks import FEWEST_IMAGES, Positions, Scene, Tracks, aligned, levelled, widest

ROUNDS: Final = 6
FIRST_ROUNDS: Final = 2
"""Number of rounds to see whether a lens is a fisheye."""
CANDIDATE_STEPS: Final = 15
"""Number of steps of a lens model that is only compared; a rational one hardly changes after, and takes long for it."""
FEWEST_POINTS: Final = 60
"""Smallest number of points for an adjustment."""
WORTHIER: Final = 0.3
WORSE: Final = 30.0
"""Limits of the factor on the standard deviations of positions: receivers do not include their drift."""
DOUBT: Final = 4.0
"""Number of residuals as stated that the factor begins with."""
MATTERS_PX: Final = 0.1
"""Root mean square of a coordinate, px at the size of feature detection, that a rational lens must explain besides the
simpler one. One that follows a ripple of 0.2 px has its focal length at the axis, where nothing was seen, off by
0.4 %."""
LEAST_WEIGHT: Final = 0.01
"""Of a rival that counts."""
GPS_FIRST_PX2: Final = 0.25
"""Initial variance of an image coordinate, px², for the weights of the positions."""


class Adjustment(Struct, frozen=True, kw_only=True, eq=False):
    """Result of the adjustment of a flight.

    Attributes:
        bundle: bundle adjustment at the minimum, with the inliers only.
        everything: all observations.
        counts: (N,) which of them are inliers.
        candidates: lens models that were compared.
        rivals: lenses of other models that explain the observations as well, and extrapolate otherwise.
        control: residuals of the surveyed points; None if there are none.
    """

    bundle: Bundle
    everything: Tracks
    counts: BoolArray
    candidates: tuple[Candidate, ...]
    rivals: tuple[RivalLens, ...] = ()
    control: ControlFit | None = None


def adjust(
    tracks: Tracks,
    start: Scene,
    *,
    model: Solvable | None = None,
    held: Sequence[str] = (),
    shared_frame: bool = True,
    readout_s: tuple[float, float] = READOUT_S,
) -> Adjustment:
    """Estimate the camera from tracks.

    Args:
        tracks: observations.
        start: initial scene; its lens may be of any model.
        model: lens model; None to select it by the observations.
        held: lens parameters that are fixed at their start values.
        shared_frame: whether positions and surveyed points are in one coordinate frame, except for their datums.
        readout_s: readout time of the shutter and its standard deviation, s; (0, 0) for a mechanical or global one.

    Raises:
        CalibrationError: there are too few observations, or no camera explains the images.
    """
    _require_enough(tracks)
    if tracks.positions is not None and int(tracks.positions.known.sum()) < FEWEST_IMAGES:
        tracks = replace(tracks, positions=None)
    # The richest usual model first: a poorer one would reject the observations near the edges that show it is too poor.
    kind = model or Solvable.BROWN
    if tracks.control is not None:
        # First without the surveyed points: wrong points are detected by comparison with this reconstruction.
        alone = replace(tracks.only(~tracks.marks), control=None)
        start = _screened(alone, scene_of_model(_laid(alone, start), kind), held)[0].scene
        start = on_control(tracks, start, tracks.control, shared_frame=shared_frame)
    else:
        start = _laid(tracks, start)
    nuisances = _nuisances(tracks, start, readout_s)
    tracks, start = replace(tracks, nuisances=nuisances), replace(start, nuisances=nuisances.mean)
    near = [scene_of_model(start, kind)]
    if model is None:
        bundle, counts = _screened(tracks, near[0], held, FIRST_ROUNDS)
        near = [bundle.scene]
        if widest(bundle.tracks, bundle.scene) > FISHEYE_FROM_RAD:
            with suppress(CalibrationError):
                # What Brown's model takes for inliers of a fisheye is what it can follow, and misleads the choice.
                wide = _screened(tracks, scene_of_model(near[0], Solvable.FISHEYE), held, FIRST_ROUNDS)
                near.insert(int(wide[1].sum() <= counts.sum()), wide[0].scene)
    bundle, counts = _screened(tracks, near[0], held)
    screened, (bundle, candidates, rivals) = bundle.scene.model, _best(bundle, near, model, held)
    if bundle.scene.model is not screened:
        # Observations that a too simple model rejected may be inliers of the chosen one.
        bundle, counts = _screened(tracks, bundle.scene, held)
    stated, control = tracks.control, bundle.tracks.control
    fit = None
    if stated is not None and control is not None:
        fit = fit_of(tracks, bundle, counts, stated=stated, control=control)
    return Adjustment(
        bundle=bundle, everything=tracks, counts=counts, candidates=candidates, rivals=rivals, control=fit
    )


def _nuisances(tracks: Tracks, scene: Scene, readout_s: tuple[float, float]) -> NuisancePriors:
    """Return what is known before the flight of what shifts its images besides the lens."""
    positions, heights = tracks.positions, scene.centres[tracks.used, 2]
    return NuisancePriors.of(
        readout_s=readout_s,
        positions_m=float(np.median(positions.std[positions.known, 0])) if positions is not None else None,
        height=float(np.median(heights) - np.median(scene.points[np.unique(tracks.point), 2])),
    )


def _laid(tracks: Tracks, scene: Scene) -> Scene:
    """Align the scene to the stated positions or, without any, make its ground level."""
    return aligned(scene, tracks.positions) if tracks.positions is not None else levelled(scene)


def scene_of_model(scene: Scene, model: Solvable) -> Scene:
    """Convert the scene to a start for another lens model."""
    if scene.model is model:
        return scene
    camera = State(
        model=scene.model,
        parameters=scene.parameters,
        warp=np.zeros(2),
        rotations=scene.rotations,
        translations=scene.centres,
    )
    return replace(scene, model=model, parameters=as_model(camera, model).parameters)


def _screened(
    tracks: Tracks, scene: Scene, held: Sequence[str], rounds: int = ROUNDS
) -> tuple[Bundle, BoolArray]:
    """Adjust without outliers, with the positions weighted by their actual residuals; also returns (N,) the inliers."""
    stated, positions = tracks.control, tracks.positions
    weighted = positions is not None or stated is not None or tracks.nuisances is not None
    counts, variance = _within(tracks, scene), GPS_FIRST_PX2 if weighted else 0.0
    bundle: Bundle | None = None
    for number in range(rounds):
        kept = tracks.only(counts)
        _require_enough(kept)
        bundle = adjust_bundle(kept, scene, held=held, place_variance=variance)
        scene = bundle.scene
        again = _within(tracks, scene)
        if (again == counts).all() and (number > 0 or not weighted):
            break
        counts = again
        if stated is not None:
            tracks = replace(tracks, control=restated(stated, tracks, scene, counts))
        if positions is not None:
            tracks = replace(tracks, positions=_reweighted(positions, bundle))
        # Positions and pixels are weighed by what is left of each, which changes with the outliers and with each other.
        if weighted:
            variance = 2.0 * bundle.linear.rss / max(2 * bundle.dof, 1)
    assert bundle is not None  # noqa: S101  the loop runs at least once
    return bundle, tracks.shared(counts)


def _require_enough(tracks: Tracks) -> None:
    points, images = len(np.unique(tracks.point)), int(tracks.used.sum())
    if points < FEWEST_POINTS or images < FEWEST_IMAGES:
        raise CalibrationError(
            f"{points} points in {images} images fit one another, need {FEWEST_POINTS} points and {FEWEST_IMAGES} "
            "images: give images of different places, with more overlap"
        )


def _within(tracks: Tracks, scene: Scene) -> BoolArray:
    """Return (N,) which observations have residuals that normally distributed noise explains."""
    gate = Gate()
    seen, marks = projections(tracks, scene), tracks.marks
    off = np.linalg.norm(tracks.pixels - seen.pixels, axis=1)
    usable = seen.faces & np.isfinite(off) & ~marks
    if not usable.any():
        raise CalibrationError(
            "no point of the reconstruction lies before the images that see it, as where all were taken from one place"
        )
    limit = gate.corner_sigmas * float(np.median(off[usable])) / RAYLEIGH_MEDIAN
    inside_limit = usable & (off <= max(limit, gate.corner_floor_px))
    if tracks.control is not None and marks.any():
        inside_limit |= within_marks(tracks, scene, tracks.control)
    return np.asarray(inside_limit, dtype=np.bool_)


def _reweighted(stated: Positions, bundle: Bundle) -> Positions:
    """Scale the standard deviations of the positions by their residuals, separately across and up.

    The residuals are compared with what is left of the positions' errors after they have helped to place their images
    (variance components by redundancy numbers): residuals alone called a right σ of RTK three times too large.

    Source: W. Förstner, "Ein Verfahren zur Schätzung von Varianz- und Kovarianzkomponenten", 1979.
    """
    tracks, priors = bundle.tracks, bundle.linear.priors
    assert tracks.positions is not None  # noqa: S101  the caller has asked
    rows = tracks.positions.known & tracks.used
    off, std = priors.left_place[rows], stated.std.copy()
    now = tracks.positions.std[rows]
    redundancy = _redundancy(bundle)[rows]
    for columns in (slice(0, 2), slice(2, 3)):
        left = float(((off[:, columns] / now[:, columns]) ** 2).sum()) + DOUBT
        ratio = math.sqrt(left / (float(redundancy[:, columns].sum()) + DOUBT))
        ratio *= float(np.median(now[:, columns] / stated.std[rows][:, columns]))
        # A receiver that states centimetres knows them; an ordinary one states nothing, and its σ is a usual one.
        least = 1.0 if float(np.median(stated.std[rows][:, columns])) < PRECISE_M else WORTHIER
        std[:, columns] *= min(max(ratio, least), WORSE)
    return replace(stated, std=std)


def _redundancy(bundle: Bundle) -> FloatArray:
    """Return (V, 3) how much of an error of a stated position its residual shows: 0 nothing, 1 all."""
    tracks, priors, g = bundle.tracks, bundle.linear.priors, len(bundle.free)
    matrix = bundle.reduced.matrix
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse = np.linalg.inv(matrix / np.outer(scale, scale) + REGULAR * np.eye(len(matrix)))
    inverse /= np.outer(scale, scale)
    left, m = np.zeros_like(priors.by_place), len(priors.known.weight)
    for number, image in enumerate(np.flatnonzero(tracks.used).tolist()):
        at = np.r_[g : g + m, g + m + 6 * number + np.arange(3, 6)]
        by = np.concatenate([priors.known.place_by[image], np.diag((1.0, 1.0, priors.known.up_by))], axis=1)
        fitted = np.einsum("ci,ij,cj->c", by, inverse[np.ix_(at, at)], by)
        left[image] = np.clip(1.0 - priors.by_place[image] ** 2 * fitted, 0.0, 1.0)
    return left


def _best(
    bundle: Bundle, near: Sequence[Scene], model: Solvable | None, held: Sequence[str]
) -> tuple[Bundle, tuple[Candidate, ...], tuple[RivalLens, ...]]:
    """Select the lens model with the lowest criterion, as for boards; returns also those compared, and rivals.

    Args:
        bundle: the adjustment whose inliers count.
        near: starts in other models.
        model: the only one; None to select.
        held: as for :func:`adjust`.
    """
    tried = [(_candidate(bundle), bundle)]
    if model is not None:
        return bundle, (tried[0][0],), ()
    for given in (*(scene for scene in near if scene.model is not bundle.scene.model), None):
        own, best = _likeliest(tried)
        if not (given or best.scene.model is Solvable.FISHEYE or _pays(best, Solvable.RATIONAL)):
            continue
        # From a perspective polynomial the way to a strong rational lens is long; a fisheye is at its end.
        start = given or scene_of_model(best.scene, Solvable.RATIONAL)
        with suppress(CalibrationError):
            tried.append(_searched(own, best, start, held))
    # A rational lens that only follows a ripple of the lens is no choice, but a rival, as far as it may be more.
    simple = [one for one in tried if one[0].model is not Solvable.RATIONAL]
    more = {one.model: _beyond_ripple(bundle, other) for one, other in tried}
    shown = [one for one in tried if one in simple or more[one[0].model] > 1]
    own, best = _likeliest(shown)
    rivals = [
        RivalLens(
            model=one.model,
            parameters=other.scene.parameters,
            beside=best.scene.parameters,
            weight=math.exp(min(own.criterion - one.criterion, 0.0) / 2) * min(more[one.model], 1.0),
        )
        for one, other in tried
        if one is not own and one.refused is None
    ]
    return best, tuple(one for one, _ in shown), tuple(one for one in rivals if one.weight > LEAST_WEIGHT)


def _searched(own: Candidate, best: Bundle, start: Scene, held: Sequence[str]) -> tuple[Candidate, Bundle]:
    """Adjust a lens of another model to the observations of the best one so far."""
    worth = _worth(best, start.model)
    # Beside a lens that may not be chosen, a worse one may be, and is searched to its end.
    limit = worth + best.linear.priors.cost if own.refused is None else math.inf
    found = adjust_bundle(
        best.tracks,
        start,
        held=held,
        place_variance=best.place_variance,
        most_steps=CANDIDATE_STEPS,
        worth=limit,
    )
    other = _candidate(found)
    if own.refused is None and found.linear.rss >= worth:
        why = f"no better than {own.model.value} where its search ended, so its RMS is at most this"
        other = replace(other, refused=other.refused or why)
    return other, found


def _likeliest(tried: Sequence[tuple[Candidate, Bundle]]) -> tuple[Candidate, Bundle]:
    """Return the lens with the lowest criterion of those that may be chosen, or the first if none may."""
    allowed = [pair for pair in tried if pair[0].refused is None] or tried[:1]
    return min(allowed, key=lambda pair: pair[0].criterion)


def _worth(bundle: Bundle, model: Solvable) -> float:
    """Return the sum of squares, px², below which another lens model counts beside this one."""
    n, more = 2 * len(bundle.tracks.point), len(model.parameters) - len(bundle.scene.parameters)
    return bundle.linear.rss * math.exp(-(PENALTY * more + 2 * math.log(LEAST_WEIGHT)) / n)


def _beyond_ripple(simple: Bundle, other: Bundle) -> float:
    """Return how much of what a ripple of the lens may be a rational lens explains, beside a simpler one; else 1.

    The uncertainty includes a ripple. Above 1 the rational lens explains more than that, and may be chosen.
    """
    if other.scene.model is not Solvable.RATIONAL:
        return 1.0
    px = MATTERS_PX * max(1.0, max(simple.tracks.image_size) / MAX_SIDE)
    return max(simple.linear.rss - other.linear.rss, 0.0) / (2 * len(simple.tracks.point) * px**2)


def _pays(smaller: Bundle, model: Solvable) -> bool:
    """Return whether a larger model can improve the criterion, estimated from the gradient of the sum of squares."""
    larger = scene_of_model(smaller.scene, model)
    linear = linearise(smaller.tracks, larger, smaller.place_variance)
    if linear is None:
        return False
    size = len(model.parameters)
    with suppress(CalibrationError):
        reduced = reduce(linear, np.arange(size))
        gain = promised_gain(*marginal(reduced, size)[:2])
        more = size - len(smaller.scene.parameters)
        n, rss = 2 * len(smaller.tracks.point), smaller.linear.rss
        return n * math.log(rss / max(rss - gain, 1e-3 * rss)) > FIRST_ORDER_SHARE * more * PENALTY
    return False


def _candidate(bundle: Bundle) -> Candidate:
    n, k = 2 * len(bundle.tracks.point), len(bundle.free)
    cond = math.inf
    with suppress(CalibrationError):
        cond = condition(marginal(bundle.reduced, k)[0])
    scene, tracks = bundle.scene, bundle.tracks
    return Candidate(
        model=scene.model,
        rms_px=bundle.rms_px,
        criterion=n * math.log(max(bundle.linear.rss, 1e-300) / max(n, 1)) + PENALTY * k,
        condition=cond if math.isfinite(cond) else None,
        refused=reason_unfit(scene.model, scene.parameters, cond, tracks.pixels, tracks.image_size),
    )
