"""What the standard deviation of a focal length consists of, and what is left of it once a part is mended.

σ² is a sum: the noise of single corners times the variance factor κ², and the squares of what fx would move by under
models that were not used (a bent board, a stretched print, further terms of the lens). So the two largest parts say
what a better session has to change, and the rest what it would reach.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import Final

from calibrary.records import Record

EXPECTED_KAPPA2: Final = 6.4
"""Variance factor that is expected where too few views give none: the mean of 25 real sets (median 3.8, nine of ten
below 14, taken as log-normal). With κ = 1 the focal lengths of such sets were 2.7 to 3.5 of their σ apart."""


class Part(StrEnum):
    """What a part of the variance comes from."""

    NOISE = "noise"
    BOARD_SHAPE = "board-shape"
    STRETCHED_PRINT = "stretched-print"
    LENS_SERIES = "lens-series"
    LENS_DEPARTS = "lens-departs"


class Budget(Record):
    """Standard deviations of the focal length, as fractions of it.

    Attributes:
        parts: by cause; their squares add up. The noise is that of single corners times κ.
        kappa: square root of the variance factor, at least 1.
        views: number of views.
    """

    parts: Mapping[Part, float]
    kappa: float
    views: int

    @property
    def total(self) -> float:
        """The standard deviation."""
        return math.hypot(*self.parts.values())

    @property
    def largest(self) -> tuple[Part, ...]:
        """The two largest parts, largest first; the second only if it counts."""
        parts = sorted(self.parts, key=self.parts.__getitem__, reverse=True)
        return tuple(part for part in parts[:2] if self.parts[part] > self.total / 4)

    def without(self, mended: Part) -> float:
        """Return the standard deviation once a part is mended."""
        return math.hypot(*(value for part, value in self.parts.items() if part is not mended))

    def views_for(self, limit: float) -> int | None:
        """Return how many views like these reach a limit; None if no number does, since only noise averages."""
        rest = self.without(Part.NOISE)
        if rest >= limit:
            return None
        return math.ceil(self.views * self.parts[Part.NOISE] ** 2 / (limit**2 - rest**2) - 1e-9)


def budget_of(variance: float, kappa2: float, shifts: Iterable[tuple[Part, float]], views: int) -> Budget:
    """Return the budget of a variance.

    Args:
        variance: of the focal length, as a fraction of it, κ² included.
        kappa2: the variance factor; 1 if there is none.
        shifts: what the focal length moves by under each model that was not used, as a fraction.
        views: number of views.
    """
    parts = {Part.NOISE: 0.0}
    for part, shift in shifts:
        parts[part] = math.hypot(parts.get(part, 0.0), shift)
    parts[Part.NOISE] = math.sqrt(max(variance - math.fsum(value**2 for value in parts.values()), 0.0))
    return Budget(parts=parts, kappa=math.sqrt(kappa2), views=views)
