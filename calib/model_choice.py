"""Choice of the lens model, and the test for a board warp.

Models are compared by n·ln(rss/n) + c·k with n measured coordinates and k parameters. Schwarz's criterion, c = ln n
(G. Schwarz, "Estimating the dimension of a model", 1978), selects the most probable model, but a term that it omits
may still shift the image's edge by five standard deviations. Here omitted effects are worse than additional
parameters, so c = 5.4: noise alone justifies three more parameters once in a thousand times. The additional terms of
the rational model are all radial, so for it this is the test for a remaining radial pattern in the residuals. The two
warp parameters are tested by an F-test instead, because a warped board is not a property of the camera.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted, adjust
from calibrary.calib.least_squares import condition, reduce, unit
from calibrary.calib.lens_change import as_model, widest_angle
from calibrary.calib.lens_models import Solvable
from calibrary.calib.lens_series import missed_terms
from calibrary.calib.network import LensT, linearise
from calibrary.calibration import ImageSize
from calibrary.errors import CalibrationError, InputError
from calibrary.probability import f_tail
from calibrary.records import Record, replace

PENALTY: Final = 5.4
"""Per parameter: χ² of three exceeds 16.3 with p = 0.001."""
CLEARLY: Final = 10.0
"""A refused model is reported as better only if its criterion is lower by at least this."""
WARP_LEVEL: Final = 0.01
WORST_CONDITION: Final = 1e8
WORST_RATIONAL: Final = 1e13
"""Numerator and denominator nearly cancel in every rational lens, like ξ and k1 in Mei's model, without an effect on
pixels; above this condition number, float64 has no significant digits left."""
CAREFUL: Final = 1.0
"""Damping of the first steps in a lens model with nearly cancelling terms."""
MISSED_TERMS: Final = 21.1
"""χ² of three exceeded by noise once in ten thousand times; the missing terms of a fisheye polynomial (next term and
decentering) must exceed it before the sphere models are tried."""
FIRST_ORDER_SHARE: Final = 0.5
"""A larger model is tried if the first-order prediction reaches this share of the required improvement."""
FISHEYE_FROM_RAD: Final = math.radians(40)
"""Closer to the axis, the perspective and the fisheye polynomials are equivalent."""


class Candidate(Record):
    """A lens model that was tried.

    Attributes:
        model: name of the model.
        rms_px: RMS of its residuals, px.
        criterion: n·ln(rss/n) + 5.4·k; only differences are meaningful.
        condition: condition of the scaled normal matrix of the lens; None if it is singular.
        refused: reason why it may not be chosen; None if it may.
    """

    model: Solvable
    rms_px: float
    criterion: float
    condition: float | None
    refused: str | None = None


class RivalLens(Struct, frozen=True, kw_only=True, eq=False):
    """A lens of another model that explains the observations as well as the chosen one, or nearly.

    Attributes:
        model: lens model.
        parameters: (n,) in its order.
        beside: (m,) those of the chosen lens that it was compared with.
        weight: how plausible it is beside that one, from 1 (as plausible, or more) to 0.
    """

    model: Solvable
    parameters: FloatArray
    beside: FloatArray
    weight: float


class WarpTest(Struct, frozen=True, kw_only=True):
    """Test for a board warp.

    Attributes:
        f: F statistic with 2 and ``dof`` degrees of freedom.
        dof: degrees of freedom of the larger model.
        p: probability of such an F without a warp.
        warp_mm: estimated warp in mm.
    """

    f: float
    dof: int
    p: float
    warp_mm: tuple[float, float]

    @property
    def keeps_warp(self) -> bool:
        """Whether the warp is significant (p < 0.01)."""
        return self.p < WARP_LEVEL


def best_model(
    current: Adjusted, image_size: ImageSize, models: Sequence[Solvable], *, warp: bool
) -> tuple[Adjusted, tuple[Candidate, ...]]:
    """Choose the lens model with the lowest criterion.

    Args:
        current: a good adjustment with any of the models.
        image_size: (width, height) px.
        models: models to choose from; a single one is still checked.
        warp: whether the board warp is also adjusted.

    Raises:
        CalibrationError: no model can be adjusted.
    """
    tried: list[tuple[Candidate, Adjusted]] = []
    # Larger models last: each starts from a smaller one, and is tried only if that leaves something to explain.
    for model in sorted(models, key=lambda m: (m is Solvable.RATIONAL, m.is_sphere, len(m.parameters))):
        # Start from models already tried, which may be closer than the current one.
        before = [adjusted for _, adjusted in tried]
        kin = [one for one in before if one.state.model.is_omnidirectional is model.is_omnidirectional]
        nearest = min(kin, key=lambda adjusted: adjusted.rss, default=current)
        if kin and (
            not _pays(nearest, model, warp=warp)
            if model is Solvable.RATIONAL
            else model.is_sphere and missed_terms(nearest) < MISSED_TERMS
        ):
            continue
        found = []
        for begin in _beginnings(nearest, before, model, warp=warp):
            careful = model.is_sphere or model is Solvable.RATIONAL
            with suppress(CalibrationError):
                found.append(
                    adjust(
                        current.network,
                        as_model(begin.state, model, widest_angle(begin)),
                        warp=warp,
                        damping=CAREFUL if careful and begin.state.model is not model else 0.0,
                        known=begin,
                    )
                )
        if found:
            adjusted = min(found, key=lambda one: one.rss)
            tried.append((_candidate(adjusted, image_size), adjusted))
    candidates = tuple(candidate for candidate, _ in tried)
    if not tried:
        raise CalibrationError(
            "no lens model fits these views at all: are they of this board, and of one camera?"
        )
    # If no model is determined, the simplest is used; the verdict states the problem of the views.
    allowed = [pair for pair in tried if pair[0].refused is None] or tried[:1]
    return min(allowed, key=lambda pair: pair[0].criterion)[1], candidates


def calmer(
    candidates: Sequence[Candidate], chosen: Solvable, kappa2: float
) -> tuple[Solvable, tuple[Candidate, ...]] | None:
    """Return a polynomial that explains the corners as well as the rational lens that was chosen; None if none does.

    Where views contradict one another, χ² counts κ² times too much (QAIC: Lebreton et al., 1992), and what the rational
    lens has gained is theirs. Its numerator and denominator then cancel, and it runs away where no corner was seen.

    Args:
        candidates: those that were compared.
        chosen: the best of them.
        kappa2: variance factor of the chosen one.

    Returns:
        The polynomial, and the candidates with the reason why the rational lens is not chosen.
    """
    if chosen is not Solvable.RATIONAL:
        return None

    def weighed(one: Candidate) -> float:
        terms = PENALTY * len(one.model.parameters)
        return (one.criterion - terms) / kappa2 + terms

    best = min((one for one in candidates if one.refused is None and not one.model.is_sphere), key=weighed)
    if best.model is chosen:
        return None
    why = f"gains less than the views contradict one another: variance factor {kappa2:.1f}"
    return best.model, tuple(replace(one, refused=why) if one.model is chosen else one for one in candidates)


def _beginnings(
    nearest: Adjusted, before: Sequence[Adjusted], model: Solvable, *, warp: bool
) -> Iterator[Adjusted]:
    """Yield start values for the adjustment of a model.

    From a perspective polynomial, the path to a strong rational lens is a long valley; a fisheye starts at its end.
    """
    yield nearest
    if model is not Solvable.RATIONAL or widest_angle(nearest) < FISHEYE_FROM_RAD:
        return
    wide = [one for one in before if one.state.model.is_omnidirectional]
    if not wide:
        with suppress(CalibrationError):
            wide.append(adjust(nearest.network, as_model(nearest.state, Solvable.FISHEYE), warp=warp))
    yield from sorted(wide, key=lambda one: one.rss)[:1]


def warp_test(near: Adjusted[LensT]) -> tuple[WarpTest, Adjusted[LensT], Adjusted[LensT]]:
    """Adjust without and with the board warp, and compare the two.

    Returns:
        The test, the adjustment with the flat board, and the one with the warp.

    Raises:
        CalibrationError: the warp is not determined.
    """
    level = replace(near.state, warp=np.zeros(2)) if near.state.warp.any() else near.state
    flat = adjust(near.network, level, known=near)
    warped = adjust(near.network, near.state, warp=True, known=near)
    f, p = f_test(flat.rss, warped.rss, 2, warped.dof)
    w0, w1 = warped.state.warp.tolist()
    return WarpTest(f=f, dof=warped.dof, p=p, warp_mm=(w0, w1)), flat, warped


def with_warp(near: Adjusted[LensT]) -> tuple[WarpTest | None, Adjusted[LensT]]:
    """Return the test, and the adjustment that it keeps; None and ``near`` if the warp is not determined."""
    try:
        tested, flat, warped = warp_test(near)
    except CalibrationError:
        return None, near
    return tested, warped if tested.keeps_warp else flat


def f_test(rss: float, rss_with: float, extra: int, dof_with: int) -> tuple[float, float]:
    """Return (F, p) for ``extra`` more parameters that reduce the sum of squares from ``rss`` to ``rss_with``."""
    if dof_with <= 0 or extra <= 0:
        return 0.0, 1.0
    f = max(rss - rss_with, 0.0) / extra / max(rss_with / dof_with, 1e-300)
    return f, f_tail(extra, dof_with, f)


def sound_share(adjusted: Adjusted, image_size: ImageSize) -> tuple[float, float]:
    """Return the share of the image where each pixel has one ray: within the area of the corners, and overall.

    A lens is judged where corners were seen; outside, especially beyond a fisheye's image circle, it is extrapolated.
    """
    state = adjusted.state
    return _sound(state.model, state.parameters, adjusted.network.pixels[adjusted.network.seen], image_size)


def _sound(model: Solvable, K: FloatArray, pixels: FloatArray, image_size: ImageSize) -> tuple[float, float]:
    width, height = image_size
    values = dict(zip(model.parameters, K.tolist(), strict=True))
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(0, width, 17), np.linspace(0, height, 13)))
    reach = float(np.hypot(pixels[:, 0] - K[2], pixels[:, 1] - K[3]).max(initial=0.0))
    covered = np.asarray(np.hypot(x - K[2], y - K[3]) <= reach, dtype=np.bool_)
    observed = np.column_stack([(x - K[2]) / K[0], (y - K[3]) / K[1]])
    try:
        rays = model.distortion(values).undistort_to_rays(observed)
    except InputError:
        return 0.0, 0.0
    sound = np.asarray(np.isfinite(rays).all(axis=1), dtype=np.bool_)
    return float(sound[covered].mean()) if covered.any() else 0.0, float(sound.mean())


def _pays(smaller: Adjusted, model: Solvable, *, warp: bool) -> bool:
    """Return whether a larger model can justify its parameters, predicted from the gradient.

    A model that cannot is not adjusted: the search would be long and end in a flat valley.
    """
    n, more = smaller.network.scalars, len(model.parameters) - len(smaller.state.parameters)
    linear = linearise(smaller.network, as_model(smaller.state, model))
    if linear is None:
        return False
    reduced = reduce(linear, np.arange(len(model.parameters) + (2 if warp else 0)))
    # The linear prediction can promise more than all residuals there are, whose logarithm would be meaningless.
    left = max(smaller.rss - promised_gain(reduced.matrix, reduced.right), 1e-3 * smaller.rss)
    return n * math.log(smaller.rss / left) > FIRST_ORDER_SHARE * more * PENALTY


def promised_gain(matrix: FloatArray, right: FloatArray) -> float:
    """Return the predicted reduction of the sum of squares, px², along the determined directions."""
    if (scaled := unit(matrix)) is None:
        return 0.0
    values, vectors = np.linalg.eigh(scaled[0])
    sure = values > values[-1] / WORST_CONDITION
    return float(((vectors.T @ (right / scaled[1]))[sure] ** 2 / values[sure]).sum())


def _candidate(adjusted: Adjusted, image_size: ImageSize) -> Candidate:
    n, k = adjusted.network.scalars, len(adjusted.free)
    criterion = n * math.log(max(adjusted.rss, 1e-300) / max(n, 1)) + PENALTY * k
    cond, pixels = condition(adjusted.reduced.matrix), adjusted.network.pixels[adjusted.network.seen]
    return Candidate(
        model=adjusted.state.model,
        rms_px=adjusted.rms_px,
        criterion=criterion,
        condition=cond if math.isfinite(cond) else None,
        refused=reason_unfit(adjusted.state.model, adjusted.state.parameters, cond, pixels, image_size),
    )


def reason_unfit(
    model: Solvable, parameters: FloatArray, cond: float, pixels: FloatArray, image_size: ImageSize
) -> str | None:
    """Return the reason why a lens model may not be chosen; None if it may.

    Args:
        model: lens model.
        parameters: parameters in its order.
        cond: condition of their scaled normal matrix.
        pixels: (N, 2) px of corners.
        image_size: (width, height) px.
    """
    if cond > (WORST_RATIONAL if model.trades_terms else WORST_CONDITION):
        return "these views do not determine its parameters"
    bends = model.is_omnidirectional or model is Solvable.RATIONAL
    if bends and _sound(model, parameters, pixels, image_size)[0] < 1:
        return "its distortion is not monotonic where corners were seen"
    return None
