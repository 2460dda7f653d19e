"""Quality of a calibration, as far as its source states it: residuals, standard deviations and their reliability."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import accumulate
from typing import Annotated

from calibrary.arrays import ArrayLike, FloatArray, np
from calibrary.errors import InputError
from calibrary.records import Meta, Record, force_setattr, replace, require_declared

SYMMETRY = 1e-9
"""Largest asymmetry of a covariance element, relative to the standard deviations of its row and column."""


class Covariance(Record):
    """Covariance matrix of a calibration's parameters.

    Attributes:
        names: parameters in the order of the matrix: fx, fy, cx, cy in px, then the distortion coefficients by their
            names in the model.
        upper: upper triangle of the matrix row by row, n (n + 1) / 2 numbers.

    Raises:
        InputError: a name is duplicated, the number of elements does not match the names, a number is not finite, or a
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
        """Make the covariance from a symmetric matrix.

        Args:
            names: the n parameters in the matrix's order.
            matrix: (n, n).

        Raises:
            InputError: the matrix is not square or not symmetric, or violates a condition of the class.
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
        """Covariance matrix, (n, n) float64, symmetric."""
        n = len(self.names)
        full = np.zeros((n, n))
        full[np.triu_indices(n)] = self.upper
        return full + np.triu(full, 1).T

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix, (n, n); NaN for a parameter without variance."""
        full = self.matrix
        sigma = np.sqrt(np.diag(full))
        with np.errstate(all="ignore"):
            return np.asarray(full / np.outer(sigma, sigma))

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation by parameter name."""
        variances = (self.upper[at] for at in _diagonal(len(self.names)))
        return {name: math.sqrt(value) for name, value in zip(self.names, variances, strict=True)}

    def of(self, names: tuple[str, ...]) -> FloatArray:
        """Return the covariance of some of the parameters, in the order of ``names``.

        Raises:
            InputError: a parameter is not in this covariance.
        """
        missing = [name for name in names if name not in self.names]
        if missing:
            raise InputError(f"the covariance does not hold {', '.join(missing)}")
        at = [self.names.index(name) for name in names]
        return self.matrix[np.ix_(at, at)]

    def scaled(self, factors: Mapping[str, float]) -> Covariance:
        """Return the covariance after multiplying each parameter by its factor; the default factor is 1."""
        by = np.array([factors.get(name, 1.0) for name in self.names])
        return Covariance.from_matrix(self.names, self.matrix * np.outer(by, by))


class ImageCircle(Record):
    """Circle outside which a fisheye lens shows nothing.

    Attributes:
        x, y: its centre, px.
        radius: px.
    """

    x: float
    y: float
    radius: Annotated[float, Meta(gt=0)]


class Proven(Record):
    """Where in the frame observations prove a calibration, and how well the rest is known.

    Attributes:
        radius_px: distance from the middle of the image within which observations prove it, px.
        share: share of the image that observations prove; of a circular image, the share of the circle.
        sigma_px: largest standard deviation of a projection where it is proven, px; None if nothing is.
        edge_px: the same over the whole image, inside its circle.
        circle_px: radius of the circle outside which the frame shows nothing; None if the image fills the frame.

    Raises:
        InputError: a number is out of its range or not finite.
    """

    radius_px: Annotated[float, Meta(ge=0)]
    share: Annotated[float, Meta(ge=0, le=1)]
    sigma_px: Annotated[float, Meta(ge=0)] | None = None
    edge_px: Annotated[float, Meta(ge=0)]
    circle_px: Annotated[float, Meta(gt=0)] | None = None

    def __post_init__(self) -> None:
        require_declared(self)

    def scaled(self, sx: float, sy: float) -> Proven:
        """Return the same for an image resized by the factors ``sx`` and ``sy``."""
        by = math.sqrt(sx * sy)
        return Proven(
            radius_px=self.radius_px * by,
            share=self.share,
            sigma_px=self.sigma_px * by if self.sigma_px is not None else None,
            edge_px=self.edge_px * by,
            circle_px=self.circle_px * by if self.circle_px is not None else None,
        )


class Quality(Record):
    """Quality of a calibration, as far as it is known.

    Attributes:
        rms_px: reprojection error (RMS) in px.
        points: number of observations.
        views: number of images.
        std: standard deviation by parameter name, px for fx, fy, cx, cy, as the solver estimates it.
        covariance: covariance of the same parameters.
        kappa2: variance factor: observed variance between calibrations from halves of the data, divided by the
            variance that ``covariance`` predicts; about 1 if random noise is the only error.
        coverage: fraction of the image area that contains observations.
        proven: where in the frame observations prove the calibration; None if that is not known.

    >>> calibrary.Quality(rms_px=0.3, views=24, kappa2=4.0).inflation
    4.0
    """

    rms_px: float | None = None
    points: int | None = None
    views: int | None = None
    std: Mapping[str, float] = {}
    covariance: Covariance | None = None
    kappa2: float | None = None
    coverage: float | None = None
    proven: Proven | None = None

    @property
    def inflation(self) -> float:
        """Factor that makes the estimated variances realistic: κ², at least 1."""
        return max(1.0, self.kappa2) if self.kappa2 is not None else 1.0

    def scaled(self, sx: float, sy: float) -> Quality:
        """Return the quality for an image resized by the factors ``sx`` and ``sy``."""
        factors = {"fx": sx, "cx": sx, "skew": sx, "fy": sy, "cy": sy}
        return replace(
            self,
            rms_px=self.rms_px * math.sqrt(sx * sy) if self.rms_px is not None else None,
            std={name: value * factors.get(name, 1.0) for name, value in self.std.items()},
            covariance=self.covariance.scaled(factors) if self.covariance is not None else None,
            proven=self.proven.scaled(sx, sy) if self.proven is not None else None,
        )


def _diagonal(n: int) -> Iterator[int]:
    """Yield the positions of the diagonal elements in the upper triangle of an n × n matrix."""
    return accumulate(range(n, 1, -1), initial=0) if n else iter(())
