"""Weighted mean of several calibrations of one camera: whether they agree and, if not, the likeliest explanation.

Generalised least squares with the full covariances. With x_i the parameters of calibration i and C_i their covariance,
the combined parameters are x = C Σ C_i⁻¹ x_i with C⁻¹ = Σ C_i⁻¹. If the calibrations differ only by the stated noise,
Σ (x_i − x)ᵀ C_i⁻¹ (x_i − x) follows χ² with (n − 1) · k degrees of freedom.

The explanations tried are those with two values for each parameter: every division into two groups, each with a
camera of its own, and a change at a constant rate.

Source: D. Birge, "The calculation of errors by the method of least squares", 1932, for the ratio that inflates σ.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.projection_difference import projection_difference
from calibrary.calibration import Calibration, Covariance
from calibrary.errors import CalibrationError, InputError
from calibrary.probability import chi_square_tail
from calibrary.records import replace

DETERMINED: Final = 1e-10
"""Smallest share of the largest scaled variance; less means a fixed combination, such as fx − fy if both were equal."""
SAME_HELD: Final = 1e-6
PINHOLE: Final = ("fx", "fy", "cx", "cy", "skew")
GRID: Final = (17, 13)
MOST_DIVIDED: Final = 10
"""Largest number of calibrations for all divisions; of more, only one against the others and before against after."""


class WeightedMean(Struct, frozen=True, kw_only=True, eq=False):
    """Weighted mean of calibrations.

    Attributes:
        calibration: calibration with the combined parameters.
        covariance: covariance of these, not inflated by the scatter.
        chi2: χ² of the differences from the combined parameters.
        dof: degrees of freedom of chi2.
    """

    calibration: Calibration
    covariance: Covariance
    chi2: float
    dof: int

    @property
    def p(self) -> float:
        """Probability of such a χ² from the stated noise alone; 1 if there is nothing to compare."""
        return chi_square_tail(self.dof, self.chi2) if self.dof else 1.0

    @property
    def scatter(self) -> float:
        """Factor on the variances: χ² divided by its degrees of freedom, at least 1."""
        return max(1.0, self.chi2 / self.dof) if self.dof else 1.0


class Difference(Struct, frozen=True, kw_only=True):
    """Largest difference between two cameras anywhere in the image, after the best rotation.

    Attributes:
        px: difference, px.
        std_px: standard deviation of px.
    """

    px: float
    std_px: float


class Disagreement(Struct, frozen=True, kw_only=True):
    """Explanation of the disagreement between calibrations.

    Attributes:
        others: the smaller of the two groups; empty for a change at a constant rate.
        p: probability of the remaining differences.
        between: difference between the two groups, or between the first day and the last.
    """

    others: tuple[int, ...]
    p: float
    between: Difference


def shared_parameters(cameras: Sequence[Calibration], covariances: Sequence[Covariance]) -> tuple[str, ...]:
    """Return the names of the parameters that all calibrations estimated.

    Raises:
        InputError: the lens models differ, or the fixed parameters do.
    """
    names = covariances[0].names
    kinds = {type(one.distortion) for one in cameras}
    if len(kinds) > 1:
        listed = ", ".join(sorted(kind.__name__ for kind in kinds))
        raise InputError(f"the lens models differ: {listed}")
    for covariance in covariances:
        if other := set(names) ^ set(covariance.names):
            raise InputError(f"not all were solved for {', '.join(sorted(other))}")
    first, *rest = [
        {name: value for name, value in _values(one).items() if name not in names} for one in cameras
    ]
    for held in rest:
        if changed := [
            name for name in first if not math.isclose(first[name], held[name], abs_tol=SAME_HELD)
        ]:
            raise InputError(f"{', '.join(changed)} was held at other values")
    return names


def weighted_mean(cameras: Sequence[Calibration], covariances: Sequence[Covariance]) -> WeightedMean:
    """Compute the weighted mean.

    Args:
        cameras: n calibrations of one image size that passed :func:`shared_parameters`.
        covariances: covariance of each, including its variance factor.

    Raises:
        InputError: the fixed parameters differ.
    """
    problem = _Problem.of(cameras, covariances)
    solution, inverse, chi2 = problem.fitted(np.ones((len(cameras), 1)))
    return WeightedMean(
        calibration=problem.camera(solution[0]),
        covariance=problem.covariance(inverse),
        chi2=chi2,
        dof=(len(cameras) - 1) * problem.basis.shape[1],
    )


def difference(one: WeightedMean, two: WeightedMean) -> Difference | None:
    """Return the largest difference between two independent cameras; None if it cannot be computed.

    If some pixels are known to 1 px or better, only these are evaluated, because an uncertain edge would hide a
    well-known centre.
    """
    for trusted in (1.0, math.inf):
        try:
            found = projection_difference(
                one.calibration,
                two.calibration,
                shape=GRID,
                covariances=(one.covariance, two.covariance),
                trusted_px=trusted,
            )
        except CalibrationError:
            return None
        if found.std_px is not None and found.region.any():
            lengths = np.where(found.region, np.nan_to_num(found.lengths_px), -1.0)
            at = np.unravel_index(int(lengths.argmax()), lengths.shape)
            return Difference(px=float(lengths[at]), std_px=float(found.std_px[at]))
    return None


def explanation(
    cameras: Sequence[Calibration], covariances: Sequence[Covariance], years: Sequence[float] | None
) -> Disagreement | None:
    """Return the likeliest explanation of a disagreement; None for fewer than three calibrations.

    Args:
        cameras: as for :func:`weighted_mean`.
        covariances: as for :func:`weighted_mean`.
        years: date of each calibration in years; None if not all are known.
    """
    n = len(cameras)
    if n < 3:
        return None
    problem = _Problem.of(cameras, covariances)
    dof = (n - 2) * problem.basis.shape[1]
    tried: list[tuple[float, tuple[int, ...], FloatArray]] = []
    for others in _divisions(n, years):
        mark = np.zeros(n)
        mark[list(others)] = 1.0
        tried.append((problem.fitted(np.column_stack([np.ones(n), mark]))[2], others, mark))
    if years is not None and len(set(years)) >= 3:
        passed = np.array(years) - min(years)
        tried.append((problem.fitted(np.column_stack([np.ones(n), passed]))[2], (), passed / passed.max()))
    chi2, others, along = min(tried, key=lambda one: one[0])
    between = problem.between(along)
    if between is None:
        return None
    return Disagreement(others=others, p=chi_square_tail(dof, chi2), between=between)


def _divisions(n: int, years: Sequence[float] | None) -> Iterator[tuple[int, ...]]:
    """Yield the smaller group of each division into two that is tried."""
    if n <= MOST_DIVIDED:
        for size in range(1, n // 2 + 1):
            # Of two equal halves, yield the one without the first calibration.
            yield from (one for one in combinations(range(n), size) if 2 * size < n or 0 not in one)
        return
    yield from ((at,) for at in range(n))
    if years is not None:
        order = np.argsort(years, kind="stable").tolist()
        for cut in range(2, n - 1):
            yield tuple(sorted(order[:cut] if 2 * cut < n else order[cut:]))


class _Problem(Struct, frozen=True, kw_only=True, eq=False):
    """n calibrations as deviations from the first, scaled to similar variances.

    Attributes:
        first: calibration from which the deviations are measured.
        names: names of the m parameters.
        scale: (m,) unit of each parameter.
        basis: (m, k) basis of the estimated combinations of parameters.
        values: (n, k) deviations in this basis.
        weights: (n, k, k) inverse covariances.
    """

    first: Calibration
    names: tuple[str, ...]
    scale: FloatArray
    basis: FloatArray
    values: FloatArray
    weights: FloatArray

    @classmethod
    def of(cls, cameras: Sequence[Calibration], covariances: Sequence[Covariance]) -> _Problem:
        names = covariances[0].names
        C = np.stack([one.of(names) for one in covariances])
        scale = np.sqrt(np.mean(np.diagonal(C, axis1=1, axis2=2), axis=0))
        scale = np.where(scale > 0, scale, 1.0)
        C = C / np.outer(scale, scale)
        spread, vectors = np.linalg.eigh(C.mean(axis=0))
        free = spread > DETERMINED * spread[-1]
        basis, rest = vectors[:, free], vectors[:, ~free]
        start = np.array([_values(cameras[0])[name] for name in names])
        x = (np.array([[_values(one)[name] for name in names] for one in cameras]) - start) / scale
        inside = basis.T @ C @ basis
        size = np.maximum(np.abs(start) / scale, 1.0)
        # Zero eigenvalues are rounded to small positive or negative values.
        if (np.linalg.eigvalsh(inside)[:, 0] <= DETERMINED * spread[-1]).any() or (
            np.abs(x @ rest) > SAME_HELD * (size @ np.abs(rest))
        ).any():
            raise InputError("not all were solved for the same parameters: some were held")
        return cls(
            first=cameras[0],
            names=names,
            scale=scale,
            basis=basis,
            values=x @ basis,
            weights=np.linalg.inv(inside),
        )

    def fitted(self, regressors: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Return (q, k) coefficients of (n, q) regressors, their (q·k, q·k) covariance, and χ² of the residuals."""
        q, k = regressors.shape[1], self.basis.shape[1]
        N = np.einsum("na,nb,nij->aibj", regressors, regressors, self.weights).reshape(q * k, q * k)
        right = np.einsum("na,nij,nj->ai", regressors, self.weights, self.values).ravel()
        inverse = np.linalg.inv(N)
        solution = (inverse @ right).reshape(q, k)
        left = self.values - regressors @ solution
        return solution, inverse, float(np.einsum("ni,nij,nj->", left, self.weights, left))

    def between(self, along: FloatArray) -> Difference | None:
        """Return the difference between the cameras at the values 0 and 1 of an (n,) regressor."""
        solution, inverse, _ = self.fitted(np.column_stack([np.ones(len(along)), along]))
        k = self.basis.shape[1]
        start, end = (self.camera(y) for y in (solution[0], solution.sum(axis=0)))
        # Assign the whole uncertainty of the difference to the second camera; the two ends may be correlated.
        known = self.covariance(np.zeros((k, k))), self.covariance(inverse[k:, k:])
        return difference(
            *(
                WeightedMean(calibration=one, covariance=C, chi2=0.0, dof=0)
                for one, C in zip((start, end), known, strict=True)
            )
        )

    def camera(self, y: FloatArray) -> Calibration:
        """Return the calibration with (k,) deviations."""
        x = dict(zip(self.names, (self.scale * (self.basis @ y)).tolist(), strict=True))
        K, lens = self.first.intrinsics, self.first.distortion
        pinhole = {name: getattr(K, name) + x[name] for name in x if name in PINHOLE}
        if lens is not None:
            lens = replace(
                lens, **{name: value + x[name] for name, value in lens.coefficients.items() if name in x}
            )
        return replace(self.first, intrinsics=replace(K, **pinhole), distortion=lens)

    def covariance(self, C: FloatArray) -> Covariance:
        """Convert the (k, k) covariance of the deviations to that of the parameters."""
        to_ours = self.scale[:, None] * self.basis
        whole = to_ours @ C @ to_ours.T
        return Covariance.from_matrix(self.names, (whole + whole.T) / 2)


def _values(camera: Calibration) -> dict[str, float]:
    K, lens = camera.intrinsics, camera.distortion
    pinhole = {name: float(getattr(K, name)) for name in PINHOLE}
    return pinhole | dict(lens.coefficients if lens is not None else {})
