"""Tests for known faults that may explain the residuals.

Each fault is added to the solution as additional parameters, to first order, and the remaining sums of squares are
compared. Six velocities per view fit nearly anything, and a changing focus or a bending sheet fit as well as a rolling
shutter. So a fault is named alone only if it is clearly better than every other, and each is penalised for its number
of parameters (Schwarz's criterion, since the question is which model is true).

No fault is named if the residuals are no larger than the noise of single corners, which is known without a camera
model, or if the best fault leaves most of the excess over the noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import StrEnum
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted, without_poses
from calibrary.calib.board import Board
from calibrary.calib.model_choice import f_test
from calibrary.calib.observations import Observations
from calibrary.calibration import ImageSize
from calibrary.probability import chi_square_tail
from calibrary.records import Record

FOURTH_DIFFERENCE: Final = (1.0, -4.0, 6.0, -4.0, 1.0)
"""Weights of five neighbouring corners; they cancel nearly all of perspective and distortion."""
NORMAL_MAD: Final = 1.4826
LEVEL: Final = 1e-4
SMALLEST_SINGULAR: Final = 1e-5
CLEARLY: Final = 0.1
"""A cause is named alone if the next leaves this much more of the sum of squares, including the penalties."""
SUBSTANTIAL: Final = 10.0
"""Schwarz's criterion must decrease by this much for a cause to be named: "very strong" evidence in R. E. Kass and
A. E. Raftery, "Bayes factors", 1995."""
FEWEST_TO_SCATTER: Final = 12
"""Smallest number of corners in a view for estimating their scatter."""
EXCESS_EXPLAINED: Final = 0.5
"""Smallest share of the excess over noise that a named cause must explain."""


MOST_ALIKE: Final = 0.3
"""Largest correlation of neighbouring corners' residuals for motion blur: blur affects each corner independently,
every other fault moves neighbours together."""


class Cause(StrEnum):
    """A fault of the camera or of its use, or of the board if it is not estimated."""

    ROLLING_SHUTTER = "rolling-shutter"
    FOCUS_CHANGES = "focus-changes"
    TWO_CAMERAS = "two-cameras"
    STABILISED = "stabilised"
    BOARD_FLEXES = "board-flexes"
    STRETCHED_PRINT = "stretched-print"
    MOTION_BLUR = "motion-blur"


class Rival(Record):
    """Effect of one fault on the residuals.

    Attributes:
        cause: the fault.
        left_px: standard deviation of a coordinate that remains unexplained, px.
        criterion: change of Schwarz's criterion relative to no fault; the lowest explains best.
        p: probability of such an improvement by noise alone.
        focal: by how much the focal length would change, as a fraction; 0 for motion blur, which displaces no corner.
    """

    cause: Cause
    left_px: float
    criterion: float
    p: float
    focal: float = 0.0


class Misfit(Record):
    """The tested faults, most likely first.

    Attributes:
        rivals: tested faults.
        sigma_px: standard deviation of a coordinate without any of them, px.
        noise_px: the same estimated from neighbouring corners; None if not available.
        scalars: number of measured coordinates.
    """

    rivals: tuple[Rival, ...]
    sigma_px: float
    noise_px: float | None
    scalars: int

    @property
    def likely(self) -> tuple[Rival, ...]:
        """The one fault that is clearly best, else the best two; none if nothing explains much."""
        noise = min(self.noise_px or 0.0, self.sigma_px)
        excess = self.sigma_px**2 - noise**2
        able = [one for one in self.rivals if one.p < LEVEL]
        if (
            not able
            or able[0].criterion > -SUBSTANTIAL
            or self.sigma_px**2 - able[0].left_px ** 2 <= EXCESS_EXPLAINED * excess
        ):
            return ()
        # Faults move corners in similar ways, so a second cause that explains nearly as much is named too.
        margin = self.scalars * math.log1p(CLEARLY)
        alone = len(able) == 1 or able[1].criterion - able[0].criterion > margin
        return tuple(able[:1] if alone else able[:2])


def misfit(adjusted: Adjusted, image_size: ImageSize, noise_px: float | None) -> Misfit | None:
    """Test the known faults; return None if there are too few corners.

    Args:
        adjusted: the solution.
        image_size: (width, height) px.
        noise_px: standard deviation of one coordinate, as :func:`corner_noise` returns it.
    """
    network, linear = adjusted.network, adjusted.linear
    used = network.used
    residuals, by_pose = linear.residuals[used], linear.gone[used]
    by_global = linear.shared[used, :, : len(adjusted.free)]
    still, rank, _ = _unexplained(residuals, by_global, by_pose)
    n, state = network.scalars, adjusted.state
    focal, by = state.model.axial_focal(
        dict(zip(state.model.parameters, state.parameters.tolist(), strict=True))
    )
    by_lens = np.array([by.get(name, 0.0) for name in state.model.parameters])
    if n - rank < len(residuals):
        return None
    found = [] if (blur := _blur(adjusted, n, rank)) is None else [blur]
    for cause, globals_too, by_view in _faults(adjusted, image_size):
        left, more, step = _unexplained(residuals, globals_too, by_view)
        dof, extra = n - more, more - rank
        if dof < extra or extra <= 0:
            continue
        found.append(
            Rival(
                cause=cause,
                left_px=math.sqrt(left / dof),
                # The residuals also decide to which of two cameras each view belongs: one bit per view.
                criterion=n * math.log(max(left, 1e-300) / still)
                + extra * math.log(n)
                + (2 * math.log(2) * len(residuals) if cause is Cause.TWO_CAMERAS else 0.0),
                p=f_test(still, left, extra, dof)[1],
                focal=float(by_lens @ step[: len(by_lens)]) / focal,
            )
        )
    return Misfit(
        rivals=tuple(sorted(found, key=lambda one: one.criterion)),
        sigma_px=math.sqrt(still / (n - rank)),
        noise_px=noise_px,
        scalars=n,
    )


def _faults(adjusted: Adjusted, image_size: ImageSize) -> Iterator[tuple[Cause, FloatArray, FloatArray]]:
    """Yield each fault as columns: (V, 2M, g) common to all views, and (V, 2M, k) separate for each view."""
    network, linear, state = adjusted.network, adjusted.linear, adjusted.state
    used, lens = network.used, len(state.parameters)
    residuals, by_pose = linear.residuals[used], linear.gone[used]
    everything, seen = linear.shared[used], network.seen[used]
    by_global = everything[..., : len(adjusted.free)]
    zoom = everything[..., 0] * state.parameters[0] + everything[..., 1] * state.parameters[1]

    def each(columns: FloatArray) -> FloatArray:
        return np.concatenate([by_pose, columns], axis=-1)

    # The predicted rows, not the measured ones; otherwise the noise would explain itself.
    rows = np.where(seen, network.pixels[used, :, 1] - residuals[:, 1::2], 0.0)
    # Time relative to each view's mean; otherwise a small board's motion would be inseparable from its pose.
    time = np.where(seen, rows - (rows.sum(axis=1) / seen.sum(axis=1))[:, None], 0.0) / image_size[1]
    yield Cause.ROLLING_SHUTTER, by_global, each(by_pose * np.repeat(time, 2, axis=1)[..., None])
    yield Cause.FOCUS_CHANGES, by_global, each(zoom[..., None])
    yield Cause.STABILISED, by_global, each(everything[..., 2:4])
    of_one = _two_kinds(residuals, without_poses(linear, used, zoom[..., None])[..., 0])
    other = everything[..., :lens] * of_one[:, None, None]
    yield Cause.TWO_CAMERAS, np.concatenate([by_global, other], axis=-1), by_pose
    if network.is_planar:
        by_place = by_pose[..., 3:].reshape(*seen.shape, 2, 3)
        by_height = np.einsum("vmcx,vx->vmc", by_place, state.rotations[used][:, :, 2])
        down = np.einsum(
            "vmcx,vx,vm->vmc", by_place, state.rotations[used][:, :, 1], network.points[used][..., 1]
        )
        yield (
            Cause.STRETCHED_PRINT,
            np.concatenate([by_global, down.reshape(*zoom.shape, 1)], axis=-1),
            by_pose,
        )
        half = np.abs(network.points[network.seen]).max(axis=0)
        twist = network.points[used][..., 0] * network.points[used][..., 1] / max(half[0] * half[1], 1e-12)
        lift = np.concatenate([network.warp_shape[used], twist[..., None]], axis=-1)
        yield (
            Cause.BOARD_FLEXES,
            by_global,
            each((by_height[..., None] * lift[:, :, None, :]).reshape(*zoom.shape, 3)),
        )


def _blur(adjusted: Adjusted, n: int, rank: int) -> Rival | None:
    """Test for motion blur: corners of each view that are uncertain along one direction.

    Blur does not displace corners systematically, it increases their scatter; so its effect is the likelihood of
    normal residuals with that scatter. None if neighbouring corners deviate together, or the scatter is no more
    elongated than by chance.
    """
    network, residuals = adjusted.network, adjusted.linear.residuals
    counts = network.seen.sum(axis=1)
    views = np.flatnonzero(counts >= FEWEST_TO_SCATTER)
    counts, errors = counts[views], residuals[views].reshape(len(views), -1, 2)
    scatter = np.linalg.eigvalsh(errors.transpose(0, 2, 1) @ errors / counts[:, None, None])
    if not (scatter > 0).all():
        return None
    by_view = float(counts @ np.log(scatter).sum(axis=1))
    alone = float(2 * counts @ np.log(scatter.mean(axis=1)))
    together = float((errors**2).sum())
    row, _ = np.nonzero(network.seen[views])
    own = errors[network.seen[views]]
    alike = float((own[1:] * own[:-1])[row[1:] == row[:-1]].sum())
    if len(views) < 2 or alike > MOST_ALIKE * together:
        return None
    scalars = 2 * int(network.seen[views].sum())
    elongated = alone - by_view - 2 * len(views) * math.log(scalars)
    if elongated < SUBSTANTIAL:
        return None
    extra = 3 * len(views) - 1
    gain = scalars * math.log(together / scalars) - by_view
    return Rival(
        cause=Cause.MOTION_BLUR,
        left_px=math.exp(by_view / scalars / 2) * math.sqrt(n / (n - rank)),
        criterion=extra * math.log(n) - gain,
        p=chi_square_tail(extra, gain),
    )


def _two_kinds(residuals: FloatArray, zoom: FloatArray) -> FloatArray:
    """Return (V,) 1 for views with one of two focal lengths, 0 for those with the other.

    ``zoom`` is the derivative by the logarithm of the focal length, beyond what the poses absorb.
    """
    wanted = (zoom * residuals).sum(axis=1) / np.maximum((zoom**2).sum(axis=1), 1e-300)
    order = np.sort(wanted)
    # Two clusters in one dimension: the cut that minimises the variance within both.
    within = [order[:at].var() * at + order[at:].var() * (len(order) - at) for at in range(1, len(order))]
    cut = 1 + int(np.argmin(within)) if within else 0
    return np.asarray(wanted >= order[min(cut, len(order) - 1)], dtype=np.float64)


def _unexplained(
    residuals: FloatArray, by_global: FloatArray, by_view: FloatArray
) -> tuple[float, int, FloatArray]:
    """Return (sum of squares in px² that remains after fitting all columns, number of parameters, the common ones).

    Directions of the views that cannot be observed, as of a small board's motion, are left out.
    """
    scale = np.linalg.norm(by_view, axis=1, keepdims=True)
    unit_view = by_view / np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(unit_view.transpose(0, 2, 1) @ unit_view)
    sure = values > SMALLEST_SINGULAR**2 * values[:, -1:]
    U = unit_view @ (vectors * np.where(sure, 1 / np.sqrt(np.where(sure, values, 1.0)), 0.0)[:, None, :])
    # The squares cost directions near the limit half of their digits, which one step of Newton's method gives back.
    U = 1.5 * U - 0.5 * U @ (U.transpose(0, 2, 1) @ U)
    both = np.concatenate([by_global, residuals[..., None]], axis=-1)
    both -= U @ (U.transpose(0, 2, 1) @ both)
    e, flat = both[..., -1], both[..., :-1].reshape(residuals.size, -1)
    size = np.linalg.norm(flat, axis=0)
    size = np.where(size > 0, size, 1.0)
    unit = flat / size
    solution = np.linalg.lstsq(unit, e.ravel(), rcond=1e-10)
    left = float(((e.ravel() - unit @ solution[0]) ** 2).sum())
    return left, int(sure.sum()) + int(solution[2]), solution[0] / size


def corner_noise(observations: Observations) -> float | None:
    """Return the standard deviation of one coordinate, px, from neighbouring corners, without a camera model.

    It uses the median, since displaced corners are not noise.

    Returns:
        The standard deviation; None if no row of five neighbouring corners was seen.
    """
    board = observations.board
    if not isinstance(board, Board) or len(board.points) != board.rows * board.columns:
        return None
    weights = np.array(FOURTH_DIFFERENCE)
    corners = np.full((len(observations.views), len(board.points), 2), np.nan)
    for row, view in enumerate(observations.views):
        corners[row, view.ids] = view.image_points
    grid = corners.reshape(-1, board.rows, board.columns, 2)
    found: list[FloatArray] = []
    for along in (grid, grid.transpose(0, 2, 1, 3)):
        last = along.shape[2] - len(weights) + 1
        if last > 0:
            left = np.tensordot(
                np.lib.stride_tricks.sliding_window_view(along, len(weights), axis=2), weights, axes=1
            )
            found.append(np.abs(left[np.isfinite(left)]))
    every = np.concatenate(found) if found else np.empty(0)
    return NORMAL_MAD * float(np.median(every)) / math.sqrt(float(weights @ weights)) if len(every) else None
