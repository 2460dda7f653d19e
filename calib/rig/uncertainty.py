"""What the joint covariance of a rig says where it matters: of a pixel that one camera predicts for another."""

from __future__ import annotations

from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted
from calibrary.calib.rig.lens import RigLens
from calibrary.calibration import ImageSize
from calibrary.records import replace

__all__ = ["cross_std_px"]

GRID: Final = (9, 7)
FAR: Final = 1e3
"""Times the distance of the boards: as good as infinity."""


def cross_std_px(
    adjusted: Adjusted[RigLens],
    covariance: FloatArray,
    camera: int,
    sizes: tuple[ImageSize, ImageSize],
    distance_mm: float,
) -> float | None:
    """px, root mean square over what both see: σ of where a camera sees a point that the reference camera sees.

    Args:
        adjusted: the rig.
        covariance: (n, n) of its parameters.
        camera: which, not the reference.
        sizes: (width, height) px of the reference camera and of this one.
        distance_mm: of the point along the reference camera's axis.

    Returns:
        None where the two see nothing in common at this distance.
    """
    state, lens = adjusted.state, adjusted.state.model
    values = state.parameters
    first, second = lens.lens_of(0), lens.lens_of(camera)
    points = _seen(lens, values[first], sizes[0], distance_mm)
    place = lens.place(values, camera)
    inside = points @ place.rotation.T + place.translation
    points, inside = points[inside[:, 2] > 0], inside[inside[:, 2] > 0]
    pixels = lens.models[camera].project(values[second], inside)[0]
    # Outside of its frame a lens is extrapolated, and there is nothing to be seen.
    there = ((pixels > 0) & (pixels < sizes[1])).all(axis=1)
    if not there.any():
        return None
    points, inside = points[there], inside[there]
    _, by_own, by_point = lens.models[0].project(values[first], points)
    # The point stays on its pixel of the reference camera when that camera's lens changes, at the same depth.
    moved = -np.linalg.solve(by_point[:, :, :2], by_own)
    _, by_lens, by_inside = lens.models[camera].project(values[second], inside)
    slope = np.zeros((len(points), 2, len(values)))
    slope[:, :, second] = by_lens
    slope[:, :, first] += (by_inside @ place.rotation)[:, :, :2] @ moved
    at, one = lens.place_of(camera), replace(lens, corners=1)
    with np.errstate(all="ignore"):
        # The other cameras may be blind to the point; their blocks are not looked at.
        everywhere = one.project(values, np.repeat(points[:, None], len(lens.names), axis=1))[1]
    by_place = everywhere[:, camera, :, at] * lens.noise_px[camera]
    slope[:, :, at] = by_place
    variance = np.einsum("nip,pq,niq->ni", slope, covariance, slope).sum(axis=1)
    return float(np.sqrt(max(float(variance.mean()), 0.0)))


def _seen(lens: RigLens, values: FloatArray, size: ImageSize, distance_mm: float) -> FloatArray:
    """(N, 3) mm on a plane across the reference camera's axis, seen all over its frame."""
    width, height = size
    x, y = np.meshgrid(np.linspace(0, width, GRID[0] + 2)[1:-1], np.linspace(0, height, GRID[1] + 2)[1:-1])
    model = lens.models[0]
    named = dict(zip(model.parameters, values.tolist(), strict=True))
    observed = np.column_stack(
        [(x.ravel() - named["cx"]) / named["fx"], (y.ravel() - named["cy"]) / named["fy"]]
    )
    rays = model.distortion(named).undistort_to_rays(observed)
    rays = rays[np.isfinite(rays).all(axis=1)]
    rays = rays[rays[:, 2] > 0.05]
    return np.asarray(rays / rays[:, 2:] * distance_mm)
