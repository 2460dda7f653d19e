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

from calibrary.arrays import BoolArray, FloatArray, IntArray
from calibrary.calib.network import LensT, Linear, Network, State, linearise, turned
from calibrary.errors import CalibrationError
from calibrary.records import replace

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
MOST_AT_ONCE = 10_000
"""Corners whose columns are extended together."""


class Reduced(Struct, frozen=True, kw_only=True, eq=False):
    """Normal equations after elimination of the poses.

    Attributes:
        by_view: (V, g, g) Schur complement of each view.
        right_by_view: (V, g) right-hand sides.
        from_poses: (V,) reduction of the sum of squares by the poses alone, px².
        pose_inverse: (V, 6, 6) inverses of the poses' diagonal blocks.
        coupling: (V, g, 6) blocks between global parameters and poses.
        pose_right: (V, 6) right-hand sides of the poses.
    """

    by_view: FloatArray
    right_by_view: FloatArray
    from_poses: FloatArray
    pose_inverse: FloatArray
    coupling: FloatArray
    pose_right: FloatArray

    @property
    def matrix(self) -> FloatArray:
        """Sum of the views, (g, g)."""
        return np.asarray(self.by_view.sum(axis=0))

    @property
    def right(self) -> FloatArray:
        """Sum of the views, (g,)."""
        return np.asarray(self.right_by_view.sum(axis=0))


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
    known: Adjusted[LensT] | None = None,
) -> Adjusted[LensT]:
    """Find the minimum of the sum of squares next to the start.

    Args:
        network: observations; views without a used corner keep their poses.
        start: initial state; its model is the model of the result.
        warp: whether to adjust the board warp; otherwise it stays as in the start.
        poses_only: whether to keep lens and warp fixed.
        damping: initial damping. If parameters nearly cancel, an undamped first step leads far along their valley.
        known: an adjustment that may have ended at the start, with the same corners.

    Raises:
        CalibrationError: the start puts a point behind the camera, or the equations cannot be solved.
    """
    size = len(start.parameters)
    free = np.arange(0 if poses_only else size + (2 if warp else 0))
    is_known = known is not None and known.state is start and known.network is network
    state, linear = start, known.linear if known is not None and is_known else linearise(network, start)
    if linear is None:
        raise CalibrationError("the starting values put part of a board behind the camera")
    crawled = 0
    for _ in range(MAX_STEPS):
        step = _step(linear, free, damping)
        # At the minimum rounding alone can raise the cost; a step that promises nothing need not be tried.
        if step is not None and step.decrease <= 1e-12 * max(linear.rss, NOISE_FLOOR_PX**2):
            break
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
    columns, by_pose, residuals = linear.columns(len(free)), linear.by_pose, linear.residuals[..., None]
    transposed = by_pose.transpose(0, 2, 1)
    inverse = _inverses(_damped(transposed @ by_pose, damping))
    coupling = columns.transpose(0, 2, 1) @ by_pose
    pose_right = transposed @ residuals
    by_view = _damped(columns.transpose(0, 2, 1) @ columns, damping)
    carried = coupling @ inverse
    by_view -= carried @ coupling.transpose(0, 2, 1)
    right = columns.transpose(0, 2, 1) @ residuals - carried @ pose_right
    return Reduced(
        by_view=(by_view + by_view.transpose(0, 2, 1)) / 2,
        right_by_view=right[..., 0],
        from_poses=(pose_right.transpose(0, 2, 1) @ inverse @ pose_right)[:, 0, 0],
        pose_inverse=inverse,
        coupling=coupling,
        pose_right=pose_right[..., 0],
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
    right = reduced.right
    try:
        by = scaled_solve(reduced.matrix, right) if len(free) else np.zeros(0)
    except CalibrationError:
        return None
    left = reduced.pose_right - by @ reduced.coupling
    poses = (reduced.pose_inverse @ left[..., None])[..., 0]
    decrease = float(reduced.from_poses.sum() + right @ by)
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
    adjusted: Adjusted[LensT], columns: Callable[[IntArray], FloatArray], more: int, prior: float = np.inf
) -> ExtendedStep | None:
    """Free k additional parameters that are common to all views.

    Args:
        adjusted: the minimum without them.
        columns: function from rows of views, (R,), to (R, 2M, k) derivatives of their pixels by the parameters.
        more: k.
        prior: prior standard deviation of each parameter, about zero.

    Returns:
        The step; None if the views do not determine the parameters.
    """
    linear, network, size = adjusted.linear, adjusted.network, len(adjusted.free) + more
    matrix, right = np.zeros((size, size)), np.zeros(size)
    rows = np.flatnonzero(network.used)
    for some in np.array_split(rows, 1 + network.seen[rows].size // MOST_AT_ONCE):
        seen = np.repeat(network.seen[some], 2, axis=1)
        both = np.concatenate(
            [linear.columns(len(adjusted.free))[some], columns(some) * seen[..., None]], axis=-1
        )
        flat = without_poses(linear, some, both).reshape(-1, size)
        matrix += flat.T @ flat
        right += flat.T @ linear.residuals[some].ravel()
    at = np.arange(len(adjusted.free), size)
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


def without_poses(linear: Linear, rows: IntArray | BoolArray, columns: FloatArray) -> FloatArray:
    """Project out of columns, (R, 2M, k), of some views what the poses of the views can absorb."""
    basis = np.linalg.qr(linear.by_pose[rows])[0]
    return np.asarray(columns - basis @ (basis.transpose(0, 2, 1) @ columns))
