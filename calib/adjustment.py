"""Least-squares adjustment (Levenberg–Marquardt) of a camera or rig, the board warp and all poses together.

Each pose affects only its own view, so the poses are eliminated view by view (Schur complement). The remaining system
has the size of the lens model: the cost of a step per corner does not depend on the number of views.

Source: B. Triggs et al., "Bundle adjustment: a modern synthesis", 2000, section 6.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.network import LensT, Linear, Network, State, linearise, turned
from calibrary.errors import CalibrationError
from calibrary.records import replace

__all__ = ["Adjusted", "ExtendedStep", "Reduced", "adjust", "extended_step", "reduce", "scaled_solve"]

MAX_STEPS = 40
CRAWL = 1e-7
"""The search ends after three successive steps that each reduce the sum of squares by less than this fraction."""
PATIENCE = 3
SETTLED = 1e-3
"""The search ends at a step smaller than this, in standard deviations of the parameters that it changes."""
NOISE_FLOOR_PX = 1e-6
"""Residuals below this, in px, are rounding errors; lower bound of sigma for :data:`SETTLED`."""
FIRST_DAMPING = 1e-4
LARGEST_DAMPING = 1e8


class Reduced(Struct, frozen=True, kw_only=True, eq=False):
    """Normal equations after elimination of the poses.

    Attributes:
        matrix: (g, g) Schur complement.
        right: (g,) right-hand side.
        from_poses: reduction of the sum of squares by the poses alone, px².
        pose_inverse: (V, 6, 6) inverses of the poses' diagonal blocks.
        coupling: (V, g, 6) blocks between global parameters and poses.
        pose_right: (V, 6) right-hand sides of the poses.
    """

    matrix: FloatArray
    right: FloatArray
    from_poses: float
    pose_inverse: FloatArray
    coupling: FloatArray
    pose_right: FloatArray

    def gain(self) -> float:
        """Reduction of the sum of squares predicted by the linear model, px²."""
        return self.from_poses + float(self.right @ scaled_solve(self.matrix, self.right))


class Adjusted(Struct, Generic[LensT], frozen=True, kw_only=True, eq=False):
    """Result of an adjustment.

    Attributes:
        network: observations of the adjustment.
        state: parameters at the minimum.
        linear: residuals and derivatives at the minimum.
        free: (g,) indices of the adjusted lens and warp parameters.
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
        """Degrees of freedom: number of measured coordinates minus number of parameters."""
        return self.network.scalars - len(self.free) - 6 * int(self.network.used.sum())

    @property
    def variance(self) -> float:
        """Variance of one coordinate, px²."""
        return self.rss / max(self.dof, 1)

    @property
    def rms_px(self) -> float:
        """RMS length of the residual vectors, px, as OpenCV defines it."""
        return float(np.sqrt(2.0 * self.rss / max(self.network.scalars, 1)))


def adjust(
    network: Network,
    start: State[LensT],
    *,
    warp: bool = False,
    poses_only: bool = False,
    damping: float = 0.0,
) -> Adjusted[LensT]:
    """Find the minimum of the sum of squares next to the start.

    Args:
        network: observations; views without a used corner keep their poses.
        start: initial state; its model is the model of the result.
        warp: whether to adjust the board warp; otherwise it stays as in the start.
        poses_only: whether to keep lens and warp fixed.
        damping: initial damping. If parameters nearly cancel, an undamped first step leads far along their valley.

    Raises:
        CalibrationError: the start puts a point behind the camera, or the equations cannot be solved.
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
            # Back to undamped steps as soon as they succeed: near the minimum they converge quadratically.
            damping = 0.0 if damping <= FIRST_DAMPING else damping / 10
            if step.decrease <= SETTLED**2 * variance or crawled >= PATIENCE:
                break
        # At the minimum rounding alone can raise the cost; a step that promises nothing need not be tried shorter.
        elif step is not None and step.decrease <= 1e-12 * max(linear.rss, NOISE_FLOOR_PX**2):
            break
        else:
            damping = max(FIRST_DAMPING, damping * 10)
            if damping > LARGEST_DAMPING:
                break
    return Adjusted(network=network, state=state, linear=linear, free=free)


def reduce(linear: Linear, free: IntArray, damping: float = 0.0) -> Reduced:
    """Eliminate the poses from the normal equations.

    Args:
        linear: residuals and derivatives at a state.
        free: indices of the adjusted global columns.
        damping: Levenberg–Marquardt damping, relative to the diagonal.
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
    """Solve a symmetric system with parameters of very different scale (Jacobi scaling).

    Raises:
        CalibrationError: the system is singular.
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
    """A step: changes of the global parameters (g,) and of the poses (V, 6), and the predicted reduction in px²."""

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
    """Return the inverse of each pose's block; zero for a view without corners, which keeps its pose."""
    at = np.arange(blocks.shape[-1])
    scale = np.sqrt(blocks[:, at, at])
    dead = ~(scale > 0).all(axis=1)
    scale[dead] = 1.0
    unit = blocks / (scale[:, :, None] * scale[:, None, :])
    # Very small damping, so that one view with collinear corners does not make the whole solution fail.
    unit[:, at, at] += 1e-14
    unit[dead] = np.eye(len(at))
    inverse = np.linalg.inv(unit) / (scale[:, :, None] * scale[:, None, :])
    inverse[dead] = 0.0
    return np.asarray(inverse)


class ExtendedStep(Struct, frozen=True, kw_only=True, eq=False):
    """Predicted minimum with the additional parameters, to first order.

    Attributes:
        step: (g + k,) change of the solution's lens and warp parameters, then the additional parameters.
        inverse: (g + k, g + k) inverse of the normal matrix with the poses eliminated.
        gain: reduction of the sum of squares, px².
    """

    step: FloatArray
    inverse: FloatArray
    gain: float


def extended_step(
    adjusted: Adjusted[LensT], columns: Callable[[int], FloatArray], more: int, prior: float = np.inf
) -> ExtendedStep | None:
    """Free k additional parameters that are common to all views.

    Args:
        adjusted: the minimum without them.
        columns: function from a view's row to (2M, k) derivatives of its pixels by the parameters.
        more: k.
        prior: prior standard deviation of each parameter, about zero.

    Returns:
        The step; None if the views do not determine the parameters.
    """
    linear, free = adjusted.linear, adjusted.free
    size = len(free) + more
    matrix, right = np.zeros((size, size)), np.zeros(size)
    for row in np.flatnonzero(adjusted.network.used).tolist():
        seen = np.repeat(adjusted.network.seen[row], 2)
        both = np.concatenate([linear.by_global[row][:, free], columns(row) * seen[:, None]], axis=1)
        # Project out what the pose of the view can absorb.
        basis = np.linalg.qr(linear.by_pose[row])[0]
        both = both - basis @ (basis.T @ both)
        matrix += both.T @ both
        right += both.T @ linear.residuals[row]
    at = np.arange(len(free), size)
    matrix[at, at] += adjusted.variance / prior**2
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    if not (np.isfinite(matrix).all() and (scale > 0).all()):
        return None
    try:
        inverse = np.linalg.inv(matrix / np.outer(scale, scale)) / np.outer(scale, scale)
    except np.linalg.LinAlgError:
        return None
    step = inverse @ right
    return ExtendedStep(step=step, inverse=(inverse + inverse.T) / 2, gain=max(float(right @ step), 0.0))
