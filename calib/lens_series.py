"""What the lens model's own series leaves out: its next radial term, and by how much it would bend the frame.

Full Brown ends with r⁷, Kannala and Brandt's with θ⁹. A lens does not end there. Where corners were seen the next term
shows in the residuals; beyond them, in the frame's corners, nothing does, and there it matters most.
"""

from __future__ import annotations

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted
from calibrary.calib.freed import freed
from calibrary.calib.lens_models import Solvable
from calibrary.calibration import ImageSize
from calibrary.errors import InputError

__all__ = ["series_shift"]

GRID = (17, 13)
SHRUNK = 1.0
"""z² up to which the term counts for nothing; a larger one counts for 1 − 1/z² of itself."""


def series_shift(adjusted: Adjusted, image_size: ImageSize, inflation: float = 1.0) -> FloatArray | None:
    """(n,) the change of the model's own parameters that bends the frame as its next term would.

    The frame as far out as corners were seen: further out the next term grows without anything to hold it.

    Args:
        adjusted: the solution.
        image_size: (width, height) px.
        inflation: of the variances, as the halves of the views show it.

    Returns:
        None for a model that has no next term here (those leaner than Brown are asked for by name, the rational one has
        three terms more), or where it cannot be told.
    """
    state = adjusted.state
    if state.model not in {Solvable.BROWN, Solvable.FISHEYE}:
        return None
    found = freed(adjusted, lambda row: _next_term(adjusted, _inside(adjusted, row)), 1)
    if found is None or not found.inverse[-1, -1] > 0:
        return None
    z2 = found.step[-1] ** 2 / (found.inverse[-1, -1] * adjusted.variance * inflation)
    # A term that is mere noise is none: taken whole it would make every frame's corners uncertain (James and Stein).
    step = found.step * max(0.0, 1.0 - SHRUNK / max(z2, 1e-300))
    (width, height), K = image_size, state.parameters
    x, y = (
        grid.ravel() for grid in np.meshgrid(np.linspace(0, width, GRID[0]), np.linspace(0, height, GRID[1]))
    )
    values = dict(zip(state.model.parameters, K.tolist(), strict=True))
    try:
        rays = state.model.distortion(values).undistort_to_rays(
            np.column_stack([(x - K[2]) / K[0], (y - K[3]) / K[1]])
        )
    except InputError:
        return None
    pixels = adjusted.network.pixels[adjusted.network.seen]
    reach = np.hypot(pixels[:, 0] - K[2], pixels[:, 1] - K[3]).max()
    rays = rays[np.isfinite(rays).all(axis=1) & (np.hypot(x - K[2], y - K[3]) <= reach)]
    if 2 * len(rays) < len(K) + 3:
        return None
    _, by_lens, by_point = state.model.project(K, rays)
    size = len(K)
    bent = by_lens.reshape(-1, size) @ step[:size] + _next_term(adjusted, rays)[:, 0] * step[-1]
    turn = np.stack([np.cross(axis, rays) for axis in np.eye(3)], axis=-1)
    both = np.concatenate([by_lens, by_point @ turn], axis=-1).reshape(len(bent), -1)
    scale = np.linalg.norm(both, axis=0)
    return np.asarray((np.linalg.lstsq(both / scale, bent, rcond=None)[0] / scale)[:size])


def _inside(adjusted: Adjusted, row: int) -> FloatArray:
    """(M, 3) a view's points before the camera."""
    network, state = adjusted.network, adjusted.state
    points = network.points[row].copy()
    points[:, 2] += network.warp_shape[row] @ state.warp
    return np.asarray(points @ state.rotations[row].T + state.translations[row])


def _next_term(adjusted: Adjusted, points: FloatArray) -> FloatArray:
    """(2N, 1) ∂px by the coefficient of r⁹ or θ¹¹ for (N, 3) points before the camera."""
    fx, fy = adjusted.state.parameters[:2]
    across = np.hypot(points[:, 0], points[:, 1])
    if adjusted.state.model is Solvable.FISHEYE:
        gain = np.arctan2(across, points[:, 2]) ** 11 / np.maximum(across, 1e-300)
    else:
        gain = (across / points[:, 2]) ** 8 / points[:, 2]
    return np.asarray((points[:, :2] * gain[:, None] * (fx, fy)).reshape(-1, 1))
