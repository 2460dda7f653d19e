"""Uncertainty of a rig in pixels: of a point seen by one camera and predicted in another."""

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
"""Multiple of the board distance that stands for infinity."""


def cross_std_px(
    adjusted: Adjusted[RigLens],
    covariance: FloatArray,
    camera: int,
    sizes: tuple[ImageSize, ImageSize],
    distance_mm: float,
) -> float | None:
    """Return σ of the predicted pixel in a camera for a point seen by the reference camera (RMS over the overlap), px.

    Args:
        adjusted: the rig.
        covariance: (n, n) covariance of its parameters.
        camera: index of the camera, not the reference.
        sizes: (width, height) px of the reference camera and of this one.
        distance_mm: distance of the point along the reference camera's axis, mm.

    Returns:
        The standard deviation; None if the two have no common field of view at this distance.
    """
    state, lens = adjusted.state, adjusted.state.model
    values = state.parameters
    first, second = lens.lens_of(0), lens.lens_of(camera)
    points = _seen(lens, values[first], sizes[0], distance_mm)
    place = lens.place(values, camera)
    inside = points @ place.rotation.T + place.translation
    points, inside = points[inside[:, 2] > 0], inside[inside[:, 2] > 0]
    pixels = lens.models[camera].project(values[second], inside)[0]
    # A lens is extrapolated outside its image, where nothing can be seen.
    there = ((pixels > 0) & (pixels < sizes[1])).all(axis=1)
    if not there.any():
        return None
    points, inside = points[there], inside[there]
    _, by_own, by_point = lens.models[0].project(values[first], points)
    # The point keeps its pixel and depth in the reference camera when that camera's lens changes.
    moved = -np.linalg.solve(by_point[:, :, :2], by_own)
    _, by_lens, by_inside = lens.models[camera].project(values[second], inside)
    slope = np.zeros((len(points), 2, len(values)))
    slope[:, :, second] = by_lens
    slope[:, :, first] += (by_inside @ place.rotation)[:, :, :2] @ moved
    at, one = lens.place_of(camera), replace(lens, corners=1)
    with np.errstate(all="ignore"):
        # Other cameras may not see the point; their blocks are ignored.
        everywhere = one.project(values, np.repeat(points[:, None], len(lens.names), axis=1))[1]
    by_place = everywhere[:, camera, :, at] * lens.noise_px[camera]
    slope[:, :, at] = by_place
    variance = np.einsum("nip,pq,niq->ni", slope, covariance, slope).sum(axis=1)
    return float(np.sqrt(max(float(variance.mean()), 0.0)))


def _seen(lens: RigLens, values: FloatArray, size: ImageSize, distance_mm: float) -> FloatArray:
    """Return points on a plane across the reference camera's axis, (N, 3) mm, seen over its whole image."""
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
