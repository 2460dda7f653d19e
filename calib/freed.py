"""One Gauss–Newton step with additional parameters: the first-order effect of a larger model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted
from calibrary.calib.network import LensT

__all__ = ["Freed", "freed"]


class Freed(Struct, frozen=True, kw_only=True, eq=False):
    """Predicted minimum with the additional parameters, to first order.

    Attributes:
        step: (g + k,) change of the solution's lens and warp parameters, then the additional parameters.
        inverse: (g + k, g + k) inverse of the normal matrix with the poses eliminated.
        gain: reduction of the sum of squares, px².
    """

    step: FloatArray
    inverse: FloatArray
    gain: float


def freed(
    adjusted: Adjusted[LensT], columns: Callable[[int], FloatArray], more: int, prior: float = np.inf
) -> Freed | None:
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
    return Freed(step=step, inverse=(inverse + inverse.T) / 2, gain=max(float(right @ step), 0.0))
