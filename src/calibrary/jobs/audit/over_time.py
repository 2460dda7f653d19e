"""Test whether the focal length measured from pixels changed between dates: as a trend, or with the firmware.

The focal lengths, each with its own σ, are fitted by weighted least squares with three models: a constant, a
step at a change of firmware, a straight line over time. A change is reported only if it exceeds 3 σ, and as a
step or a drift only if that model fits (χ² test).

Reference: P. R. Bevington and D. K. Robinson, "Data Reduction and Error Analysis", chapters 4, 6 and 11.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import date
from enum import StrEnum
from itertools import pairwise
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.probability import chi_square_tail, normal_tails

__all__ = ["Change", "Measurement", "OverTime", "judge_over_time"]

SIGMAS: Final = 3.0
BY_CHANCE: Final = normal_tails(SIGMAS)
"""Significance level of a change: the probability that noise alone exceeds 3 σ."""
FITS: Final = 0.01
"""A step or a line fits if the probability of a larger χ² is at least this."""
FEWEST_DATES: Final = 2


class Change(StrEnum):
    """Kind of change of K over time; the value is the text shown to the user."""

    STEADY = "steady"
    DRIFT = "drifts"
    STEP = "changed with the firmware"
    UNSTEADY = "differs between dates"
    SEVERAL_UNITS = "differs, of unknown units"
    UNKNOWN = "cannot tell"


class Measurement(Struct, frozen=True, kw_only=True):
    """The focal length measured from the pixels of one date.

    Attributes:
        day: of the flight.
        fx: px.
        std: relative standard deviation.
        firmware: of the camera; None if not stated.
    """

    day: date
    fx: float
    std: float
    firmware: str | None = None


class OverTime(Struct, frozen=True, kw_only=True):
    """Result of the test over all dates.

    Attributes:
        change: kind of change.
        by: relative change of fx, last minus first; None if no change is reported.
        std: standard deviation of ``by``.
        reason: explanation in one sentence.
    """

    change: Change
    by: float | None = None
    std: float | None = None
    reason: str


class _Fit(Struct, frozen=True):
    """Fit of one model: relative change, its σ, and the probability of a larger χ²."""

    by: float
    std: float
    chance: float

    @property
    def is_one(self) -> bool:
        return abs(self.by) > SIGMAS * self.std and self.chance >= FITS


def judge_over_time(measurements: Sequence[Measurement], *, unit_known: bool) -> OverTime:
    """Judge the change of K over time.

    Args:
        measurements: of one camera at one image size.
        unit_known: whether the images state the serial number; if not, a change is not attributed to a unit.
    """
    ordered = sorted(measurements, key=lambda one: (one.day, one.fx))
    if len(ordered) < FEWEST_DATES:
        dates = "one date determines" if ordered else "no date determines"
        return OverTime(change=Change.UNKNOWN, reason=f"{dates} K, need {FEWEST_DATES}")
    values = np.log([one.fx for one in ordered])
    weights = np.array([1 / one.std**2 for one in ordered])
    days = np.array([one.day.toordinal() for one in ordered], dtype=np.float64)
    constant = _chance(values, weights, np.ones((len(ordered), 1)))
    line = _line(values, weights, days)
    steps = {at: _step(values, weights, at) for at in _firmware_changes(ordered)}
    between = f"between {ordered[0].day} and {ordered[-1].day} ({len(ordered)} dates)"
    at, step = max(steps.items(), key=lambda one: (one[1].is_one, one[1].chance), default=(0, None))
    changed = constant < BY_CHANCE or line.is_one or (step is not None and step.is_one)
    if not changed:
        spread = math.sqrt(1 / float(weights.sum()))
        return OverTime(change=Change.STEADY, reason=f"constant within its σ {between}, ± {spread:.2%}")
    widest = _widest(ordered)
    if not unit_known:
        return OverTime(
            change=Change.SEVERAL_UNITS,
            by=widest.by,
            std=widest.std,
            reason=f"fx differs by {_figures(widest)} {between}; the images state no serial number, so they may be of "
            "several units",
        )
    if step is not None and step.is_one and step.chance >= line.chance * line.is_one:
        before, after = ordered[at - 1].firmware, ordered[at].firmware
        return OverTime(
            change=Change.STEP,
            by=step.by,
            std=step.std,
            reason=f"fx changed by {_figures(step)} with the firmware, from {before} to {after}, between "
            f"{ordered[at - 1].day} and {ordered[at].day}",
        )
    if line.is_one:
        return OverTime(
            change=Change.DRIFT, by=line.by, std=line.std, reason=f"fx changed by {_figures(line)} {between}"
        )
    return OverTime(
        change=Change.UNSTEADY,
        by=widest.by,
        std=widest.std,
        reason=f"fx differs by {_figures(widest)} {between}, neither steadily nor with the firmware: another focus or "
        "zoom, a lens that was replaced, or two cameras under one serial number",
    )


def _figures(fit: _Fit) -> str:
    return f"{fit.by:+.2%} ± {fit.std:.2%}"


def _firmware_changes(ordered: Sequence[Measurement]) -> list[int]:
    """Index of the first date after each change of the stated firmware."""
    return [
        at
        for at, (one, other) in enumerate(pairwise(ordered), start=1)
        if one.firmware is not None and other.firmware is not None and one.firmware != other.firmware
    ]


def _solved(
    values: FloatArray, weights: FloatArray, design: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Parameters, their covariance and χ² from weighted least squares."""
    C = np.asarray(np.linalg.inv(design.T @ (weights[:, None] * design)), dtype=np.float64)
    x = C @ design.T @ (weights * values)
    return x, C, float(weights @ (values - design @ x) ** 2)


def _chance(values: FloatArray, weights: FloatArray, design: FloatArray) -> float:
    """Probability of a larger χ² from noise alone; 1 without degrees of freedom."""
    dof = len(values) - design.shape[1]
    return chi_square_tail(dof, _solved(values, weights, design)[2]) if dof else 1.0


def _step(values: FloatArray, weights: FloatArray, at: int) -> _Fit:
    after = (np.arange(len(values)) >= at).astype(np.float64)
    return _changed(values, weights, after)


def _line(values: FloatArray, weights: FloatArray, days: FloatArray) -> _Fit:
    span = days[-1] - days[0]
    return _changed(values, weights, (days - days[0]) / max(span, 1.0))


def _changed(values: FloatArray, weights: FloatArray, share: FloatArray) -> _Fit:
    """Fit a constant plus one change in proportion to ``share`` (0 … 1 by date)."""
    design = np.column_stack([np.ones(len(values)), share])
    if float(np.ptp(share)) == 0:
        return _Fit(0.0, math.inf, 0.0)
    x, C, _ = _solved(values, weights, design)
    return _Fit(float(x[1]), math.sqrt(float(C[1, 1])), _chance(values, weights, design))


def _widest(ordered: Sequence[Measurement]) -> _Fit:
    """Difference of the two dates that differ most in units of σ, later minus earlier."""
    pairs = [
        _Fit(math.log(other.fx / one.fx), math.hypot(one.std, other.std), 1.0)
        for at, one in enumerate(ordered)
        for other in ordered[at + 1 :]
    ]
    return max(pairs, key=lambda fit: abs(fit.by) / fit.std)
