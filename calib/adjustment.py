"""Adjustment of a camera or rig, the board warp and all poses together; each pose affects only its own view."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final, Generic

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray, IntArray
from calibrary.calib.least_squares import (
    MEANINGLESS,
    Linear,
    Minimum,
    Search,
    Step,
    inverted,
    minimised,
    unit,
)
from calibrary.calib.network import LensT, Network, State, linearise, turned
from calibrary.calibration import Covariance
from calibrary.errors import CalibrationError
from calibrary.records import replace

SEARCH: Final = Search(most_steps=40, first_damping=1e-4, no_damping=1e-4, crawl=1e-7, patience=3)
CULPRIT: Final = 0.3
"""Smallest share of a parameter in the weakest combination that is named; the squares of all add up to one."""
UNDETERMINED: Final = (
    "the views do not determine all parameters: tilt the board in several directions and fill the frame"
)
MOST_AT_ONCE: Final = 10_000
"""Corners whose columns are extended together."""


class Adjusted(Minimum, Generic[LensT], frozen=True, kw_only=True, eq=False):
    """A minimum, with the observations of the adjustment and the parameters there."""

    network: Network
    state: State[LensT]


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
    linear = known.linear if known is not None and is_known else linearise(network, start)
    if linear is None:
        raise CalibrationError("the starting values put part of a board behind the camera")

    def moved(state: State[LensT], step: Step) -> State[LensT] | None:
        values = np.concatenate([state.parameters, state.warp])
        values[free] += step.shared
        if len(free) and not state.model.is_possible(values[:size]):
            return None
        return replace(
            state,
            parameters=values[:size],
            warp=values[size:],
            rotations=turned(state.rotations, step.gone[:, :3]),
            translations=state.translations + step.gone[:, 3:],
        )

    state, linear = minimised(
        start, linear, partial(linearise, network), moved, free, SEARCH, damping=damping
    )
    return Adjusted(network=network, state=state, linear=linear, free=free)


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
            [linear.shared[some, :, : len(adjusted.free)], columns(some) * seen[..., None]], axis=-1
        )
        flat = without_poses(linear, some, both).reshape(-1, size)
        matrix += flat.T @ flat
        right += flat.T @ linear.residuals[some].ravel()
    at = np.arange(len(adjusted.free), size)
    matrix[at, at] += adjusted.variance / prior**2
    if (scaled := unit(matrix)) is None:
        return None
    try:
        inverse = np.linalg.inv(scaled[0]) / np.outer(scaled[1], scaled[1])
    except np.linalg.LinAlgError:
        return None
    step = inverse @ right
    return ExtendedStep(step=step, inverse=(inverse + inverse.T) / 2, gain=max(float(right @ step), 0.0))


def without_poses(linear: Linear, rows: IntArray | BoolArray, columns: FloatArray) -> FloatArray:
    """Project out of columns, (R, 2M, k), of some views what the poses of the views can absorb."""
    basis = np.linalg.qr(linear.gone[rows])[0]
    return np.asarray(columns - basis @ (basis.transpose(0, 2, 1) @ columns))


def lens_covariance(adjusted: Adjusted) -> Covariance:
    """Return the covariance of the lens parameters from the corners, with poses and warp marginalised.

    Its diagonal agrees with the standard deviations of ``cv2.calibrateCameraExtended`` (correct since OpenCV 4.8.1, too
    large by a factor of 1.46 in 4.6 and 4.7). It contains corner noise only. The effects of a bent board, a rolling
    shutter or an unsuitable model appear only in :mod:`calibrary.calib.variance_factor`.

    Raises:
        CalibrationError: the corners do not determine the parameters.
    """
    return Covariance.from_matrix(adjusted.state.model.parameters, parameter_covariance(adjusted))


def parameter_covariance(adjusted: Adjusted[LensT]) -> FloatArray:
    """Return the covariance, (n, n), of the parameters of a lens or a rig.

    Raises:
        CalibrationError: the corners do not determine the parameters.
    """
    lens = slice(len(adjusted.state.parameters))
    return np.asarray(adjusted.variance * inverted(adjusted.reduced.matrix, UNDETERMINED)[lens, lens])


def culprits(adjusted: Adjusted) -> tuple[str, ...]:
    """Return the parameters of the combination that the views determine worst, the largest share first."""
    matrix = adjusted.reduced.matrix
    scale = np.maximum(np.sqrt(np.maximum(np.diag(matrix), 0.0)), MEANINGLESS)
    _, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    names = (*adjusted.state.model.parameters, "warp across", "warp down")
    shares = sorted(zip(names, np.abs(vectors[:, 0]).tolist(), strict=False), key=lambda one: -one[1])
    return tuple(name for name, share in shares if share > CULPRIT)
