"""Least squares over a camera or a rig of them, the board's warp and all poses at once, by Levenberg–Marquardt.

Each pose is tied to its own view only, so the poses are eliminated view by view (Schur complement) and what is
left to solve has the size of the lens model: a step costs the same per corner however many views there are.

Source: B. Triggs et al., "Bundle adjustment: a modern synthesis", 2000, section 6.
"""

from __future__ import annotations

from typing import Generic

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.network import LensT, Linear, Network, State, linearise, turned
from calibrary.errors import CalibrationError
from calibrary.records import replace

__all__ = ["Adjusted", "Reduced", "adjust", "reduce"]


MAX_STEPS = 40
CRAWL = 1e-7
"""A step that gains less than this part of the sum of squares; three in a row, and there is no more to gain."""
PATIENCE = 3
SETTLED = 1e-3
"""A step this small, in standard deviations of what it moves, ends the search: the next would be a thousandth of it."""
NOISE_FLOOR_PX = 1e-6
"""Residuals below this are rounding, not noise; the standard deviations of the line above start from here."""
FIRST_DAMPING = 1e-4
LARGEST_DAMPING = 1e8


class Reduced(Struct, frozen=True, kw_only=True, eq=False):
    """The normal equations with the poses eliminated.

    Attributes:
        matrix: (g, g), the Schur complement.
        right: (g,).
        from_poses: px², by how much the poses alone can lower the sum of squares.
        pose_inverse: (V, 6, 6) inverse of each pose's own block.
        coupling: (V, g, 6).
        pose_right: (V, 6).
    """

    matrix: FloatArray
    right: FloatArray
    from_poses: float
    pose_inverse: FloatArray
    coupling: FloatArray
    pose_right: FloatArray

    def gain(self) -> float:
        """px² by which the sum of squares would fall if the problem were linear."""
        return self.from_poses + float(self.right @ scaled_solve(self.matrix, self.right))


class Adjusted(Struct, Generic[LensT], frozen=True, kw_only=True, eq=False):
    """Where a search ended.

    Attributes:
        network: what was fitted to.
        state: the minimum.
        linear: the residuals and derivatives there.
        free: (g,) which of the lens and warp parameters were solved for.
    """

    network: Network
    state: State[LensT]
    linear: Linear
    free: IntArray

    @property
    def rss(self) -> float:
        """Sum of squared residuals, px²."""
        return self.linear.rss

    @property
    def dof(self) -> int:
        """Measured coordinates less parameters."""
        return self.network.scalars - len(self.free) - 6 * int(self.network.used.sum())

    @property
    def variance(self) -> float:
        """px², of one coordinate."""
        return self.rss / max(self.dof, 1)

    @property
    def rms_px(self) -> float:
        """Root mean square length of the residuals, as OpenCV counts it."""
        return float(np.sqrt(2.0 * self.rss / max(self.network.scalars, 1)))


def adjust(
    network: Network,
    start: State[LensT],
    *,
    warp: bool = False,
    poses_only: bool = False,
    damping: float = 0.0,
) -> Adjusted[LensT]:
    """The nearest minimum of the sum of squares.

    Args:
        network: views without a corner that counts keep their poses.
        start: near enough; the model is its model.
        warp: whether the board's warp is solved for too; else it stays as the start has it.
        poses_only: whether lens and warp stay as they are.
        damping: to begin with. Where parameters nearly cancel a first step that is free leads far along their valley.

    Raises:
        CalibrationError: the start puts a point behind the camera, or the equations have no solution.
    """
    size = len(start.parameters)
    free = np.arange(0 if poses_only else size + (2 if warp else 0))
    state, linear = start, linearise(network, start)
    if linear is None:
        raise CalibrationError("the starting values put part of a board behind the camera")
    crawled = 0
    for _ in range(MAX_STEPS):
        step = _step(linear, free, damping)
        moved = None if step is None else _moved(state, free, step)
        trial = None if moved is None else linearise(network, moved)
        if step is not None and moved is not None and trial is not None and trial.rss <= linear.rss:
            variance = max(linear.rss / max(network.scalars, 1), NOISE_FLOOR_PX**2)
            crawled = crawled + 1 if linear.rss - trial.rss <= CRAWL * linear.rss else 0
            state, linear = moved, trial
            damping = 0.0 if damping <= FIRST_DAMPING else damping / 10
            if step.decrease <= SETTLED**2 * variance or crawled >= PATIENCE:
                break
        elif step is not None and step.decrease <= 1e-12 * max(linear.rss, NOISE_FLOOR_PX**2):
            break
        else:
            damping = max(FIRST_DAMPING, damping * 10)
            if damping > LARGEST_DAMPING:
                break
    return Adjusted(network=network, state=state, linear=linear, free=free)


def reduce(linear: Linear, free: IntArray, damping: float = 0.0) -> Reduced:
    """Eliminate the poses.

    Args:
        linear: the network around a state.
        free: which global columns are solved for.
        damping: Levenberg–Marquardt's, relative to the diagonal.
    """
    by_global = linear.by_global[..., free]
    residuals = linear.residuals[..., None]
    own = linear.by_pose.transpose(0, 2, 1) @ linear.by_pose
    own = _damped(own, damping)
    coupling = by_global.transpose(0, 2, 1) @ linear.by_pose
    pose_right = (linear.by_pose.transpose(0, 2, 1) @ residuals)[..., 0]
    flat = by_global.reshape(linear.residuals.size, len(free))
    full = _damped(flat.T @ flat, damping)
    inverse = _inverses(own)
    carried = coupling @ inverse
    matrix = full - np.einsum("vgp,vhp->gh", carried, coupling)
    right = flat.T @ linear.residuals.reshape(-1) - np.einsum("vgp,vp->g", carried, pose_right)
    from_poses = float(np.einsum("vp,vpq,vq->", pose_right, inverse, pose_right))
    return Reduced(
        matrix=(matrix + matrix.T) / 2,
        right=right,
        from_poses=from_poses,
        pose_inverse=inverse,
        coupling=coupling,
        pose_right=pose_right,
    )


def scaled_solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve a symmetric system whose parameters have very different sizes (Jacobi scaling).

    Raises:
        CalibrationError: it is singular.
    """
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    if not (scale > 0).all():
        raise CalibrationError("a parameter has no influence on any corner: the views do not determine it")
    try:
        solution = np.linalg.solve(matrix / np.outer(scale, scale), right / scale)
    except np.linalg.LinAlgError:
        raise CalibrationError("the views do not determine all parameters: tilt the board more") from None
    return np.asarray(solution / scale)


class _Step(Struct, frozen=True, kw_only=True, eq=False):
    """A move: of the globals (g,), of the poses (V, 6), and the px² it promises to gain."""

    of_globals: FloatArray
    of_poses: FloatArray
    decrease: float


def _step(linear: Linear, free: IntArray, damping: float) -> _Step | None:
    reduced = reduce(linear, free, damping)
    try:
        by = scaled_solve(reduced.matrix, reduced.right) if len(free) else np.zeros(0)
    except CalibrationError:
        return None
    left = reduced.pose_right - np.einsum("vgp,g->vp", reduced.coupling, by)
    poses = np.einsum("vpq,vq->vp", reduced.pose_inverse, left)
    decrease = reduced.from_poses + float(reduced.right @ by)
    return _Step(of_globals=by, of_poses=poses, decrease=decrease)


def _moved(state: State[LensT], free: IntArray, step: _Step) -> State[LensT] | None:
    values = np.concatenate([state.parameters, state.warp])
    values[free] += step.of_globals
    size = len(state.parameters)
    if len(free) and not state.model.is_possible(values[:size]):
        return None
    return replace(
        state,
        parameters=values[:size],
        warp=values[size:],
        rotations=turned(state.rotations, step.of_poses[:, :3]),
        translations=state.translations + step.of_poses[:, 3:],
    )


def _damped(blocks: FloatArray, damping: float) -> FloatArray:
    if damping:
        at = np.arange(blocks.shape[-1])
        blocks[..., at, at] *= 1.0 + damping
    return blocks


def _inverses(blocks: FloatArray) -> FloatArray:
    """Inverse of each pose's block; zero for a view without corners, whose pose then stays where it is."""
    at = np.arange(blocks.shape[-1])
    scale = np.sqrt(blocks[:, at, at])
    dead = ~(scale > 0).all(axis=1)
    scale[dead] = 1.0
    unit = blocks / (scale[:, :, None] * scale[:, None, :])
    # A hair of damping keeps a view of collinear corners from stopping all the others.
    unit[:, at, at] += 1e-14
    unit[dead] = np.eye(len(at))
    inverse = np.linalg.inv(unit) / (scale[:, :, None] * scale[:, None, :])
    inverse[dead] = 0.0
    return np.asarray(inverse)
