"""Rejection of outlying views and corners by robust statistics."""

from __future__ import annotations

from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.adjustment import Adjusted, adjust
from calibrary.calib.network import LensT, Network, linearise
from calibrary.probability import two_digits
from calibrary.records import replace

NORMAL_MAD: Final = 1.4826
"""Ratio of the standard deviation to the median absolute deviation of a normal distribution."""
RAYLEIGH_MEDIAN: Final = 1.1774
"""Median length of a two-dimensional error with unit standard deviation per coordinate."""


class Gate(Struct, frozen=True, kw_only=True):
    """Limits for the rejection of outliers.

    Attributes:
        corner_sigmas: a corner is rejected if it deviates by more than this many standard deviations. Normal
            two-dimensional errors exceed 5.5 once in four million corners.
        corner_floor_px: corners with a smaller residual in px are never rejected.
        view_mads: a view is rejected if its RMS exceeds the median by this many (normalised) median absolute
            deviations.
        view_floor: a view's RMS must also exceed the median by this fraction.
        fewest_views: with fewer views, outliers cannot be identified.
        most_views: at most this fraction of the views is rejected, the worst first.
        most_corners: a view that would lose more than this fraction of its corners is judged as a whole.
    """

    corner_sigmas: float = 5.5
    corner_floor_px: float = 0.05
    view_mads: float = 3.5
    view_floor: float = 0.3
    fewest_views: int = 8
    most_views: float = 0.2
    most_corners: float = 0.1


def residual_lengths(adjusted: Adjusted[LensT]) -> FloatArray:
    """Return the residual length of each corner, (V, M) px."""
    shape = adjusted.network.seen.shape
    return np.asarray(np.linalg.norm(adjusted.linear.residuals.reshape(*shape, 2), axis=-1))


def view_rms(adjusted: Adjusted[LensT]) -> FloatArray:
    """Return the RMS residual length of each view, (V,) px; NaN if no corner is used."""
    lengths, seen = residual_lengths(adjusted), adjusted.network.seen
    counts = seen.sum(axis=1)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt((lengths**2 * seen).sum(axis=1) / counts))


def screened(everything: Network, adjusted: Adjusted, gate: Gate) -> BoolArray:
    """Return which corners to use, (V, M), evaluated anew for all corners with the current camera.

    Args:
        everything: all views with all their corners.
        adjusted: a camera estimated from some of them.
        gate: limits.
    """
    posed = adjust(everything, adjusted.state, poses_only=True)
    seen = _without_corners(posed, gate)
    if (seen != everything.seen).any():
        # An outlier has biased its view's pose, and so its neighbours' residuals: judge them again without it.
        refitted = adjust(everything.only(seen), posed.state, poses_only=True)
        linear = linearise(everything, refitted.state)
        if linear is not None:
            seen = _without_corners(replace(posed, state=refitted.state, linear=linear), gate)
        posed = adjust(everything.only(seen), posed.state, poses_only=True)
    return _without_views(posed, gate)


def _without_corners(adjusted: Adjusted, gate: Gate) -> BoolArray:
    seen, lengths = adjusted.network.seen, residual_lengths(adjusted)
    overall = float(np.median(lengths[seen])) / RAYLEIGH_MEDIAN
    ordered, counts = np.sort(np.where(seen, lengths, np.inf), axis=1), seen.sum(axis=1)
    middle = np.stack([np.maximum(counts - 1, 0) // 2, counts // 2 * (counts > 1)], axis=1)
    own = np.where(counts > 0, np.take_along_axis(ordered, middle, axis=1).mean(axis=1), 0.0)
    # A blurred view has more noise than the others; this alone does not make its corners outliers.
    sigma = np.maximum(own / RAYLEIGH_MEDIAN, overall)
    limit = np.maximum(gate.corner_sigmas * sigma, gate.corner_floor_px)
    bad = seen & (lengths > limit[:, None])
    # That many are no outliers among good corners: the view itself is bad, and is judged as a whole next.
    too_many = bad.sum(axis=1) > gate.most_corners * seen.sum(axis=1)
    bad[too_many] = False
    return np.asarray(seen & ~bad)


def _without_views(adjusted: Adjusted, gate: Gate) -> BoolArray:
    seen, rms = adjusted.network.seen.copy(), view_rms(adjusted)
    rows = np.flatnonzero(adjusted.network.used)
    if len(rows) < gate.fewest_views:
        return seen
    middle = float(np.median(rms[rows]))
    spread = NORMAL_MAD * float(np.median(np.abs(rms[rows] - middle)))
    # Where all views fit alike the spread is almost zero, and by it alone any view would be an outlier.
    limit = max(middle + gate.view_mads * spread, middle * (1 + gate.view_floor))
    worst = rows[np.argsort(-rms[rows])][: int(gate.most_views * len(rows))]
    seen[[row for row in worst if rms[row] > limit]] = False
    return seen


def in_px(length: float) -> str:
    """Return a residual in words; one of a solve that went astray has any number of digits."""
    return f"{length:.2f} px" if length < 1000 else f"{two_digits(length)} px"
