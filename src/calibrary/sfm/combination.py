"""Several calibrations of one camera weighed into one: whether they agree, and if not, what sets them apart.

Generalised least squares on the full covariances. With x_i the parameters of calibration i and C_i their covariance,
the combined ones are C Σ C_i⁻¹ x_i with C⁻¹ = Σ C_i⁻¹, and Σ (x_i − x)ᵀ C_i⁻¹ (x_i − x) follows χ² with (n − 1) · k
degrees of freedom where nothing but the stated noise lies between them.

What sets them apart is looked for among everything that two parameters for each number can say: every division into
two groups, each with a camera of its own, and a change at a constant rate. The likeliest is stated.

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

__all__ = ["Apart", "Difference", "Weighed", "difference", "explanation", "shared_parameters", "weighed"]

DETERMINED: Final = 1e-10
"""Of the largest scaled variance: what is less was held, such as fx − fy where one focal length was solved for."""
SAME_HELD: Final = 1e-6
PINHOLE: Final = ("fx", "fy", "cx", "cy", "skew")
GRID: Final = (17, 13)
MOST_DIVIDED: Final = 10
"""Calibrations of which every division is tried; of more, one against the others, and before against after."""


class Weighed(Struct, frozen=True, kw_only=True, eq=False):
    """Calibrations as one.

    Attributes:
        calibration: with the combined parameters.
        covariance: of these, before scatter inflates it.
        chi2: how far they are from the combined one.
        dof: degrees of freedom of that.
    """

    calibration: Calibration
    covariance: Covariance
    chi2: float
    dof: int

    @property
    def p(self) -> float:
        """Chance of so much from the stated noise alone; 1 where there is nothing to compare."""
        return chi_square_tail(self.dof, self.chi2) if self.dof else 1.0

    @property
    def scatter(self) -> float:
        """χ² over its degrees of freedom, at least 1: what variances are multiplied by."""
        return max(1.0, self.chi2 / self.dof) if self.dof else 1.0


class Difference(Struct, frozen=True, kw_only=True):
    """Two cameras in px, as far apart as they get anywhere in the image, the camera free to turn.

    Attributes:
        px: there.
        std_px: of that.
    """

    px: float
    std_px: float


class Apart(Struct, frozen=True, kw_only=True):
    """What sets calibrations apart.

    Attributes:
        others: the smaller of the two groups; empty where it is a change at a constant rate.
        p: chance of what is left then.
        between: the two groups, or the first day and the last.
    """

    others: tuple[int, ...]
    p: float
    between: Difference


def shared_parameters(cameras: Sequence[Calibration], covariances: Sequence[Covariance]) -> tuple[str, ...]:
    """The names of what all of them were solved for.

    Raises:
        InputError: they are of several lens models, or were solved with other parameters held.
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


def weighed(cameras: Sequence[Calibration], covariances: Sequence[Covariance]) -> Weighed:
    """All of them as one.

    Args:
        cameras: n of one image size, whose :func:`shared_parameters` are known to be the same.
        covariances: of each, its variance factor included.

    Raises:
        InputError: they were solved with other parameters held.
    """
    problem = _Problem.of(cameras, covariances)
    solution, inverse, chi2 = problem.fitted(np.ones((len(cameras), 1)))
    return Weighed(
        calibration=problem.camera(solution[0]),
        covariance=problem.covariance(inverse),
        chi2=chi2,
        dof=(len(cameras) - 1) * problem.basis.shape[1],
    )


def difference(one: Weighed, two: Weighed) -> Difference | None:
    """How far apart two independent cameras are; None where no turn brings them together.

    Where the least known pixels are known to a px or less, only these count: an unknown edge hides a known centre.
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
) -> Apart | None:
    """What sets calibrations apart that do not agree, the likeliest; None of fewer than three.

    Args:
        cameras: as of :func:`weighed`.
        covariances: as of :func:`weighed`.
        years: when each was made; None where that is not known of all.
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
    return Apart(others=others, p=chi_square_tail(dof, chi2), between=between)


def _divisions(n: int, years: Sequence[float] | None) -> Iterator[tuple[int, ...]]:
    """The smaller group of every division into two that is worth trying."""
    if n <= MOST_DIVIDED:
        for size in range(1, n // 2 + 1):
            # Of two halves, the one without the first.
            yield from (one for one in combinations(range(n), size) if 2 * size < n or 0 not in one)
        return
    yield from ((at,) for at in range(n))
    if years is not None:
        order = np.argsort(years, kind="stable").tolist()
        for cut in range(2, n - 1):
            yield tuple(sorted(order[:cut] if 2 * cut < n else order[cut:]))


class _Problem(Struct, frozen=True, kw_only=True, eq=False):
    """n calibrations as deviations from the first, in units that make their variances alike.

    Attributes:
        first: the calibration that they are deviations from.
        names: of the m parameters.
        scale: (m,) unit of each.
        basis: (m, k) of what was solved for.
        values: (n, k).
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
        # What is 0 is rounded to either side of it.
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
        """(q, k) coefficients of (n, q) regressors, their (q·k, q·k) covariance, and χ² of what is left."""
        q, k = regressors.shape[1], self.basis.shape[1]
        N = np.einsum("na,nb,nij->aibj", regressors, regressors, self.weights).reshape(q * k, q * k)
        right = np.einsum("na,nij,nj->ai", regressors, self.weights, self.values).ravel()
        inverse = np.linalg.inv(N)
        solution = (inverse @ right).reshape(q, k)
        left = self.values - regressors @ solution
        return solution, inverse, float(np.einsum("ni,nij,nj->", left, self.weights, left))

    def between(self, along: FloatArray) -> Difference | None:
        """The camera at 0 against that at 1 of (n,) values of a regressor."""
        solution, inverse, _ = self.fitted(np.column_stack([np.ones(len(along)), along]))
        k = self.basis.shape[1]
        start, end = (self.camera(y) for y in (solution[0], solution.sum(axis=0)))
        # All of the uncertainty is that of the difference, whether the two ends are independent or not.
        known = self.covariance(np.zeros((k, k))), self.covariance(inverse[k:, k:])
        return difference(
            *(
                Weighed(calibration=one, covariance=C, chi2=0.0, dof=0)
                for one, C in zip((start, end), known, strict=True)
            )
        )

    def camera(self, y: FloatArray) -> Calibration:
        """The calibration of (k,) deviations."""
        x = dict(zip(self.names, (self.scale * (self.basis @ y)).tolist(), strict=True))
        K, lens = self.first.intrinsics, self.first.distortion
        pinhole = {name: getattr(K, name) + x[name] for name in x if name in PINHOLE}
        if lens is not None:
            lens = replace(
                lens, **{name: value + x[name] for name, value in lens.coefficients.items() if name in x}
            )
        return replace(self.first, intrinsics=replace(K, **pinhole), distortion=lens)

    def covariance(self, C: FloatArray) -> Covariance:
        """Of the parameters, from (k, k) of the deviations."""
        to_ours = self.scale[:, None] * self.basis
        whole = to_ours @ C @ to_ours.T
        return Covariance.from_matrix(self.names, (whole + whole.T) / 2)


def _values(camera: Calibration) -> dict[str, float]:
    K, lens = camera.intrinsics, camera.distortion
    pinhole = {name: float(getattr(K, name)) for name in PINHOLE}
    return pinhole | dict(lens.coefficients if lens is not None else {})
