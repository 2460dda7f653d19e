"""Tables of smooth functions as piecewise cubics, evaluated with a dozen array operations.

An operation on a short array costs about 0.5 µs regardless of its length, and Newton's method needs a hundred.
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
"""Chebyshev nodes of a cell from 0 to 1, including both ends: the table is exact at the ends, hence at 0."""

_TO_POWERS = np.linalg.inv(np.vander(_NODES))


class Cubics(Struct, frozen=True):
    """Table of several functions of one argument ≥ 0.

    Attributes:
        reach: end of the table.
        per_unit: number of cells per unit of the argument.
        coefficients: (4, functions, cells), highest power first.
    """

    reach: float
    per_unit: float
    coefficients: Numbers

    @classmethod
    def of(cls, functions: Callable[[FloatArray], Numbers], reach: float, cells: int) -> Self:
        """Tabulate ``functions``, which returns the (M, N) values of all M functions at N arguments."""
        starts = np.arange(cells) * (reach / cells)
        values = functions((starts + _NODES[:, None] * (reach / cells)).ravel())
        values = values.reshape(len(values), 4, cells)
        # The fit is to differences within a cell: these are small, and so are the rounding errors of the coefficients.
        fitted = np.einsum("pn,mnc->pmc", _TO_POWERS, values - values[:, :1])
        fitted[3] += values[:, 0]
        return cls(reach, cells / reach, fitted)

    def at(self, argument: FloatArray) -> Numbers:
        """Return the (M, N) values of all functions at N arguments, 0 ≤ argument < :attr:`reach`."""
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
        """Return the table up to the first cell with an error above ``tolerance``, tested at 0.1 and 0.5 of a cell."""
        if not self.reach > 0:
            return self
        cells = self.coefficients.shape[2]
        at = (np.repeat(np.arange(cells), 2) + np.tile([0.1, 0.5], cells)) / self.per_unit
        wrong = ~(np.abs(self.at(at) - functions(at)) <= tolerance).all(axis=0)
        held = int(wrong.argmax()) // 2 if wrong.any() else cells
        return type(self)(held / self.per_unit, self.per_unit, self.coefficients)
