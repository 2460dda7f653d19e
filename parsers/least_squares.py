"""Levenberg–Marquardt method for a dozen unknowns and functions that are not defined everywhere."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from calibrary.arrays import FloatArray

__all__ = ["Residuals", "least_squares"]

Residuals: TypeAlias = Callable[[FloatArray], "FloatArray | None"]
"""Function that returns residuals in px for the unknowns; None where it is not defined."""

ROUNDS = 20
ENOUGH = 1e-5
"""Relative decrease of the sum of squares below which the iteration stops."""

FIRST_STEP = 1e-6
SMALL_MOVE_PX, LARGE_MOVE_PX = 1e-4, 1.0
"""Range in px of the pixel displacement by a difference step: large enough for ten digits, small enough for
linearity."""


def least_squares(residuals: Residuals, unknowns: int, start: FloatArray | None = None) -> FloatArray | None:
    """Minimise by the Levenberg–Marquardt method from ``start``, or zeros; None if the start cannot be evaluated.

    The polynomial models are linear in their coefficients and need two iterations. If a step makes the model
    non-monotonic inside the image, there are no residuals and the step is shortened, as any step that
    increases the error.
    """
    x = np.zeros(unknowns) if start is None else start
    missed = residuals(x)
    if missed is None or not unknowns:
        return x if missed is not None else None
    steps = np.full(unknowns, FIRST_STEP)
    damping = 1e-9
    for _ in range(ROUNDS):
        jacobian = _jacobian(residuals, x, missed, steps)
        if jacobian is None:
            return x
        scale: FloatArray = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
        cost, gain = float(missed @ missed), 0.0
        while damping < 1e12:
            stacked = np.vstack([jacobian / scale, math.sqrt(damping) * np.eye(unknowns)])
            wanted = np.concatenate([-missed, np.zeros(unknowns)])
            shift = np.linalg.lstsq(stacked, wanted, rcond=None)[0] / scale
            trial = residuals(x + shift)
            if trial is not None and float(trial @ trial) < cost:
                gain = 1.0 - float(trial @ trial) / cost
                x, missed, damping = x + shift, trial, max(damping / 10, 1e-15)
                break
            damping *= 10
        if gain < ENOUGH:
            return x
    return x


def _jacobian(
    residuals: Residuals, x: FloatArray, missed: FloatArray, steps: FloatArray
) -> FloatArray | None:
    """Jacobian by finite differences, each with a step that moves some pixel by about 0.01 px; None if not possible.

    The effect of a coefficient of r⁶ depends on the field of view by ten orders of magnitude, so suitable
    steps are searched; ``steps`` keeps them for the next iteration.
    """
    columns: list[FloatArray] = []
    for index, unit in enumerate(np.eye(len(x))):
        found = _column(residuals, x, missed, steps[index] * unit)
        if found is None:
            return None
        column, steps[index] = found
        columns.append(column)
    return np.column_stack(columns)


def _column(
    residuals: Residuals, x: FloatArray, missed: FloatArray, shift: FloatArray
) -> tuple[FloatArray, float] | None:
    """A derivative and its step; zeros for a coefficient without effect."""
    for _ in range(8):
        step = float(shift.sum())
        moved = residuals(x + shift)
        if moved is None:
            # The model is not monotonic for the forward step: use a smaller backward step.
            shift = -0.1 * shift
            continue
        moves = float(np.abs(moved - missed).max())
        if SMALL_MOVE_PX <= moves <= LARGE_MOVE_PX:
            return (moved - missed) / step, step
        shift = shift * (1e3 if moves == 0.0 else math.sqrt(SMALL_MOVE_PX * LARGE_MOVE_PX) / moves)
    return (np.zeros_like(missed), FIRST_STEP) if moved is not None and moves == 0.0 else None
