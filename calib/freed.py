"""One step of Gauss and Newton with more parameters than a solution has: what a larger model would make of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted
from calibrary.calib.network import LensT

__all__ = ["Freed", "freed"]


class Freed(Struct, frozen=True, kw_only=True, eq=False):
    """Where the minimum would be, to first order.

    Attributes:
        step: (g + k,) of the solution's lens and warp, then of the further parameters.
        inverse: (g + k, g + k) of the normal matrix, poses eliminated.
        gain: px² by which the sum of squares would fall.
    """

    step: FloatArray
    inverse: FloatArray
    gain: float


def freed(
    adjusted: Adjusted[LensT], columns: Callable[[int], FloatArray], more: int, prior: float = np.inf
) -> Freed | None:
    """Let k further parameters free that are the same in every view.

    Args:
        adjusted: the minimum without them.
        columns: (2M, k) derivatives of a view's pixels by them, by the view's row.
        more: k.
        prior: standard deviation of each of them about zero.

    Returns:
        None where the views do not determine them.
    """
    linear, free = adjusted.linear, adjusted.free
    size = len(free) + more
    matrix, right = np.zeros((size, size)), np.zeros(size)
    for row in np.flatnonzero(adjusted.network.used).tolist():
        seen = np.repeat(adjusted.network.seen[row], 2)
        both = np.concatenate([linear.by_global[row][:, free], columns(row) * seen[:, None]], axis=1)
        # Less what the view's own pose can do.
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
    return Freed(step=step, inverse=(inverse + inverse.T) / 2, gain=max(float(right @ step), 0.0))
