"""Uncertainty of the difference between two calibrations, and whether it explains the difference.

Only measured covariances of both can explain a difference. If one of two independent measurements has none,
it is assumed to be somewhat more uncertain than the other. If both have none, the typical uncertainty of
their grades is used, again only for independent measurements. Between two copies of one measurement there is
no noise.

Two tests are made, each at half the significance level. The first takes the largest difference over all
pixels in units of its standard deviation, and compares it with the distribution of this maximum under noise
(sampled from the propagated covariance, because neighbouring pixels are correlated). The second tests the
image scale, on which heights in a map depend.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.projection_difference import ProjectionDifference
from calibrary.calibration import Calibration, Covariance, Grade
from calibrary.jobs.diff.origin import Common, has_other_source
from calibrary.jobs.diff.priors import Spread
from calibrary.probability import normal_tails

__all__ = ["Basis", "Scale", "Significance", "basis_of", "covariances_of", "image_scale", "significance"]

FLOOR_PX: Final = 0.02
"""Smallest standard deviation assumed for a pixel, whatever the covariance states."""
DRAWS: Final = 2000
EVERY: Final = 2
"""Step on the grid for the sampling; the fields are smooth."""
TAIL: Final = 0.01
"""Probability at which the tail of the maximum's distribution is matched."""

BORROWED: Final = 1.5
"""Standard deviations assumed for a calibration that states none, as a multiple of the other's: calibration sessions
of one kind differ by this much."""

MEASURED_GRADES: Final = frozenset({Grade.CALIBRATED, Grade.ADJUSTED})


class Basis(StrEnum):
    """Basis of the uncertainty of a difference."""

    BOTH = "both state their uncertainty"
    ONE = "one states its uncertainty and the other is taken to be 1.5 times as uncertain"
    TYPICAL = "what calibrations of their grades are usually worth"
    NONE = "unknown: at least one states no uncertainty"
    COPY = "none: both hold one measurement"


class Scale(Struct, frozen=True, kw_only=True):
    """Change of the image scale between two projections.

    Attributes:
        change: relative, along x or y, whichever is larger; positive if B magnifies more.
        std: standard deviation of the change; None without a covariance.
    """

    change: float
    std: float | None


class Significance(Struct, frozen=True, kw_only=True):
    """Significance of a difference.

    Attributes:
        p: twice the smaller of the two tests' probabilities of such a difference from noise alone.
        explains: whether noise explains every part of the difference that matters.
    """

    p: float
    explains: bool


def basis_of(a: Calibration, b: Calibration, spreads: tuple[Spread, Spread], common: Common) -> Basis:
    """Basis of the uncertainty of the difference between two calibrations."""
    if common.is_one_measurement:
        return Basis.COPY
    measured = [spread.is_measured for spread in spreads]
    if all(measured):
        return Basis.BOTH
    if not has_other_source(a, b):
        return Basis.NONE
    if any(measured) and {a.grade, b.grade} <= MEASURED_GRADES:
        return Basis.ONE
    return Basis.TYPICAL


def covariances_of(basis: Basis, spreads: tuple[Spread, Spread]) -> tuple[Covariance, Covariance] | None:
    """Covariances of both calibrations according to the basis; None if there is no basis."""
    one, two = (spread.covariance for spread in spreads)
    if basis in {Basis.BOTH, Basis.TYPICAL}:
        return one, two
    if basis is Basis.ONE:
        # The propagation treats both models alike, so a multiple of one covariance represents both.
        both = 1 + BORROWED**2
        return (
            (_times(one, both), _times(two, 0.0))
            if spreads[0].is_measured
            else (_times(one, 0.0), _times(two, both))
        )
    return None


def image_scale(difference: ProjectionDifference) -> Scale:
    """Image scale along x and y fitted to the difference, each pixel weighted by its variance."""
    region = difference.region
    std = difference.std_px[region] if difference.std_px is not None else np.ones(int(region.sum()))
    known = 1 / (std**2 + FLOOR_PX**2)
    found = []
    for axis in (0, 1):
        at = difference.pixels[region][:, axis]
        weights = known * (at - np.average(at, weights=known))
        weights = weights / float(weights @ at)
        noise = difference.noise[region][:, axis] if difference.noise is not None else None
        found.append(
            Scale(
                change=float(weights @ difference.vectors[region][:, axis]),
                std=float(np.linalg.norm(weights @ noise)) if noise is not None else None,
            )
        )
    return max(found, key=lambda scale: abs(scale.change))


def significance(
    difference: ProjectionDifference, scale: Scale, *, level: float, matters_px: float, matters_scale: float
) -> Significance | None:
    """Compare a difference with its propagated noise.

    Args:
        difference: with noise.
        scale: of the same difference.
        level: significance level; noise is not an explanation below it.
        matters_px: pixels that differ by less need no explanation.
        matters_scale: a smaller change of scale needs no explanation.

    Returns:
        The significance; None without a covariance.
    """
    if difference.noise is None:
        return None
    whitening = _whitening(difference.noise)
    z = np.linalg.norm(np.einsum("rcij,rcj->rci", whitening, np.nan_to_num(difference.vectors)), axis=-1)
    z = np.where(difference.region, z, 0.0)
    tail = _tail(whitening @ difference.noise, difference.region)
    large: BoolArray = np.asarray(difference.region & (np.nan_to_num(difference.lengths_px) >= matters_px))
    by_pixel = min(1.0, tail * _rayleigh(float(z.max(initial=0.0))))
    of_large = min(1.0, tail * _rayleigh(float(z[large].max(initial=0.0))))
    by_scale = _two_sided(scale)
    pixels_explained = of_large >= level / 2
    scale_explained = by_scale >= level / 2 or abs(scale.change) < matters_scale
    return Significance(
        p=min(1.0, 2 * min(by_pixel, by_scale)), explains=pixels_explained and scale_explained
    )


def _two_sided(scale: Scale) -> float:
    if scale.std is None or scale.change == 0:
        return 1.0
    return normal_tails(scale.change / scale.std) if scale.std > 0 else 0.0


def _whitening(noise: FloatArray) -> FloatArray:
    """Whitening matrices W (R, C, 2, 2): WᵀW is the inverse of each pixel's covariance."""
    C = noise @ np.swapaxes(noise, -1, -2) + FLOOR_PX**2 * np.eye(2)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(C)))


def _tail(whitened: FloatArray, region: BoolArray) -> float:
    """Ratio of the probability that the maximum over all pixels exceeds a large z to that for a single pixel.

    Estimated by sampling at the z that the maximum exceeds with a probability of 1 %; it is nearly constant
    beyond.
    """
    rows = (slice(None, None, EVERY), slice(None, None, EVERY))
    inside = region[rows]
    if not inside.any():
        return 1.0
    noise = whitened[rows][inside]
    draws = np.random.default_rng(0).standard_normal((noise.shape[-1], DRAWS))
    fields = (noise.reshape(-1, noise.shape[-1]) @ draws).reshape(len(noise), 2, DRAWS)
    z = float(np.quantile(np.sqrt((fields**2).sum(axis=1).max(axis=0)), 1 - TAIL))
    return max(1.0, TAIL / max(_rayleigh(z), 1e-300))


def _rayleigh(z: float) -> float:
    """Probability that the length of a two-dimensional standard normal vector exceeds z."""
    return math.exp(-z * z / 2) if math.isfinite(z) else 0.0


def _times(covariance: Covariance, factor: float) -> Covariance:
    return Covariance.from_matrix(covariance.names, covariance.matrix * factor)
