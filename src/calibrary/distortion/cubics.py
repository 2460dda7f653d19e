"""Smooth functions tabulated as cubics: a dozen operations for any number of points.

An operation on a short array costs some 0.5 µs whatever its length, and Newton's method takes a hundred of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Self

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary.arrays import FloatArray

__all__ = ["Cubics", "Numbers"]

Numbers = FloatArray | NDArray[np.complex128]

_NODES = 0.5 - 0.5 * np.cos(math.pi * np.arange(4) / 3)
"""Chebyshev's on a cell from 0 to 1, ends included: there, and so at 0, the table is exact."""

_TO_POWERS = np.linalg.inv(np.vander(_NODES))


class Cubics(Struct, frozen=True):
    """Several functions of one argument from 0 on.

    Attributes:
        reach: the argument up to which they are tabulated.
        per_unit: cells in a unit of the argument.
        coefficients: (4, functions, cells), the highest power first.
    """

    reach: float
    per_unit: float
    coefficients: Numbers

    @classmethod
    def of(cls, functions: Callable[[FloatArray], Numbers], reach: float, cells: int) -> Self:
        """From what gives the values of all functions, (M, N), at N arguments."""
        starts = np.arange(cells) * (reach / cells)
        values = functions((starts + _NODES[:, None] * (reach / cells)).ravel())
        values = values.reshape(len(values), 4, cells)
        # Of differences within a cell, which are small: so is what rounding makes of their coefficients.
        fitted = np.einsum("pn,mnc->pmc", _TO_POWERS, values - values[:, :1])
        fitted[3] += values[:, 0]
        return cls(reach, cells / reach, fitted)

    def at(self, argument: FloatArray) -> Numbers:
        """The values of all functions, (M, N), at N arguments from 0 to below :attr:`reach`."""
        within = argument * self.per_unit
        cell = within.astype(np.intp)
        within -= cell
        found = self.coefficients.take(cell, axis=2, mode="clip")
        value: Numbers = found[0]
        for power in (1, 2, 3):
            value *= within
            value += found[power]
        return value

    def holding(self, functions: Callable[[FloatArray], Numbers], tolerance: float) -> Self:
        """The same table, its reach cut back to where, a tenth and a half into a cell, it errs by too much."""
        if not self.reach > 0:
            return self
        cells = self.coefficients.shape[2]
        at = (np.repeat(np.arange(cells), 2) + np.tile([0.1, 0.5], cells)) / self.per_unit
        wrong = ~(np.abs(self.at(at) - functions(at)) <= tolerance).all(axis=0)
        held = int(wrong.argmax()) // 2 if wrong.any() else cells
        return type(self)(held / self.per_unit, self.per_unit, self.coefficients)
