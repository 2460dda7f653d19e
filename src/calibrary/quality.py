"""How good a calibration is, as far as its source says: residuals, spread, and what the spread leaves out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import accumulate
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from calibrary.arrays import FloatArray
from calibrary.errors import InputError
from calibrary.records import Meta, Record, force_setattr, replace

__all__ = ["Covariance", "Quality"]


SYMMETRY = 1e-9
"""How far two mirrored elements may part, in the standard deviations of their row and column."""


class Covariance(Record):
    """The joint uncertainty of a calibration's parameters.

    Attributes:
        names: the parameters, in the order of the matrix: fx, fy, cx, cy in px of the frame, and the
            distortion's coefficients by the names its model gives them.
        upper: the matrix's upper triangle row by row, n (n + 1) / 2 numbers.

    Raises:
        InputError: a name is duplicated, the count does not fit the names, a number is not finite, or a
            variance is negative.
    """

    names: Annotated[
        tuple[str, ...], Meta(min_length=1, max_length=30, extra_json_schema={"uniqueItems": True})
    ]
    upper: Annotated[tuple[float, ...], Meta(max_length=465)]

    def __post_init__(self) -> None:
        n = len(self.names)
        if len(set(self.names)) != n:
            raise InputError(f"a covariance names a parameter twice: {', '.join(self.names)}")
        if len(self.upper) != n * (n + 1) // 2:
            raise InputError(
                f"a covariance of {n} parameters has {n * (n + 1) // 2} numbers in its upper triangle, "
                f"found {len(self.upper)}"
            )
        force_setattr(self, "upper", tuple(float(value) for value in self.upper))
        if not all(math.isfinite(value) for value in self.upper):
            raise InputError("a covariance contains NaN or infinity, expected finite numbers")
        if any(self.upper[at] < 0 for at in _diagonal(n)):
            raise InputError("a covariance contains a negative variance")

    @classmethod
    def from_matrix(cls, names: tuple[str, ...], matrix: ArrayLike) -> Covariance:
        """Take the upper triangle of a symmetric matrix.

        Args:
            names: the n parameters in the matrix's order.
            matrix: (n, n).

        Raises:
            InputError: it is not square and symmetric, or breaks what the class asks.
        """
        full = np.asarray(matrix, dtype=np.float64)
        if full.shape != (len(names), len(names)):
            raise InputError(
                f"a covariance of {len(names)} parameters has shape {full.shape}, expected {(len(names),) * 2}"
            )
        spread = np.sqrt(np.abs(np.diag(full)))
        if (np.abs(full - full.T) > SYMMETRY * np.outer(spread, spread)).any():
            raise InputError("a covariance is not symmetric")
        return cls(names=names, upper=tuple(full[np.triu_indices(len(names))].tolist()))

    @property
    def matrix(self) -> FloatArray:
        """(n, n) float64, symmetric."""
        n = len(self.names)
        full = np.zeros((n, n))
        full[np.triu_indices(n)] = self.upper
        return full + np.triu(full, 1).T

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation by parameter name."""
        variances = (self.upper[at] for at in _diagonal(len(self.names)))
        return {name: math.sqrt(value) for name, value in zip(self.names, variances, strict=True)}

    def of(self, names: tuple[str, ...]) -> FloatArray:
        """The part that belongs to some of the parameters, in the order asked for.

        Raises:
            InputError: it does not speak of one of them.
        """
        missing = [name for name in names if name not in self.names]
        if missing:
            raise InputError(f"the covariance does not hold {', '.join(missing)}")
        at = [self.names.index(name) for name in names]
        return self.matrix[np.ix_(at, at)]

    def scaled(self, factors: Mapping[str, float]) -> Covariance:
        """The covariance of parameters that were multiplied each by its factor, 1 where none is given."""
        by = np.array([factors.get(name, 1.0) for name in self.names])
        return Covariance.from_matrix(self.names, self.matrix * np.outer(by, by))


class Quality(Record):
    """What is known of how good a calibration is.

    Attributes:
        rms_px: root mean square reprojection error.
        points: number of observations behind it.
        views: number of images behind it.
        std: standard deviation by parameter name, px for fx, fy, cx, cy, as the solve gives it.
        covariance: the same with the correlations.
        kappa2: how many times larger the scatter between calibrations from halves of the data is than
            ``covariance`` would have it; about 1 where noise is all that is wrong.
        coverage: fraction of the frame in which something was observed.
    """

    rms_px: float | None = None
    points: int | None = None
    views: int | None = None
    std: Mapping[str, float] = {}
    covariance: Covariance | None = None
    kappa2: float | None = None
    coverage: float | None = None

    @property
    def inflation(self) -> float:
        """What variances are multiplied by to be believed: κ², and never less than 1."""
        return max(1.0, self.kappa2) if self.kappa2 is not None else 1.0

    def scaled(self, sx: float, sy: float) -> Quality:
        """The same, of a frame that was resampled by ``sx`` and ``sy``."""
        factors = {"fx": sx, "cx": sx, "skew": sx, "fy": sy, "cy": sy}
        return replace(
            self,
            rms_px=self.rms_px * math.sqrt(sx * sy) if self.rms_px is not None else None,
            std={name: value * factors.get(name, 1.0) for name, value in self.std.items()},
            covariance=self.covariance.scaled(factors) if self.covariance is not None else None,
        )


def _diagonal(n: int) -> Iterator[int]:
    """Where the diagonal's elements stand in the upper triangle of an n × n matrix."""
    return accumulate(range(n, 1, -1), initial=0) if n else iter(())
