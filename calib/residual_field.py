"""A smooth field of residuals over the image, beside the lens model: what no model of the lens can say.

A cubic B-spline with knots an eighth of the image apart is added to the projection, with a Gaussian-process prior of
two lengths. It is fitted to first order at the solution, with the poses, the lens and the board's warp free to give
way, and averaged over the amplitude τ by restricted maximum likelihood. Its mean is what the lens departs from the
model by; its covariance and the square of its mean belong into σ: of a projection, where the field lies, and of the
model's parameters, which have absorbed part of it.

Motion and a bent board leave residuals too, which the field would take for the lens. Those differ from view to view:
halves of the views then still contradict each other when the field is subtracted.

Source: REML as in H. D. Patterson and R. Thompson, "Recovery of inter-block information when block sizes are unequal",
1971; splined lenses as in mrcal.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted
from calibrary.calib.least_squares import reduce
from calibrary.calib.variance_factor import split_half
from calibrary.calibration import ImageSize
from calibrary.records import replace

INTERVALS: Final = 8
"""Intervals of knots along the longer side."""
LENGTHS: Final = (0.1, 0.2)
"""Correlation lengths of the prior, relative to the longer side."""
AMPLITUDES: Final = (0.0, *(0.005 * 1.6**at for at in range(12)))
"""τ in px."""
SCALE: Final = 0.03
"""Scale of the prior of τ in px: half of the lenses have no field, the others one of about this size."""
TRUNCATED: Final = 1e-5
"""Directions of the prior with less of its largest variance are left out."""
SIGNIFICANT: Final = 6.6
"""Ratio of log-likelihoods, doubled; noise alone exceeds it in 0.8 % of sets."""
EXPLAINED: Final = 1.5
"""Largest variance factor that may remain once the field is subtracted."""


class Field(Struct, frozen=True, kw_only=True, eq=False):
    """What the lens departs from its model by.

    Attributes:
        ratio: twice the logarithm of the likelihood with the field over that without it.
        kappa2: variance factor once the field is subtracted; None if there are too few views.
        mean: (N, 2) px, at the places that were asked for, once lens and camera have given way.
        variance: (N, 2) px², in addition to that of the model's parameters.
        of_lens: (n, n) mean square of what the lens parameters have absorbed of the field. They differ by that from
            the parameters that the model has beside the field.
    """

    ratio: float
    kappa2: float | None
    mean: FloatArray
    variance: FloatArray
    of_lens: FloatArray

    @property
    def is_significant(self) -> bool:
        """Whether noise does not explain the field."""
        return self.ratio > SIGNIFICANT

    @property
    def is_of_lens(self) -> bool:
        """Whether the field explains what the views contradict one another about, as only the lens can."""
        return self.is_significant and self.kappa2 is not None and self.kappa2 <= EXPLAINED


def residual_field(
    adjusted: Adjusted, image_size: ImageSize, pixels: FloatArray, by_lens: FloatArray, by_turn: FloatArray
) -> Field | None:
    """Fit the field; None if there are too few corners for it.

    Args:
        adjusted: the solution.
        image_size: (width, height) px.
        pixels: (N, 2) px, where it is wanted.
        by_lens: (N, 2, n) derivatives of these pixels by the lens parameters.
        by_turn: (N, 2, 3) the same by a turn of the camera.
    """
    network, linear, free = adjusted.network, adjusted.linear, adjusted.free
    used = network.used
    seen = network.seen[used]
    residuals = linear.residuals[used]
    predicted = network.pixels[used] - residuals.reshape(*seen.shape, 2)
    basis = _Basis(image_size)
    lens = linear.shared[used, :, : len(free)]
    poses = np.linalg.qr(linear.gone[used])[0]
    own = lens - poses @ (poses.transpose(0, 2, 1) @ lens)
    left = residuals - (poses @ (poses.transpose(0, 2, 1) @ residuals[..., None]))[..., 0]
    phi = basis(predicted.reshape(-1, 2)).reshape(*seen.shape, -1) * seen[..., None]
    g, k = own.shape[-1], basis.size
    # Normal equations: lens (g), field (2k). The poses are projected out of both.
    A = own.reshape(-1, g)
    b = left.reshape(-1)
    N, right = A.T @ A, A.T @ b
    scale = 1 / np.sqrt(np.maximum(np.diag(N), 1e-300))
    inverse = scale[:, None] * np.linalg.pinv(N * np.outer(scale, scale), hermitian=True) * scale
    start = inverse @ right
    flat = phi.reshape(-1, k)
    gram = flat.T @ flat
    x, y = (poses[:, axis::2].transpose(0, 2, 1) @ phi for axis in (0, 1))
    crossed = np.concatenate([x, y], axis=-1).reshape(-1, 2 * k)
    S = -crossed.T @ crossed
    S[:k, :k] += gram
    S[k:, k:] += gram
    A2, b2 = own.reshape(-1, 2, g), left.reshape(-1, 2)
    coupling = np.concatenate([flat.T @ A2[:, 0], flat.T @ A2[:, 1]])
    u = np.concatenate([flat.T @ b2[:, 0], flat.T @ b2[:, 1]])
    S -= coupling @ inverse @ coupling.T
    u -= coupling @ start
    dof, rss = adjusted.dof, float(b @ b - right @ start)
    if dof <= 2 * g or rss <= 0:
        return None
    # The places that were asked for, once lens and camera have given way.
    there = np.zeros((2 * len(pixels), 2 * k))
    there[::2, :k] = there[1::2, k:] = basis(pixels)
    full = np.zeros((2 * len(pixels), g))
    full[:, : by_lens.shape[-1]] = by_lens.reshape(len(full), -1)
    turn = np.linalg.qr(by_turn.reshape(-1, 3))[0]
    given_way = inverse @ coupling.T
    H = there - full @ given_way
    H -= turn @ (turn.T @ H)
    found = _averaged(S, u, basis.roots, dof, rss, H, given_way[: by_lens.shape[-1]])
    if found is None:
        return None
    ratio, mean, variance, of_lens, best = found
    shift = np.concatenate([phi @ best[:k, None], phi @ best[k:, None]], axis=-1).reshape(len(phi), -1)
    return Field(
        ratio=ratio,
        kappa2=_factor_without(adjusted, shift),
        mean=mean.reshape(-1, 2),
        variance=variance.reshape(-1, 2),
        of_lens=of_lens,
    )


def _averaged(
    S: FloatArray,
    u: FloatArray,
    roots: tuple[FloatArray, ...],
    dof: int,
    rss: float,
    H: FloatArray,
    T: FloatArray,
) -> tuple[float, FloatArray, FloatArray, FloatArray, FloatArray] | None:
    """Average over lengths and amplitudes.

    Returns:
        The ratio, mean and variance of H·field, the mean of T·field·fieldᵀ·Tᵀ, and the likeliest field.
    """
    tau = np.array(AMPLITUDES)
    prior = np.concatenate([[0.5], tau[1:] / (1 + (tau[1:] / SCALE) ** 2)])
    prior[1:] *= 0.5 / prior[1:].sum()
    likelihood = np.full((len(roots), len(tau)), -np.inf)
    solved = []
    for row, root in enumerate(roots):
        L = np.kron(np.eye(2), root)
        values, vectors = np.linalg.eigh(L.T @ S @ L)
        values, LU = np.maximum(values, 0.0), L @ vectors
        w, s2 = LU.T @ u, rss / dof
        for _ in range(2):
            grown = 1 + tau[:, None] ** 2 / s2 * values
            explained = (tau[:, None] ** 2 / s2 * w * w / grown).sum(axis=1)
            remaining = np.maximum(rss - explained, 1e-12 * rss) / dof
            likelihood[row] = -0.5 * (dof * np.log(remaining) + np.log(grown).sum(axis=1))
            s2 = float(remaining[np.argmax(likelihood[row])])
        solved.append((values, w, LU, s2))
    likelihood += 0.5 * dof * math.log(rss / dof)
    if not np.isfinite(likelihood).all():
        return None
    weight = likelihood + np.log(prior / len(roots))
    weight = np.exp(weight - weight.max())
    weight /= weight.sum()
    mean, second, square = np.zeros(len(H)), np.zeros(len(H)), np.zeros((len(T), len(T)))
    likeliest = np.unravel_index(int(np.argmax(likelihood)), likelihood.shape)
    best = np.zeros(len(u))
    for row, (values, w, LU, s2) in enumerate(solved):
        # (2r, amplitudes): how much of each direction is kept.
        kept = (tau**2 / s2) / (1 + tau**2 / s2 * values[:, None])
        if row == likeliest[0]:
            best = LU @ (kept[:, likeliest[1]] * w)
        HL, TL, spread = H @ LU, T @ LU, s2 * kept @ weight[row]
        here, absorbed = HL @ (kept * w[:, None]), TL @ (kept * w[:, None])
        mean += here @ weight[row]
        second += here**2 @ weight[row] + HL**2 @ spread
        square += (absorbed * weight[row]) @ absorbed.T + (TL * spread) @ TL.T
    return 2 * float(likelihood.max()), mean, np.maximum(second - mean**2, 0.0), square, best


def _factor_without(adjusted: Adjusted, shift: FloatArray) -> float | None:
    """Return the variance factor of the halves once the field is subtracted from the residuals."""
    residuals = adjusted.linear.residuals.copy()
    residuals[adjusted.network.used] -= shift
    linear = replace(adjusted.linear, residuals=residuals)
    reduced = reduce(linear, adjusted.free)
    try:
        step = np.linalg.lstsq(reduced.matrix, reduced.right, rcond=1e-15)[0]
    except np.linalg.LinAlgError:
        return None
    residuals -= adjusted.linear.shared[..., : len(adjusted.free)] @ step
    halves = split_half(replace(adjusted, linear=replace(adjusted.linear, residuals=residuals)))
    return halves.kappa2 if halves is not None else None


class _Basis:
    """Cubic B-splines over the image, and the roots of the prior of their coefficients for each length.

    Attributes:
        size: number of knots.
        roots: (k, r) for each of :data:`LENGTHS`; the field has unit variance on average over the image.
    """

    def __init__(self, image_size: ImageSize) -> None:
        longer = max(image_size)
        self._step = longer / INTERVALS
        self._counts = tuple(math.ceil(side / self._step - 1e-9) for side in image_size)
        self.size = math.prod(count + 3 for count in self._counts)
        roots = []
        for length in LENGTHS:
            # The kernel is a product of one along each axis, and so are its eigenvectors.
            (by_x, X), (by_y, Y) = (self._prior(axis, image_size[axis], length * longer) for axis in (0, 1))
            values = np.outer(by_y, by_x).ravel()
            kept = values > TRUNCATED * values.max()
            roots.append(np.kron(Y, X)[:, kept] * np.sqrt(values[kept]))
        self.roots = tuple(roots)

    def _prior(self, axis: int, side: int, length: float) -> tuple[FloatArray, FloatArray]:
        """Return eigenvalues and eigenvectors of the kernel along an axis; its mean variance over the image is 1."""
        knots = np.arange(self._counts[axis] + 3) * self._step
        K = np.exp(-((knots[:, None] - knots) ** 2) / (2 * length**2))
        along = self._along(np.linspace(0, side, 13), self._counts[axis])
        values, vectors = np.linalg.eigh(K / ((along @ K) * along).sum(axis=1).mean())
        return np.asarray(values), np.asarray(vectors)

    def __call__(self, pixels: FloatArray) -> FloatArray:
        """Return the splines at pixels, (N, size)."""
        x, y = (self._along(pixels[:, axis], self._counts[axis]) for axis in (0, 1))
        return np.asarray((y[:, :, None] * x[:, None, :]).reshape(len(pixels), -1))

    def _along(self, values: FloatArray, count: int) -> FloatArray:
        return splines(np.clip(np.nan_to_num(values), 0.0, count * self._step) / self._step, count)


def splines(at: FloatArray, intervals: int) -> FloatArray:
    """Return uniform cubic B-splines, (N, intervals + 3), at places between 0 and ``intervals``."""
    cell = np.clip(at.astype(np.intp), 0, intervals - 1)
    t = np.clip(at - cell, 0.0, 1.0)
    values = np.stack(
        [(1 - t) ** 3, 3 * t**3 - 6 * t * t + 4, -3 * t**3 + 3 * t * t + 3 * t + 1, t**3], axis=1
    )
    by = np.zeros((len(at), intervals + 3))
    np.put_along_axis(by, cell[:, None] + np.arange(4), values / 6, axis=1)
    return by
