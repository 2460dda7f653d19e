"""Uncertainty of a camera from a flight: noise, halves of the images, a fixed principal point, the lens's next term.

The covariance from the residuals includes only noise that is independent from point to point. It does not include
effects on a whole image, such as a rolling shutter, nor missing terms of the model. As for boards, halves of the images
are therefore adjusted separately and compared (:mod:`calibrary.calib.variance_factor`). The camera with the principal
point fixed at the image centre, and the one with the lens's next radial term, add to the variance as far as the images
do not exclude them: a shift d adds w · d dᵀ (between-model variance of model averaging). For a flight that does not
separate the focal length from the height, w is 1.

How well a flight's geometry separates the focal length from the flying height does not depend on the number of points
or their noise. The measure is the largest error of the focal length due to one pixel of systematic error in the images:
σ of fx for an observation noise of 1 px, times √n. The pixel is that of an image of 1600 px, so that cameras with 4 and
with 45 megapixels give the same result for the same flight.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.adjustment import ExtendedStep
from calibrary.calib.least_squares import Kept, inverted, marginal, reduce
from calibrary.calib.lens_models import Solvable
from calibrary.calib.lens_series import next_term, shift_of_term
from calibrary.calib.result import FlightGeometry, FlightNuisance
from calibrary.calib.variance_factor import Half, SplitHalf, compared, solved_half
from calibrary.calibration import Covariance, ImageSize
from calibrary.errors import CalibrationError
from calibrary.records import replace
from calibrary.sfm.adjust import Adjustment
from calibrary.sfm.bundle import (
    Bundle,
    adjust_bundle,
    linearise,
    projections,
    weights_of,
    with_own,
)
from calibrary.sfm.nuisances import READOUT, Nuisance
from calibrary.sfm.ripple import ripple_shift, wander_shift
from calibrary.sfm.tracks import upward

SPLITS: Final = 15
"""Number of splits; each takes two reductions of half the flight."""
FEWEST_IMAGES: Final = 8
"""Fewer cannot be split into halves that determine a lens each."""
FEATURE_SIDE: Final = 1600
"""Longer side for feature detection, px. Errors scale with its pixels, or with those of a smaller image."""
FOCAL_BY_PX: Final = 0.6
"""Largest relative change of fx by one pixel of systematic error at which focal length and height count as separated: a
tenth of a pixel, which a rolling shutter or lens irregularities easily cause, changes fx by 6 %. Vertical images of
flat ground from one height give 2.5, or 0.8 if wind tilts them; two heights with RTK give 0.14."""
CENTRE: Final = ("cx", "cy")
FOCAL: Final = ("fx", "fy")
UNITS: Final = (("m", 1.0), ("m", 1.0), ("%", 100.0), ("m", 1.0))
"""Unit in which each nuisance is shown, and its factor."""
LEAST_STD: Final = 0.002
"""Smallest relative standard deviation of fx from a dozen images; focus and heat change fx as much from day to day."""
SYSTEMATIC: Final = 0.01
"""Relative standard deviation of fx due to systematic errors of the images, if one systematic pixel changes fx by up to
100 %; it grows with the square of that change. Chosen by simulated flights, and so that parts of a real nadir flight
agree."""


TRAVEL_STD: Final = 0.1
"""Of an image's travel during the readout, as a share of the mean one, along and across (rad)."""


class FixedCentre(Struct, frozen=True, kw_only=True, eq=False):
    """The camera with its principal point fixed at the image centre.

    Attributes:
        parameters: (n,) lens parameters.
        free_fx: fx with the principal point free, px.
        weight: plausibility by the images, from 1 (not excluded) to 0 (excluded).
    """

    parameters: FloatArray
    free_fx: float
    weight: float


class CameraUncertainty(Struct, frozen=True, kw_only=True, eq=False):
    """Components of the camera's uncertainty.

    Attributes:
        covariance: covariance of the lens parameters, without the variance factor.
        halves: comparison of halves; None if there are too few images or hardly any half can be solved.
        held: camera with fixed principal point; None if it was fixed from the start or cannot be solved.
        geometry: geometry of the flight.
        fx: focal length, px.
        separates_height: whether the geometry separates the focal length from the flying height.
        nuisances: what shifted the images besides the lens.
        unknown: what could not be computed, in words, and is missing in the others.
    """

    covariance: Covariance
    halves: SplitHalf | None
    held: FixedCentre | None
    geometry: FlightGeometry
    fx: float
    separates_height: bool
    nuisances: tuple[FlightNuisance, ...] = ()
    unknown: tuple[str, ...] = ()

    @property
    def inflation(self) -> float:
        """Variance factor of the covariance."""
        return max(1.0, self.halves.kappa2) if self.halves is not None else 1.0

    @property
    def focal_std(self) -> float:
        """Relative standard deviation of fx, with what systematic errors of the images do to such a flight."""
        fx = self.fx
        noise = math.sqrt(self.covariance.matrix[0, 0] * self.inflation) / fx
        return math.hypot(LEAST_STD, noise, SYSTEMATIC * self.geometry.focal_by_px**2)


def camera_uncertainty(found: Adjustment, *, seed: int = 0) -> CameraUncertainty:
    """Compute all components of the camera's uncertainty.

    Raises:
        CalibrationError: the images do not determine the camera.
    """
    bundle = found.bundle
    C = covariance(bundle)
    geometry = flight_geometry(bundle, C)
    split = halves(bundle, seed=seed)
    inflation = max(1.0, split.kappa2) if split is not None else 1.0
    separates = geometry.focal_by_px <= FOCAL_BY_PX
    # Errors that the residuals do not show: a search that ended early, a principal point that could as well be in the
    # centre, the lens's next term, a lens that departs from every model, and one that wanders. Each is the outer
    # product of a shift.
    px, unknown, nuisances = _feature_px(bundle), list[str](), tuple[FlightNuisance, ...]()
    held = _with_fixed_centre(bundle, C * inflation, geometry.focal_by_px, unknown)
    of_lens, wander = ripple_shift(bundle, px), wander_shift(bundle, px)
    with _told(unknown, "what the lens's next radial term does to K"):
        further = _next_term_shift(bundle, C, inflation)
        of_lens = of_lens + np.outer(further, further)
    with _told(unknown, "what shifts the images besides the lens"):
        nuisances = _nuisances_found(bundle, geometry)
    between = _unsettled(bundle, C) + _by_travel(bundle) + wander + of_lens
    if held is not None:
        shift = held.parameters - bundle.scene.parameters
        between += held.weight * np.outer(shift, shift)
    # The variance factor is applied to the whole covariance later; these shifts are not noise and must not grow by it.
    return CameraUncertainty(
        covariance=Covariance.from_matrix(bundle.scene.model.parameters, C + between / inflation),
        halves=split,
        held=held,
        geometry=geometry,
        fx=float(bundle.scene.parameters[0]),
        separates_height=separates,
        nuisances=nuisances,
        unknown=tuple(unknown),
    )


@contextmanager
def _told(unknown: list[str], what: str) -> Iterator[None]:
    """Note what cannot be computed."""
    try:
        yield
    except (CalibrationError, np.linalg.LinAlgError):
        unknown.append(what)


def covariance(bundle: Bundle) -> FloatArray:
    """Return the (n, n) covariance of the lens from the residuals, poses and points marginalised; zero if fixed.

    Raises:
        CalibrationError: the images do not determine the camera.
    """
    size = len(bundle.free)
    matrix = marginal(bundle.reduced, size)[0]
    full = np.zeros((len(bundle.scene.parameters),) * 2)
    full[np.ix_(bundle.free, bundle.free)] = bundle.variance * inverted(matrix)
    return full


def _nuisances_found(bundle: Bundle, geometry: FlightGeometry) -> tuple[FlightNuisance, ...]:
    """Return the adjusted nuisances, and how far each trades with the camera."""
    priors, g, m = bundle.tracks.nuisances, len(bundle.free), len(bundle.linear.priors.known.weight)
    if priors is None or not m:
        return ()
    names = [bundle.scene.model.parameters[at] for at in bundle.free]
    lens = [at for at, name in enumerate(names) if name in CENTRE or name in FOCAL]
    height = float(
        np.median(bundle.scene.centres[bundle.tracks.used, 2]) - np.median(bundle.scene.points[:, 2])
    )
    found = []
    C = bundle.variance * inverted(marginal(bundle.reduced, g + m)[0])
    std = np.sqrt(np.diag(C))
    for at, number in enumerate(np.flatnonzero(priors.active).tolist(), start=g):
        shares = (C[lens, at] / (std[lens] * std[at])) ** 2 if lens else np.zeros(1)
        unit, by = (
            UNITS[number]
            if geometry.metres or number != READOUT
            else ("‰ of the flying height", 1000 / height)
        )
        found.append(
            FlightNuisance(
                name=tuple(Nuisance)[number].value,
                unit=unit,
                value=float(bundle.scene.nuisances[number]) * by,
                std=float(std[at]) * by,
                prior=(float(priors.mean[number]) * by, float(priors.std[number]) * by),
                trades_with=names[lens[int(np.argmax(shares))]] if lens else names[0],
                share=min(float(shares.max()), 1.0),
            )
        )
    return tuple(found)


def _unsettled(bundle: Bundle, C: FloatArray) -> FloatArray:
    """Return (n, n) the outer product of the remaining step to the minimum, if the search ended before it."""
    right = np.zeros(len(C))
    right[bundle.free] = marginal(bundle.reduced, len(bundle.free))[1]
    left = C @ right / bundle.variance
    return np.outer(left, left)


def halves(bundle: Bundle, *, seed: int = 0, splits: int = SPLITS) -> SplitHalf | None:
    """Split the images into random halves and compare their lens parameters; None if there are too few images.

    Each half triangulates its own points; the halves share only the lens. Each is solved by one Gauss–Newton step from
    the solution of all images.
    """
    images = np.flatnonzero(bundle.tracks.used)
    if len(images) < FEWEST_IMAGES:
        return None
    random, found = np.random.default_rng(seed), []
    for _ in range(splits):
        dealt = random.permutation(images)
        with suppress(CalibrationError):
            found.append((_half(bundle, dealt[::2]), _half(bundle, dealt[1::2])))
    return compared(found, bundle.scene.parameters[bundle.free], splits)


def _half(bundle: Bundle, images: IntArray) -> Half:
    tracks, linear = bundle.tracks, bundle.linear
    chosen = np.zeros(len(tracks.names), dtype=np.bool_)
    chosen[images] = True
    rows = np.flatnonzero(tracks.shared(chosen[tracks.image]))
    part = replace(tracks, image=tracks.image[rows], point=tracks.point[rows], pixels=tracks.pixels[rows])
    if not (part.used == chosen).all():
        raise CalibrationError("an image of this half shares no point with the others")
    starts = np.flatnonzero(np.diff(part.point, prepend=-1))
    mine = replace(
        linear,
        residuals=linear.residuals[rows],
        shared=linear.shared[rows],
        gone=linear.gone[rows],
        starts=starts,
        kept=Kept(jac=linear.kept.jac[rows], at=(np.cumsum(chosen) - 1)[part.image], size=len(images)),
        scalars=2 * len(rows),
        members=len(starts),
        images=np.flatnonzero(chosen),
        points=part.point[starts],
        priors=linear.priors.of(chosen, np.isin(np.arange(len(bundle.scene.points)), part.point)),
    )
    reduced = reduce(mine, bundle.free)
    matrix, right, from_poses = marginal(reduced, len(bundle.free))
    left = mine.cost - float(reduced.from_gone.sum()) - from_poses
    return solved_half(matrix, right, left, mine.redundancy - len(bundle.free))


def _with_fixed_centre(
    bundle: Bundle, C: FloatArray, focal_by_px: float, unknown: list[str]
) -> FixedCentre | None:
    """Adjust the camera with its principal point at the image centre, and weigh it by the images.

    In images of one heading the principal point trades against tilts and positions, and fx changes with it, by more
    than the residuals show. A lens has it near the centre, so the camera that has it there is the other answer, and
    the distance to it counts as far as the images do not exclude it. The weaker the geometry is for the focal length,
    the less it excludes this camera.
    """
    scene = bundle.scene
    if not {scene.model.parameters.index(name) for name in CENTRE} <= set(bundle.free.tolist()):
        return None
    held = None
    with _told(unknown, "what a principal point in the middle does to K"):
        held = held_in_the_middle(scene.model, scene.parameters, C, bundle.tracks.image_size, focal_by_px)
        if held is None:
            return None
        solved = adjust_bundle(
            bundle.tracks,
            replace(scene, parameters=held.parameters),
            held=CENTRE,
            place_variance=bundle.place_variance,
        )
        return replace(held, parameters=solved.scene.parameters)
    return held


def held_in_the_middle(
    model: Solvable, parameters: FloatArray, C: FloatArray, image_size: ImageSize, focal_by_px: float
) -> FixedCentre | None:
    """Return the camera with its principal point at the image centre as the covariance predicts it; None for no lens.

    The others follow as their covariance says (the conditional mean). The weight is the likelihood of that camera
    relative to the best one.

    Args:
        model: lens model.
        parameters: (n,) of the best camera.
        C: (n, n) their covariance.
        image_size: (width, height) px.
        focal_by_px: as in :class:`calibrary.calib.result.FlightGeometry`.
    """
    at = [model.parameters.index(name) for name in CENTRE]
    middle = np.array(image_size) / 2
    off = middle - parameters[at]
    gain = np.linalg.solve(C[np.ix_(at, at)], off)
    trust = 1.0 / (1.0 + (focal_by_px / FOCAL_BY_PX) ** 4)
    moved = parameters + C[:, at] @ gain
    moved[at] = middle
    if not model.is_possible(moved):
        return None
    weight = math.exp(-trust * float(off @ gain) / 2)
    return FixedCentre(parameters=moved, free_fx=float(parameters[0]), weight=weight)


def _by_travel(bundle: Bundle) -> FloatArray:
    """Return (n, n) what a travel during the readout does to the lens that is not the same in every image.

    One travel is adjusted, along the camera's heading; wind and turns make it another in each image.
    """
    tracks, scene, n, g = bundle.tracks, bundle.scene, len(bundle.scene.parameters), len(bundle.free)
    covariance = np.zeros((n, n))
    travel = float(scene.nuisances[READOUT])
    if tracks.nuisances is None or not tracks.nuisances.active[READOUT] or not travel:
        return covariance
    seen = projections(tracks, scene)
    by_travel = np.stack([travel * seen.by_readout, seen.by_heading], axis=2)
    by_travel *= TRAVEL_STD * weights_of(tracks, bundle.place_variance)[:, None, None]
    matrix, _ = with_own(bundle, by_travel)
    moved = inverted(matrix[:g, :g]) @ matrix[:g, g:]
    covariance[np.ix_(bundle.free, bundle.free)] = moved @ moved.T
    return covariance


def _next_term_shift(bundle: Bundle, C: FloatArray, inflation: float) -> FloatArray:
    """Return (n,) the shift of the parameters by the lens's next radial term; zeros if there is no such term.

    Raises:
        CalibrationError: it cannot be computed.
    """
    scene, size = bundle.scene, len(bundle.scene.parameters)
    if not scene.model.next_power or len(bundle.free) < size:
        return np.zeros(size)
    linear = linearise(
        bundle.tracks,
        scene,
        bundle.place_variance,
        lambda inside: next_term(scene.model, scene.parameters, inside).reshape(-1, 2, 1),
    )
    shift = None
    if linear is not None:
        matrix, right, _ = marginal(reduce(linear, np.arange(size + 1)), size + 1)
        inverse = inverted(matrix)
        step = inverse @ right
        found = ExtendedStep(step=step, inverse=inverse, gain=max(float(right @ step), 0.0))
        shift = shift_of_term(
            scene.model, scene.parameters, found, C, bundle.variance, bundle.tracks.image_size, inflation
        )
    if shift is None:
        raise CalibrationError("the images do not determine the lens's next radial term")
    return shift


def _feature_px(bundle: Bundle) -> float:
    """Return px of the images per px at the size of feature detection."""
    return max(1.0, max(bundle.tracks.image_size) / FEATURE_SIDE)


def flight_geometry(bundle: Bundle, C: FloatArray) -> FlightGeometry:
    """Compute the geometry of the adjusted flight.

    Args:
        bundle: result of the adjustment.
        C: (n, n) covariance of the lens from the residuals.
    """
    tracks, scene = bundle.tracks, bundle.scene
    turns, centres = scene.rotations[tracks.used], scene.centres[tracks.used]
    points = scene.points[np.unique(tracks.point)]
    # The plane of the ground defines up, whether or not positions define the orientation of the world.
    up, middle = upward(points, centres), np.median(points, axis=0)
    heights, ground = (centres - middle) @ up, (points - middle) @ up
    typical = float(np.median(heights))
    down = np.degrees(np.arccos(np.clip(-turns[:, 2] @ up, -1.0, 1.0)))
    level = turns[:, 0] - np.outer(turns[:, 0] @ up, up)
    level /= np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-9)
    # Headings without sign: flying a strip in the opposite direction is not another heading.
    across = np.degrees(np.arccos(np.clip(np.abs(level @ level.T), 0.0, 1.0)))
    size = 2 * len(tracks.point)
    by_px = _feature_px(bundle) * math.sqrt(C[0, 0] / bundle.variance * size) / scene.parameters[0]
    return FlightGeometry(
        focal_by_px=float(by_px),
        relief=float(np.subtract(*np.percentile(ground, (84.13, 15.87)))) / 2 / max(typical, 1e-12),
        height_ratio=float(np.percentile(heights, 90) / max(np.percentile(heights, 10), 1e-12)),
        tilt_deg=float(np.percentile(down, 90)),
        headings_deg=float(across.max()),
        metres=bool((bundle.linear.priors.by_place > 0).any()) or tracks.control is not None,
    )
