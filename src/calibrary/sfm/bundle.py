"""Bundle adjustment (Levenberg–Marquardt) of one lens, the poses of the images and the points.

Each point affects only the images that observe it, so the points are eliminated one by one (Schur complement). The
remaining system has the size of the lens and the poses, some hundred parameters. Positions of the images and surveyed
points are observations too (:mod:`calibrary.sfm.priors`).

Source: B. Triggs et al., "Bundle adjustment: a modern synthesis", 2000, sections 3 and 6.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.network import turned
from calibrary.errors import CalibrationError
from calibrary.records import replace
from calibrary.sfm.priors import Priors, anchored, priors_of
from calibrary.sfm.tracks import Scene, Tracks

__all__ = ["Bundle", "Linear", "Reduced", "adjust_bundle", "lens_block", "linearise", "moved_by", "reduce"]

MAX_STEPS: Final = 60
SETTLED: Final = 1e-9
"""The search ends at a step that reduces the cost by less than this share."""
FIRST_DAMPING: Final = 1e-6
"""Small, and reduced step by step. A flight that hardly separates f from the height has its minimum at the end of a
long curved valley, with a floor a million times flatter than its sides; damped by 1e-4 at every other step, the search
ended 3 % of f before the minimum."""
NO_DAMPING: Final = 1e-9
LARGEST_DAMPING: Final = 1e8
LEAST_DAMPING: Final = 1e-10
"""Keeps the equations regular although images do not determine the seven parameters of the world frame (position,
rotation, scale). The lens does not depend on these."""
POINTS_AT_ONCE: Final = 1024

Columns: TypeAlias = Callable[[FloatArray], FloatArray]
"""(N, 2, k) derivatives of the pixels by k additional lens parameters, for (N, 3) points in the camera frame."""


class Linear(Struct, frozen=True, kw_only=True, eq=False):
    """Residuals and derivatives at a scene; rows of marks are weighted by their accuracy.

    Attributes:
        residuals: (N, 2) observed − projected, px.
        by_lens: (N, 2, g) derivatives by the lens parameters.
        by_pose: (N, 2, 6) derivatives by the rotation (rad, camera axes) and the position of the image.
        by_point: (N, 2, 3) derivatives by the point.
        priors: residuals of stated positions and surveyed points.
    """

    residuals: FloatArray
    by_lens: FloatArray
    by_pose: FloatArray
    by_point: FloatArray
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
    """Normal equations after elimination of the points: g lens parameters, then six of each image.

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


class Bundle(Struct, frozen=True, kw_only=True, eq=False):
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
    tracks: Tracks, start: Scene, *, held: Sequence[str] = (), place_variance: float = 0.0
) -> Bundle:
    """Find the minimum of the cost next to the start.

    Args:
        tracks: observations.
        start: initial scene; determines the lens model and, if positions are used, must be in their frame.
        held: lens parameters that are fixed.
        place_variance: variance of an image coordinate, px², for the weights of positions and surveyed points; zero
            ignores these.

    Raises:
        CalibrationError: the start puts a point behind an image that sees it.
    """
    free = np.array([at for at, name in enumerate(start.model.parameters) if name not in held], dtype=np.intp)
    scene, linear = start, linearise(tracks, start, place_variance)
    if linear is None:
        raise CalibrationError("the reconstruction puts a point behind an image that sees it")
    damping = 0.0
    for _ in range(MAX_STEPS):
        reduced = reduce(tracks, linear, free, damping)
        step = _solved(reduced)
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
    turns = scene.rotations[tracks.image]
    arms = np.einsum("nij,nj->ni", turns, scene.points[tracks.point] - scene.centres[tracks.image])
    if not scene.model.faces(scene.parameters, arms).all():
        return None
    with np.errstate(all="ignore"):
        pixels, by_lens, by_arm = scene.model.project(scene.parameters, arms)
    if further is not None:
        by_lens = np.concatenate([by_lens, further(arms)], axis=-1)
    by_world = by_arm @ turns
    by_pose = np.empty((len(arms), 2, 6))
    for axis, (a, b) in enumerate(((1, 2), (2, 0), (0, 1))):
        # ∂px/∂arm times column `axis` of −[arm]×.
        by_pose[..., axis] = by_arm[..., b] * arms[:, None, a] - by_arm[..., a] * arms[:, None, b]
    by_pose[..., 3:] = -by_world
    weight = np.ones(len(arms))
    if tracks.control is not None and place_variance > 0:
        weight[tracks.marks] = np.sqrt(place_variance) / tracks.control.mark_px
    linear = Linear(
        residuals=(tracks.pixels - pixels) * weight[:, None],
        by_lens=by_lens * weight[:, None, None],
        by_pose=by_pose * weight[:, None, None],
        by_point=by_world * weight[:, None, None],
        priors=priors_of(tracks, scene, place_variance),
    )
    return linear if np.isfinite(linear.cost) and np.isfinite(by_lens.sum() + by_pose.sum()) else None


def reduce(tracks: Tracks, linear: Linear, free: IntArray, damping: float = 0.0) -> Reduced:
    """Eliminate the points from the normal equations.

    Args:
        tracks: observations.
        linear: their residuals and derivatives at a scene.
        free: indices of the adjusted lens parameters.
        damping: Levenberg–Marquardt damping, relative to the diagonal.
    """
    images, g = np.flatnonzero(tracks.used), len(free)
    at_image = np.zeros(len(tracks.names), dtype=np.intp)
    at_image[images] = g + 6 * np.arange(len(images))
    by_lens, residuals = linear.by_lens[..., free], linear.residuals
    size = g + 6 * len(images)
    matrix, right = np.zeros((size, size)), np.zeros(size)
    _fill_diagonal(tracks, linear, by_lens, at_image, matrix, right)
    starts = np.flatnonzero(np.diff(tracks.point, prepend=-1))
    point_own = np.add.reduceat(linear.by_point.transpose(0, 2, 1) @ linear.by_point, starts)
    point_right = np.add.reduceat(np.einsum("nci,nc->ni", linear.by_point, residuals), starts)
    priors, at = linear.priors, np.arange(size)
    priors.add_places(matrix, right, at_image[:, None] + np.arange(3, 6))
    stated, axes = priors.by_point[tracks.point[starts]] ** 2, np.arange(3)
    point_own[:, axes, axes] += stated
    point_right += stated * priors.off_point[tracks.point[starts]]
    matrix[at, at] *= 1.0 + damping
    inverse = _inverses(point_own, damping)
    # Multiply by the Cholesky factors of the inverses before filling the coupling matrix, which is mostly zeros.
    roots = np.linalg.cholesky(inverse)
    of_point = np.cumsum(np.diff(tracks.point, prepend=-1) > 0) - 1
    with_lens = np.add.reduceat(by_lens.transpose(0, 2, 1) @ linear.by_point, starts) @ roots
    with_pose = linear.by_pose.transpose(0, 2, 1) @ (linear.by_point @ roots[of_point])
    right_roots = np.einsum("pij,pi->pj", roots, point_right)
    ends = np.append(starts[1:], len(tracks.point))
    for first in range(0, len(starts), POINTS_AT_ONCE):
        last = min(first + POINTS_AT_ONCE, len(starts))
        rows = slice(starts[first], ends[last - 1])
        coupling = np.zeros((size, last - first, 3))
        coupling[:g] = with_lens[first:last].transpose(1, 0, 2)
        local = of_point[rows] - first
        coupling[at_image[tracks.image[rows], None] + np.arange(6), local[:, None]] = with_pose[rows]
        carried = coupling.reshape(size, -1)
        matrix -= carried @ carried.T
        right -= carried @ right_roots[first:last].reshape(-1)
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
    by_lens: FloatArray,
    at_image: IntArray,
    matrix: FloatArray,
    right: FloatArray,
) -> None:
    """Fill in the diagonal blocks of the lens and of each image, and the blocks between them."""
    g, six = by_lens.shape[-1], np.arange(6)
    flat = by_lens.reshape(-1, g)
    matrix[:g, :g] = flat.T @ flat
    right[:g] = flat.T @ linear.residuals.reshape(-1)
    order = np.argsort(tracks.image, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(tracks.image[order])) + 1):
        at = at_image[tracks.image[rows[0]]] + six
        poses = linear.by_pose[rows].reshape(-1, 6)
        matrix[np.ix_(at, at)] = poses.T @ poses
        shared = by_lens[rows].reshape(-1, g).T @ poses
        matrix[:g, at], matrix[at, :g] = shared, shared.T
        right[at] = poses.T @ linear.residuals[rows].reshape(-1)


def lens_block(reduced: Reduced, size: int) -> tuple[FloatArray, FloatArray, float]:
    """Eliminate the poses too: return the (g, g) normal matrix of the lens, its (g,) right-hand side, and the gain.

    The gain is the reduction of the cost by the poses alone, px².

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
    g, images = len(free), np.flatnonzero(tracks.used)
    parameters = scene.parameters.copy()
    parameters[free] += step[:g]
    if not scene.model.is_possible(parameters):
        return None
    of_poses = np.zeros((len(tracks.names), 6))
    of_poses[images] = step[g:].reshape(-1, 6)
    moved = linear.by_lens[..., free] @ step[:g] + np.einsum(
        "ncp,np->nc", linear.by_pose, of_poses[tracks.image]
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
    )


def _inverses(blocks: FloatArray, damping: float) -> FloatArray:
    """Invert each point's block, with very small damping so that a point with parallel rays does not make all fail."""
    at = np.arange(3)
    scale = np.sqrt(blocks[:, at, at])
    unit = blocks / (scale[:, :, None] * scale[:, None, :])
    unit[:, at, at] += damping + 1e-12
    return np.asarray(np.linalg.inv(unit) / (scale[:, :, None] * scale[:, None, :]))
