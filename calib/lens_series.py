"""Truncation error of the lens model: its next radial term, and the effect of this term in the image.

The full Brown model ends with r⁷, the Kannala–Brandt model with θ⁹; real lenses do not. Where corners were seen, the
next term appears in the residuals. Beyond them, in the image corners, it does not, and there its effect is largest. So
the term has a prior of what real lenses do, and its posterior is part of the stated uncertainty: nearly nothing where
corners were seen, the whole prior where there were none.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.adjustment import Adjusted, ExtendedStep, extended_step, lens_covariance
from calibrary.calib.lens_models import Solvable
from calibrary.calibration import ImageSize
from calibrary.errors import CalibrationError, InputError

GRID: Final = (17, 13)
PRIOR_OF_DISTORTION: Final = 0.05
"""Prior standard deviation of the term in the image corner, as a share of the distortion there. In the lenses of
drones, Brown's terms decrease by a factor of four from one to the next; the fourth is then 1 to 2 % of their sum.
Lenses that need a rational model leave 4 %."""
LEAST_PRIOR: Final = 5e-4
"""Relative to the radius, for a lens with almost no distortion."""


def series_shift(adjusted: Adjusted, image_size: ImageSize, inflation: float = 1.0) -> FloatArray | None:
    """Return the change of the model's parameters, (n,), with the same effect in the image as its next term.

    The size of the term is its RMS value given the corners and the prior.

    Args:
        adjusted: the solution.
        image_size: (width, height) px.
        inflation: variance factor, from the comparison of halves of the views.

    Returns:
        The change; None if the model has no next term here (models smaller than Brown are chosen by name only), or the
        change is not determined.
    """
    found = _next_term_step(adjusted)
    try:
        covariance = lens_covariance(adjusted).matrix
    except CalibrationError:
        return None
    if found is None:
        return None
    state = adjusted.state
    return shift_of_term(
        state.model, state.parameters, found, covariance, adjusted.variance, image_size, inflation
    )


def shift_of_term(
    model: Solvable,
    K: FloatArray,
    found: ExtendedStep,
    covariance: FloatArray,
    variance: float,
    image_size: ImageSize,
    inflation: float,
) -> FloatArray | None:
    """Return the change of the model's parameters with the same effect in the image as the remaining next term.

    Args:
        model: lens model.
        K: (n,) parameters.
        found: step with the term as the last parameter and those of the lens first.
        covariance: (n, n) covariance of the lens parameters.
        variance: variance of one coordinate, px².
        image_size: (width, height) px.
        inflation: variance factor.

    Returns:
        The change; None if it is not determined.
    """
    width, height = image_size
    x, y = (
        grid.ravel() for grid in np.meshgrid(np.linspace(0, width, GRID[0]), np.linspace(0, height, GRID[1]))
    )
    values = dict(zip(model.parameters, K.tolist(), strict=True))
    observed = np.column_stack([(x - K[2]) / K[0], (y - K[3]) / K[1]])
    try:
        rays = model.distortion(values).undistort_to_rays(observed)
    except InputError:
        return None
    has_ray = np.isfinite(rays).all(axis=1)
    rays, observed = rays[has_ray], observed[has_ray]
    size = len(K)
    if 2 * len(rays) < size + 3:
        return None
    _, by_lens, by_point = model.project(K, rays)
    by_lens = by_lens.reshape(-1, size)
    term = next_term(model, K, rays).ravel()
    size_of_term = _remaining(
        found.step[-1],
        found.inverse[-1, -1] * variance * inflation,
        _prior(model, rays, observed, term, K),
    )
    # Change of the model's own parameters per unit of the term.
    given_way = found.inverse[:size, -1] / found.inverse[-1, -1]
    bend = (by_lens @ given_way + term) * size_of_term
    turn = np.stack([np.cross(axis, rays) for axis in np.eye(3)], axis=-1)
    both = np.concatenate([by_lens, (by_point @ turn).reshape(-1, 3)], axis=-1)
    # The model cannot reproduce the effect exactly; it has to be close where the effect or the noise is small.
    noise = np.einsum("ij,jk,ik->i", by_lens, covariance * inflation, by_lens)
    weight = 1.0 / np.sqrt(bend**2 + noise)
    weighed = both * weight[:, None]
    scale = np.linalg.norm(weighed, axis=0)
    if not (np.isfinite(weighed).all() and (scale > 0).all()):
        return None
    return np.asarray((np.linalg.lstsq(weighed / scale, bend * weight, rcond=None)[0] / scale)[:size])


def missed_terms(adjusted: Adjusted) -> float:
    """Return χ² (three degrees of freedom) of the next term and decentering, missing in a fisheye polynomial."""

    def columns(rows: IntArray) -> FloatArray:
        inside = _inside(adjusted, rows)
        fx, fy, cx, cy = adjusted.state.parameters[:4]
        pixels = adjusted.state.model.project(adjusted.state.parameters, inside)[0]
        x, y = (pixels[..., 0] - cx) / fx, (pixels[..., 1] - cy) / fy
        r2 = x * x + y * y
        p1 = np.stack([2 * x * y * fx, (r2 + 2 * y * y) * fy], axis=-1)
        p2 = np.stack([(r2 + 2 * x * x) * fx, 2 * x * y * fy], axis=-1)
        terms = next_term(adjusted.state.model, adjusted.state.parameters, inside)
        return np.stack([term.reshape(len(rows), -1) for term in (terms, p1, p2)], axis=-1)

    found = extended_step(adjusted, columns, 3)
    return 0.0 if found is None else found.gain / adjusted.variance


def _next_term_step(adjusted: Adjusted) -> ExtendedStep | None:
    state = adjusted.state
    if not state.model.next_power:
        return None
    found = extended_step(
        adjusted,
        lambda rows: next_term(state.model, state.parameters, _inside(adjusted, rows)).reshape(
            len(rows), -1, 1
        ),
        1,
    )
    return found if found is not None and found.inverse[-1, -1] > 0 else None


def _prior(model: Solvable, rays: FloatArray, observed: FloatArray, term: FloatArray, K: FloatArray) -> float:
    """Return the prior standard deviation of the term."""
    across = np.hypot(rays[:, 0], rays[:, 1])
    ideal = np.arctan2(across, rays[:, 2]) if model.is_omnidirectional else across / rays[:, 2]
    radius = np.linalg.norm(observed, axis=1)
    at = int(np.argmax(radius))
    share: float = max(PRIOR_OF_DISTORTION * abs(float(radius[at] / ideal[at]) - 1), LEAST_PRIOR)
    reach = float(np.abs(term.reshape(-1, 2)[at] / K[:2]).max())
    return share * float(radius[at]) / max(reach, 1e-300)


def _remaining(value: float, variance: float, prior: float) -> float:
    """Return the RMS of a value with a measurement variance and a prior about zero."""
    kept = prior**2 / (prior**2 + variance)
    return math.sqrt((kept * value) ** 2 + kept * variance)


def _inside(adjusted: Adjusted, rows: IntArray) -> FloatArray:
    """Return the points of some views in the camera frame, (R, M, 3) mm."""
    network, state = adjusted.network, adjusted.state
    points = network.points[rows]
    points[..., 2] += network.warp_shape[rows] @ state.warp
    return np.asarray(points @ state.rotations[rows].transpose(0, 2, 1) + state.translations[rows][:, None])


def next_term(model: Solvable, parameters: FloatArray, points: FloatArray) -> FloatArray:
    """Return ∂px by the coefficient of r⁹, or of a power of θ, (…, 2), for points in the camera frame, (…, 3)."""
    fx, fy = parameters[:2]
    across = np.hypot(points[..., 0], points[..., 1])
    if model.is_omnidirectional:
        theta = np.arctan2(across, points[..., 2])
        gain = theta**model.next_power / np.maximum(across, 1e-300)
    else:
        r2 = (across / points[..., 2]) ** 2
        gain = r2**4 / points[..., 2]
        if model is Solvable.RATIONAL:
            k4, k5, k6 = parameters[-3:]
            gain = gain / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return np.asarray(points[..., :2] * gain[..., None] * (fx, fy))
