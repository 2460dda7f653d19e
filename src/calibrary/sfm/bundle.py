"""Adjustment of one lens, the poses of the images of a flight and the points that they see.

Positions of the images and surveyed points are observations too (:mod:`calibrary.sfm.priors`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import ClassVar, Final, TypeAlias

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray, IntArray
from calibrary.calib import least_squares
from calibrary.calib.least_squares import REGULAR, Kept, Minimum, Search, Step, marginal, minimised, reduce
from calibrary.calib.network import turned
from calibrary.errors import CalibrationError
from calibrary.records import replace
from calibrary.sfm.nuisances import NONE, READOUT, ahead, ahead_by_turn, row_shift
from calibrary.sfm.priors import GAUGE, Priors, anchored, priors_of
from calibrary.sfm.tracks import Scene, Tracks

SEARCH: Final = Search(
    most_steps=60, first_damping=1e-6, no_damping=1e-9, crawl=1e-9, patience=1, regular=REGULAR
)
"""The damping is small, and reduced step by step. A flight that hardly separates f from the height has its minimum at
the end of a long curved valley, with a floor a million times flatter than its sides; damped by 1e-4 at every other
step, the search ended 3 % of f before the minimum."""

Columns: TypeAlias = Callable[[FloatArray], FloatArray]
"""(N, 2, k) derivatives of the pixels by k additional lens parameters, for (N, 3) points in the camera frame."""


class Linear(least_squares.Linear, frozen=True, kw_only=True, eq=False):
    """Residuals and derivatives at a scene; a row is an observation, sorted by point and weighted by its accuracy.

    The shared parameters are those of the lens, then the adjusted nuisances. An image has its rotation (rad, camera
    axes) and its position; further columns are of parameters that each image has for itself (:func:`with_own`).

    Attributes:
        world: (V, 6, 7) how the poses change with position, rotation and scale of the world.
        priors: residuals of stated positions, surveyed points and nuisances.
        images, points: (K,) and (G,) indices of the members in the scene.
    """

    TINY: ClassVar[float] = 1e-12

    kept: Kept
    world: FloatArray
    priors: Priors
    images: IntArray
    points: IntArray

    @property
    def cost(self) -> float:
        """Sum of squares including the weighted priors, px²."""
        return self.rss + self.priors.cost

    @property
    def redundancy(self) -> int:
        """Degrees of freedom before the shared parameters are adjusted, with the priors; nuisances have one each."""
        return super().redundancy + self.priors.numbers

    def adjusted(self, free: IntArray) -> IntArray:
        """Return the indices of some parameters of the lens, and of all nuisances, which are the last."""
        last = self.shared.shape[-1]
        return np.concatenate([free, np.arange(last - self.nuisances, last)])

    @property
    def nuisances(self) -> int:
        """Number of adjusted nuisances."""
        return len(self.priors.known.weight)

    @property
    def by_lens(self) -> FloatArray:
        """(N, 2, g) derivatives by the lens parameters alone."""
        return self.shared[..., : self.shared.shape[-1] - self.nuisances]

    def add_priors(self, matrix: FloatArray, right: FloatArray, free: IntArray) -> None:
        """Add positions and nuisances; without any position, hold the world."""
        places, own = np.zeros((len(self.world), 3), dtype=np.intp), self.kept.jac.shape[-1]
        places[self.images] = len(free) + own * np.arange(len(self.images))[:, None] + np.arange(3, 6)
        self.priors.add(matrix, right, free[: len(free) - self.nuisances], places)
        if not ((self.priors.by_place > 0).any() or (self.priors.by_point > 0).any()):
            _hold_world(self.world[self.images].reshape(-1, GAUGE), matrix, len(free))

    def add_priors_of_gone(self, own: FloatArray, right: FloatArray) -> None:
        """Add surveyed points."""
        stated, axes = self.priors.by_point[self.points] ** 2, np.arange(3)
        own[:, axes, axes] += stated
        right += stated * self.priors.off_point[self.points]


class Bundle(Minimum, frozen=True, kw_only=True, eq=False):
    """A minimum; ``free`` are the adjusted parameters of the lens.

    Attributes:
        tracks: observations of the adjustment.
        scene: parameters there.
        place_variance: variance of an image coordinate, px², for the weights of positions and surveyed points.
    """

    linear: Linear
    tracks: Tracks
    scene: Scene
    place_variance: float


def adjust_bundle(
    tracks: Tracks,
    start: Scene,
    *,
    held: Sequence[str] = (),
    place_variance: float = 0.0,
    most_steps: int = SEARCH.most_steps,
    worth: float = math.inf,
) -> Bundle:
    """Find the minimum of the cost next to the start.

    Args:
        tracks: observations.
        start: initial scene; determines the lens model and, if positions are used, must be in their frame.
        held: lens parameters that are fixed.
        place_variance: variance of an image coordinate, px², for the weights of positions and surveyed points; zero
            ignores these.
        most_steps: number of steps after which the search ends wherever it is.
        worth: cost above which the minimum is of no use; the search ends where a step promises none below.

    Raises:
        CalibrationError: the start puts a point behind an image that sees it.
    """
    free = np.array([at for at, name in enumerate(start.model.parameters) if name not in held], dtype=np.intp)
    first = linearise(tracks, start, place_variance)
    if first is None:
        raise CalibrationError("the reconstruction puts a point behind an image that sees it")

    def step(scene: Scene, change: Step) -> Scene | None:
        trial = moved(tracks, scene, first, change, free)
        if trial is not None and tracks.positions is not None and tracks.control is None:
            # Linearised steps do not rotate the whole world exactly; a similarity does, and keeps the reprojections.
            trial = anchored(trial, tracks.positions.places, first.priors.by_place)
        return trial

    scene, linear = minimised(
        start,
        first,
        partial(linearise, tracks, place_variance=place_variance),
        step,
        free,
        replace(SEARCH, most_steps=most_steps),
        worth=worth,
    )
    return Bundle(tracks=tracks, scene=scene, linear=linear, free=free, place_variance=place_variance)


class Projections(Struct, frozen=True, kw_only=True, eq=False):
    """Where the points of a scene are seen.

    Attributes:
        arms: (N, 3) points in the camera's frame.
        faces: (N,) which of them the lens can see.
        pixels: (N, 2) projections, px.
        by_lens: (N, 2, n) derivatives by the lens parameters.
        by_arm: (N, 2, 3) derivatives by the point in the camera's frame.
        by_readout: (N, 2) derivatives by the travel during the readout.
        by_heading: (N, 2) derivatives by the heading of that travel, px/rad to the left.
    """

    arms: FloatArray
    faces: BoolArray
    pixels: FloatArray
    by_lens: FloatArray
    by_arm: FloatArray
    by_readout: FloatArray
    by_heading: FloatArray


def projections(tracks: Tracks, scene: Scene, further: Columns | None = None) -> Projections:
    """Project the point of each observation, at the moment at which its row was read.

    Args:
        tracks: observations.
        scene: parameters.
        further: derivatives by additional lens parameters, appended to those of the model.
    """
    turns, height, travel = scene.rotations[tracks.image], tracks.image_size[1], scene.nuisances[READOUT]
    moves = bool(travel) or (tracks.nuisances is not None and bool(tracks.nuisances.active[READOUT]))
    offset = scene.points[tracks.point] - scene.centres[tracks.image]
    forward = ahead(scene.rotations)[tracks.image] if moves else np.empty((0, 3))
    if moves:
        offset = offset - travel * forward * (tracks.pixels[:, 1:] / height - 0.5)
    arms = np.einsum("nij,nj->ni", turns, offset)
    with np.errstate(all="ignore"):
        pixels, by_lens, by_arm = scene.model.project(scene.parameters, arms)
        if further is not None:
            by_lens = np.concatenate([by_lens, further(arms)], axis=-1)
        by_readout = by_heading = np.zeros_like(pixels)
        if moves:
            inside = np.einsum("nij,nj->ni", turns, forward)
            pixels, carry, rows = row_shift(pixels, tracks.pixels, by_arm, travel * inside, height)
            by_lens, by_arm = carry @ by_lens, carry @ by_arm
            by_readout = -np.einsum("nci,ni->nc", by_arm, inside) * rows[:, None]
            left = np.einsum("nij,nj->ni", turns, forward[:, [1, 0, 2]] * (-1.0, 1.0, 0.0))
            by_heading = -travel * np.einsum("nci,ni->nc", by_arm, left) * rows[:, None]
    return Projections(
        arms=arms,
        faces=scene.model.faces(scene.parameters, arms),
        pixels=pixels,
        by_lens=by_lens,
        by_arm=by_arm,
        by_readout=by_readout,
        by_heading=by_heading,
    )


def unmoved(tracks: Tracks, scene: Scene) -> FloatArray:
    """Return (N, 2) the observations as a shutter would have seen them that reads all rows at once, px."""
    if not scene.nuisances[READOUT]:
        return tracks.pixels
    still = replace(scene, nuisances=scene.nuisances * (np.arange(len(NONE)) != READOUT))
    shift = projections(tracks, scene).pixels - projections(tracks, still).pixels
    return np.asarray(tracks.pixels - np.nan_to_num(shift))


def linearise(
    tracks: Tracks, scene: Scene, place_variance: float, further: Columns | None = None
) -> Linear | None:
    """Compute residuals and derivatives; None if a point is behind a perspective camera or a value overflows.

    Args:
        tracks: observations.
        scene: parameters at which to evaluate.
        place_variance: as for :func:`adjust_bundle`.
        further: derivatives by additional lens parameters, appended to those of the model.
    """
    seen = projections(tracks, scene, further)
    if not seen.faces.all():
        return None
    arms, by_arm = seen.arms, seen.by_arm
    by_world = by_arm @ scene.rotations[tracks.image]
    by_pose = np.empty((len(arms), 2, 6))
    for axis, (a, b) in enumerate(((1, 2), (2, 0), (0, 1))):
        # ∂px/∂arm times column `axis` of −[arm]×.
        by_pose[..., axis] = by_arm[..., b] * arms[:, None, a] - by_arm[..., a] * arms[:, None, b]
    by_pose[..., :3] += seen.by_heading[..., None] * ahead_by_turn(scene.rotations)[tracks.image, None]
    by_pose[..., 3:] = -by_world
    weight = weights_of(tracks, place_variance)
    active = tracks.nuisances.active if tracks.nuisances is not None and place_variance > 0 else NONE > 0
    by_nuisance = np.zeros((len(arms), 2, len(active)))
    by_nuisance[..., READOUT] = seen.by_readout
    images, starts = np.flatnonzero(tracks.used), np.flatnonzero(np.diff(tracks.point, prepend=-1))
    linear = Linear(
        residuals=(tracks.pixels - seen.pixels) * weight[:, None],
        shared=np.concatenate([seen.by_lens, by_nuisance[..., active]], axis=2) * weight[:, None, None],
        gone=by_world * weight[:, None, None],
        starts=starts,
        kept=Kept(
            jac=by_pose * weight[:, None, None],
            at=(np.cumsum(tracks.used) - 1)[tracks.image],
            size=len(images),
        ),
        scalars=2 * len(arms),
        members=len(starts),
        world=_world(scene, tracks.used),
        priors=priors_of(tracks, scene, place_variance),
        images=images,
        points=tracks.point[starts],
    )
    return linear if np.isfinite(linear.cost) and np.isfinite(seen.by_lens.sum() + by_pose.sum()) else None


def weights_of(tracks: Tracks, place_variance: float) -> FloatArray:
    """Return (N,) the weights of the observations: marks of surveyed points have their own accuracy."""
    weight = np.ones(len(tracks.point))
    if tracks.control is not None and place_variance > 0:
        weight[tracks.marks] = np.sqrt(place_variance) / tracks.control.mark_px
    return weight


def _world(scene: Scene, used: BoolArray) -> FloatArray:
    away, by = scene.centres - scene.centres[used].mean(axis=0), np.zeros((len(used), 6, GAUGE))
    by[:, 3:, :3] = np.eye(3)
    by[:, :3, 3:6] = -scene.rotations
    by[:, 3:, 3:6] = np.cross(np.eye(3), away[:, None, :]).transpose(0, 2, 1)
    by[:, 3:, 6] = away
    return by


def _hold_world(world: FloatArray, matrix: FloatArray, g: int) -> None:
    """Let no step move, turn or scale the world, which nothing determines (inner constraints).

    A nuisance depends on what is up and how long a metre is, a little; without this the search would follow it.
    """
    for direction in world.T:
        along = np.zeros(len(matrix))
        along[g:] = direction
        square = along**2
        matrix += (
            np.outer(along, along) * float(square @ np.diag(matrix)) / max(float(square.sum()) ** 2, 1e-300)
        )


def with_own(bundle: Bundle, by_own: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the normal equations of the g lens parameters and of c further ones that each image has for itself.

    Args:
        bundle: result of the adjustment.
        by_own: (N, 2, c) derivatives of the pixels by those of their image, weighted as :class:`Linear` has them.

    Returns:
        (g + cV, g + cV) matrix and (g + cV,) right-hand side, nuisances and poses eliminated.

    Raises:
        CalibrationError: the images do not determine their own poses.
    """
    linear, g, c = bundle.linear, len(bundle.free), by_own.shape[2]
    wide = replace(
        linear,
        kept=replace(linear.kept, jac=np.concatenate([linear.kept.jac, by_own], axis=2)),
        world=np.pad(linear.world, ((0, 0), (0, c), (0, 0))),
    )
    reduced = reduce(wide, bundle.free)
    every = np.arange(len(reduced.right))
    of_images = every[g + linear.nuisances :].reshape(-1, 6 + c)
    sought = np.concatenate([every[:g], of_images[:, 6:].ravel()])
    order = np.concatenate([sought, np.setdiff1d(every, sought)])
    ordered = replace(reduced, matrix=reduced.matrix[np.ix_(order, order)], right=reduced.right[order])
    return marginal(ordered, len(sought))[:2]


def moved(tracks: Tracks, scene: Scene, linear: Linear, step: Step, free: IntArray) -> Scene | None:
    """Apply a step; None if the lens becomes impossible."""
    parameters, nuisances, points = scene.parameters.copy(), scene.nuisances.copy(), scene.points.copy()
    parameters[free] += step.shared[: len(free)]
    if linear.nuisances and tracks.nuisances is not None:
        nuisances[tracks.nuisances.active] += step.shared[len(free) :]
    if not scene.model.is_possible(parameters):
        return None
    of_poses = np.zeros((len(tracks.names), 6))
    of_poses[linear.images] = step.kept
    points[linear.points] += step.gone
    return replace(
        scene,
        parameters=parameters,
        rotations=turned(scene.rotations, of_poses[:, :3]),
        centres=scene.centres + of_poses[:, 3:],
        points=points,
        nuisances=nuisances,
    )
