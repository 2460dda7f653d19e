"""Bundle adjustment (Levenberg–Marquardt) of one lens, the poses of the images and the points.

Each point affects only the images that observe it, so the points are eliminated one by one (Schur complement). The
remaining system has the size of the lens and the poses, some hundred parameters. Positions of the images and surveyed
points are observations too (:mod:`calibrary.sfm.priors`).

Source: B. Triggs et al., "Bundle adjustment: a modern synthesis", 2000, sections 3 and 6.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Final, TypeAlias

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray, IntArray
from calibrary.calib.network import turned
from calibrary.errors import CalibrationError
from calibrary.records import replace
from calibrary.sfm.nuisances import NONE, READOUT, ahead, ahead_by_turn, row_shift
from calibrary.sfm.priors import GAUGE, Priors, anchored, priors_of
from calibrary.sfm.tracks import Scene, Tracks

MAX_STEPS: Final = 60
SETTLED: Final = 1e-9
"""The search ends at a step that reduces the cost by less than this share."""
FIRST_DAMPING: Final = 1e-6
"""Small, and reduced step by step. A flight that hardly separates f from the height has its minimum at the end of a
long curved valley, with a floor a million times flatter than its sides; damped by 1e-4 at every other step, the search
ended 3 % of f before the minimum."""
JUDGED_FROM: Final = 3
"""Step at which what it promises is first believed."""
NO_DAMPING: Final = 1e-9
LARGEST_DAMPING: Final = 1e8
LEAST_DAMPING: Final = 1e-10
"""Keeps the equations regular although images do not determine the seven parameters of the world frame (position,
rotation, scale). The lens does not depend on these."""
POINTS_AT_ONCE: Final = 256
"""Of one neighbourhood, so that they meet a few images each: with 200 images a reduction takes a quarter of the time of
one that multiplies all images with all points."""

Columns: TypeAlias = Callable[[FloatArray], FloatArray]
"""(N, 2, k) derivatives of the pixels by k additional lens parameters, for (N, 3) points in the camera frame."""


class Linear(Struct, frozen=True, kw_only=True, eq=False):
    """Residuals and derivatives at a scene; rows of marks are weighted by their accuracy.

    Attributes:
        residuals: (N, 2) observed − projected, px.
        by_lens: (N, 2, g) derivatives by the lens parameters.
        by_pose: (N, 2, 6) derivatives by the rotation (rad, camera axes) and the position of the image; more columns
            are of further parameters that each image has for itself (:func:`with_own`).
        by_point: (N, 2, 3) derivatives by the point.
        by_nuisance: (N, 2, m) derivatives by the adjusted nuisances.
        world: (V, 6, 7) how the poses change with position, rotation and scale of the world.
        priors: residuals of stated positions, surveyed points and nuisances.
    """

    residuals: FloatArray
    by_lens: FloatArray
    by_nuisance: FloatArray
    by_pose: FloatArray
    by_point: FloatArray
    world: FloatArray
    priors: Priors

    @property
    def rss(self) -> float:
        """Sum of squared residuals of the pixels, px²."""
        return float(np.vdot(self.residuals, self.residuals))

    @property
    def cost(self) -> float:
        """Sum of squares including the weighted priors, px²."""
        return self.rss + self.priors.cost


class Reduced(Struct, frozen=True, kw_only=True, eq=False):
    """Normal equations after elimination of the points: g lens parameters, m nuisances, then six of each image.

    Attributes:
        matrix: (D, D) Schur complement.
        right: (D,) right-hand side.
        from_points: reduction of the cost by the points alone, px².
        point_inverse: (P, 3, 3) inverses of the points' diagonal blocks.
        point_right: (P, 3) right-hand sides of the points.
        starts: (P,) index of the first observation of each point.
    """

    matrix: FloatArray
    right: FloatArray
    from_points: float
    point_inverse: FloatArray
    point_right: FloatArray
    starts: IntArray


class Bundle(Struct, frozen=True, kw_only=True, eq=False, dict=True):
    """Result of a bundle adjustment.

    Attributes:
        tracks: observations of the adjustment.
        scene: parameters at the minimum.
        linear: residuals and derivatives at the minimum.
        free: (g,) indices of the adjusted lens parameters.
        place_variance: variance of an image coordinate, px², for the weights of positions and surveyed points.
    """

    tracks: Tracks
    scene: Scene
    linear: Linear
    free: IntArray
    place_variance: float

    @cached_property
    def reduced(self) -> Reduced:
        """Normal equations at the minimum."""
        return reduce(self.tracks, self.linear, self.free)

    @property
    def dof(self) -> int:
        """Degrees of freedom: number of measured values minus number of parameters."""
        points = len(np.unique(self.tracks.point))
        measured = 2 * len(self.tracks.point) + self.linear.priors.numbers
        return measured - len(self.free) - 6 * int(self.tracks.used.sum()) - 3 * points

    @property
    def variance(self) -> float:
        """Variance of one coordinate, px²."""
        return self.linear.cost / max(self.dof, 1)

    @property
    def rms_px(self) -> float:
        """RMS length of the residual vectors, px."""
        return float(np.sqrt(2.0 * self.linear.rss / max(2 * len(self.tracks.point), 1)))


def adjust_bundle(
    tracks: Tracks,
    start: Scene,
    *,
    held: Sequence[str] = (),
    place_variance: float = 0.0,
    most_steps: int = MAX_STEPS,
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
    scene, linear = start, linearise(tracks, start, place_variance)
    if linear is None:
        raise CalibrationError("the reconstruction puts a point behind an image that sees it")
    damping = 0.0
    for number in range(most_steps):
        reduced = reduce(tracks, linear, free, damping)
        step = _solved(reduced)
        if step is not None and number >= JUDGED_FROM and _promised(linear, reduced, step) > worth:
            break
        trial = moved_by(tracks, scene, linear, reduced, free, step) if step is not None else None
        if trial is not None and tracks.positions is not None and tracks.control is None:
            # Linearised steps do not rotate the whole world exactly; a similarity does, and keeps the reprojections.
            trial = anchored(trial, tracks.positions.places, linear.priors.by_place)
        found = linearise(tracks, trial, place_variance) if trial is not None else None
        if trial is not None and found is not None and found.cost <= linear.cost:
            gain, before = linear.cost - found.cost, linear.cost
            scene, linear = trial, found
            # Back to undamped steps, which converge quadratically; each of them may still be refused.
            damping = 0.0 if damping <= NO_DAMPING else damping / 10
            if gain <= SETTLED * before:
                break
        else:
            damping = max(FIRST_DAMPING, damping * 10)
            if damping > LARGEST_DAMPING:
                break
    return Bundle(tracks=tracks, scene=scene, linear=linear, free=free, place_variance=place_variance)


def _promised(linear: Linear, reduced: Reduced, step: FloatArray) -> float:
    """Return the cost after a step by the normal equations, px²."""
    return linear.cost - reduced.from_points - float(reduced.right @ step)


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
    linear = Linear(
        residuals=(tracks.pixels - seen.pixels) * weight[:, None],
        by_lens=seen.by_lens * weight[:, None, None],
        by_nuisance=by_nuisance[..., active] * weight[:, None, None],
        by_pose=by_pose * weight[:, None, None],
        by_point=by_world * weight[:, None, None],
        world=_world(scene, tracks.used),
        priors=priors_of(tracks, scene, place_variance),
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


def reduce(tracks: Tracks, linear: Linear, free: IntArray, damping: float = 0.0) -> Reduced:
    """Eliminate the points from the normal equations.

    Args:
        tracks: observations.
        linear: their residuals and derivatives at a scene.
        free: indices of the adjusted lens parameters.
        damping: Levenberg–Marquardt damping, relative to the diagonal.
    """
    images = np.flatnonzero(tracks.used)
    by_shared = np.concatenate([linear.by_lens[..., free], linear.by_nuisance], axis=-1)
    g, own, residuals = by_shared.shape[-1], np.arange(linear.by_pose.shape[-1]), linear.residuals
    at_image = np.zeros(len(tracks.names), dtype=np.intp)
    at_image[images] = g + len(own) * np.arange(len(images))
    size = g + len(own) * len(images)
    matrix, right = np.zeros((size, size)), np.zeros(size)
    _fill_diagonal(tracks, linear, by_shared, at_image, matrix, right)
    starts = np.flatnonzero(np.diff(tracks.point, prepend=-1))
    point_own = np.add.reduceat(linear.by_point.transpose(0, 2, 1) @ linear.by_point, starts)
    point_right = np.add.reduceat(np.einsum("nci,nc->ni", linear.by_point, residuals), starts)
    priors, at = linear.priors, np.arange(size)
    priors.add(matrix, right, free, at_image[:, None] + np.arange(3, 6))
    stated, axes = priors.by_point[tracks.point[starts]] ** 2, np.arange(3)
    point_own[:, axes, axes] += stated
    point_right += stated * priors.off_point[tracks.point[starts]]
    if not ((priors.by_place > 0).any() or (priors.by_point > 0).any()):
        _hold_world(linear.world[images].reshape(-1, GAUGE), matrix, g)
    matrix[at, at] *= 1.0 + damping
    inverse = _inverses(point_own, damping)
    # Multiply by the Cholesky factors of the inverses before filling the coupling matrix, which is mostly zeros.
    roots = np.linalg.cholesky(inverse)
    of_point = np.cumsum(np.diff(tracks.point, prepend=-1) > 0) - 1
    with_shared = np.add.reduceat(by_shared.transpose(0, 2, 1) @ linear.by_point, starts) @ roots
    with_pose = linear.by_pose.transpose(0, 2, 1) @ (linear.by_point @ roots[of_point])
    right_roots = np.einsum("pij,pi->pj", roots, point_right)
    # Points that one image is the first to see are neighbours on the ground.
    order = np.argsort(np.minimum.reduceat(tracks.image, starts), kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    place = place[of_point]
    in_order = np.argsort(place, kind="stable")
    bounds = np.arange(0, len(order) + POINTS_AT_ONCE, POINTS_AT_ONCE)
    parts = np.searchsorted(place[in_order], bounds)
    for first, begin, end in zip(bounds.tolist(), parts[:-1].tolist(), parts[1:].tolist(), strict=False):
        points, rows = order[first : first + POINTS_AT_ONCE], in_order[begin:end]
        seeing, local = np.unique(tracks.image[rows], return_inverse=True)
        columns = np.concatenate([np.arange(g), (at_image[seeing, None] + own).ravel()])
        coupling = np.zeros((len(columns), len(points), 3))
        coupling[:g] = with_shared[points].transpose(1, 0, 2)
        coupling[g + len(own) * local[:, None] + own, place[rows, None] - first] = with_pose[rows]
        carried = coupling.reshape(len(columns), -1)
        matrix[np.ix_(columns, columns)] -= carried @ carried.T
        right[columns] -= carried @ right_roots[points].reshape(-1)
    return Reduced(
        matrix=(matrix + matrix.T) / 2,
        right=right,
        from_points=float(np.einsum("pi,pij,pj->", point_right, inverse, point_right)),
        point_inverse=inverse,
        point_right=point_right,
        starts=starts,
    )


def _fill_diagonal(
    tracks: Tracks,
    linear: Linear,
    by_shared: FloatArray,
    at_image: IntArray,
    matrix: FloatArray,
    right: FloatArray,
) -> None:
    """Fill in the diagonal blocks of lens and nuisances, and of each image, and the blocks between them."""
    g, own = by_shared.shape[-1], np.arange(linear.by_pose.shape[-1])
    flat = by_shared.reshape(2 * len(by_shared), g)
    matrix[:g, :g] = flat.T @ flat
    right[:g] = flat.T @ linear.residuals.reshape(-1)
    order = np.argsort(tracks.image, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(tracks.image[order])) + 1):
        at = at_image[tracks.image[rows[0]]] + own
        poses = linear.by_pose[rows].reshape(-1, len(own))
        matrix[np.ix_(at, at)] = poses.T @ poses
        shared = by_shared[rows].reshape(2 * len(rows), g).T @ poses
        matrix[:g, at], matrix[at, :g] = shared, shared.T
        right[at] = poses.T @ linear.residuals[rows].reshape(-1)


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


def lens_block(reduced: Reduced, size: int) -> tuple[FloatArray, FloatArray, float]:
    """Eliminate nuisances and poses: return the lens's (g, g) normal matrix and (g,) right-hand side, and the gain.

    The gain is the reduction of the cost by nuisances and poses alone, px².

    Args:
        reduced: normal equations after elimination of the points.
        size: number g of lens parameters.

    Raises:
        CalibrationError: the images do not determine their own poses.
    """
    scale = _scale(reduced.matrix)
    unit = reduced.matrix / np.outer(scale, scale)
    at = np.arange(size, len(unit))
    unit[at, at] += LEAST_DAMPING
    try:
        carried = np.linalg.solve(
            unit[size:, size:], np.column_stack([unit[size:, :size], (reduced.right / scale)[size:]])
        )
    except np.linalg.LinAlgError:
        raise CalibrationError("the images do not determine their own poses") from None
    both = (
        np.column_stack([unit[:size, :size], (reduced.right / scale)[:size]]) - unit[:size, size:] @ carried
    )
    matrix = both[:, :size] * np.outer(scale[:size], scale[:size])
    from_poses = float((reduced.right / scale)[size:] @ carried[:, size])
    return (matrix + matrix.T) / 2, both[:, size] * scale[:size], from_poses


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
        by_pose=np.concatenate([linear.by_pose, by_own], axis=2),
        world=np.pad(linear.world, ((0, 0), (0, c), (0, 0))),
    )
    reduced = reduce(bundle.tracks, wide, bundle.free)
    every = np.arange(len(reduced.right))
    of_images = every[g + linear.by_nuisance.shape[-1] :].reshape(-1, 6 + c)
    sought = np.concatenate([every[:g], of_images[:, 6:].ravel()])
    order = np.concatenate([sought, np.setdiff1d(every, sought)])
    ordered = replace(reduced, matrix=reduced.matrix[np.ix_(order, order)], right=reduced.right[order])
    return lens_block(ordered, len(sought))[:2]


def inverted(matrix: FloatArray) -> FloatArray:
    """Return the inverse of normal equations.

    Raises:
        CalibrationError: they do not determine every parameter.
    """
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    if not (scale > 0).all():
        raise CalibrationError("the images do not determine every parameter of the lens")
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    if not values[0] > 0:
        raise CalibrationError("the images do not determine every parameter of the lens")
    inverse = (vectors / values) @ vectors.T / np.outer(scale, scale)
    return np.asarray((inverse + inverse.T) / 2)


def _scale(matrix: FloatArray) -> FloatArray:
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    if not (scale > 0).all():
        raise CalibrationError("a parameter has no influence on any point: the images do not determine it")
    return np.asarray(scale)


def _solved(reduced: Reduced) -> FloatArray | None:
    try:
        scale = _scale(reduced.matrix)
        unit = reduced.matrix / np.outer(scale, scale)
        unit[np.diag_indices(len(unit))] += LEAST_DAMPING
        return np.asarray(np.linalg.solve(unit, reduced.right / scale) / scale)
    except (CalibrationError, np.linalg.LinAlgError):
        return None


def moved_by(
    tracks: Tracks, scene: Scene, linear: Linear, reduced: Reduced, free: IntArray, step: FloatArray
) -> Scene | None:
    """Apply a step of lens and poses, with the matching step of the points; None if the lens becomes impossible."""
    g, m, images = len(free), linear.by_nuisance.shape[-1], np.flatnonzero(tracks.used)
    parameters, nuisances = scene.parameters.copy(), scene.nuisances.copy()
    parameters[free] += step[:g]
    if m and tracks.nuisances is not None:
        nuisances[tracks.nuisances.active] += step[g : g + m]
    if not scene.model.is_possible(parameters):
        return None
    of_poses = np.zeros((len(tracks.names), 6))
    of_poses[images] = step[g + m :].reshape(-1, 6)
    moved = (
        linear.by_lens[..., free] @ step[:g]
        + linear.by_nuisance @ step[g : g + m]
        + np.einsum("ncp,np->nc", linear.by_pose, of_poses[tracks.image])
    )
    left = reduced.point_right - np.add.reduceat(
        np.einsum("nci,nc->ni", linear.by_point, moved), reduced.starts
    )
    points = scene.points.copy()
    points[tracks.point[reduced.starts]] += np.einsum("pij,pj->pi", reduced.point_inverse, left)
    return replace(
        scene,
        parameters=parameters,
        rotations=turned(scene.rotations, of_poses[:, :3]),
        centres=scene.centres + of_poses[:, 3:],
        points=points,
        nuisances=nuisances,
    )


def _inverses(blocks: FloatArray, damping: float) -> FloatArray:
    """Invert each point's block, with very small damping so that a point with parallel rays does not make all fail."""
    at = np.arange(3)
    scale = np.sqrt(blocks[:, at, at])
    unit = blocks / (scale[:, :, None] * scale[:, None, :])
    unit[:, at, at] += damping + 1e-12
    return np.asarray(np.linalg.inv(unit) / (scale[:, :, None] * scale[:, None, :]))
