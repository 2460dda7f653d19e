"""What is left in the residuals, and which known faults would explain it.

Each fault is added to the solution as further parameters, to first order, and what it leaves of the sum of squares is
compared with what the others leave. Six velocities a view fit nearly anything, a changing focus and a sheet that bends
as well as a rolling shutter: so a fault is named alone only where it beats every other clearly, and each pays for its
parameters (Schwarz's criterion, for the question here is which model is true).

None of them is named at all while the residuals are no larger than the noise of single corners, which is known
without any camera model, or where the best leaves most of the excess over it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import StrEnum
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted
from calibrary.calib.board import Board
from calibrary.calib.model_choice import f_test
from calibrary.calib.observations import Observations
from calibrary.calibration import ImageSize
from calibrary.probability import chi_square_tail
from calibrary.records import Record

__all__ = ["Cause", "Misfit", "corner_noise", "misfit"]


FOURTH_DIFFERENCE: Final = (1.0, -4.0, 6.0, -4.0, 1.0)
"""Of five neighbouring corners; perspective and distortion pass through it with next to nothing left."""
NORMAL_MAD: Final = 1.4826
LEVEL: Final = 1e-4
SMALLEST_SINGULAR: Final = 1e-5
CLEARLY: Final = 0.1
"""A cause is named alone where the next leaves this share more of the sum of squares, its parameters paid for."""
SUBSTANTIAL: Final = 10.0
"""By so much Schwarz's criterion must fall before there is anything to explain (very strong, in its usual terms)."""
FEWEST_TO_SCATTER: Final = 12
"""Corners of a view, to tell how they scatter."""
EXCESS_EXPLAINED: Final = 0.5
"""Share of the excess over noise that a cause must explain to be named."""


MOST_ALIKE: Final = 0.3
"""Correlation of neighbouring corners' residuals: blur makes each corner uncertain by itself, every other fault moves
neighbours together."""


class Cause(StrEnum):
    """A fault of the camera, of how it was held, or of the board where that is not solved for."""

    ROLLING_SHUTTER = "rolling-shutter"
    FOCUS_CHANGES = "focus-changes"
    TWO_CAMERAS = "two-cameras"
    STABILISED = "stabilised"
    BOARD_FLEXES = "board-flexes"
    STRETCHED_PRINT = "stretched-print"
    MOTION_BLUR = "motion-blur"


class Rival(Record):
    """What one fault makes of the residuals.

    Attributes:
        cause: which.
        left_px: standard deviation of a coordinate that it leaves unexplained.
        criterion: Schwarz's, against no fault at all; the lowest explains best.
        p: chance of such a gain from noise.
    """

    cause: Cause
    left_px: float
    criterion: float
    p: float


class Misfit(Record):
    """The faults, the likeliest first.

    Attributes:
        rivals: those that were tried.
        sigma_px: standard deviation of a coordinate with none of them.
        noise_px: the same as neighbouring corners show it, None where they do not.
        scalars: measured coordinates.
    """

    rivals: tuple[Rival, ...]
    sigma_px: float
    noise_px: float | None
    scalars: int

    @property
    def likely(self) -> tuple[Rival, ...]:
        """One where it beats the others clearly, else two; none where nothing explains much."""
        noise = min(self.noise_px or 0.0, self.sigma_px)
        excess = self.sigma_px**2 - noise**2
        able = [one for one in self.rivals if one.p < LEVEL]
        if (
            not able
            or able[0].criterion > -SUBSTANTIAL
            or self.sigma_px**2 - able[0].left_px ** 2 <= EXCESS_EXPLAINED * excess
        ):
            return ()
        margin = self.scalars * math.log1p(CLEARLY)
        alone = len(able) == 1 or able[1].criterion - able[0].criterion > margin
        return tuple(able[:1] if alone else able[:2])


def misfit(adjusted: Adjusted, image_size: ImageSize, noise_px: float | None) -> Misfit | None:
    """Let the known faults compete; None where there are too few corners for it.

    Args:
        adjusted: the solution.
        image_size: (width, height) px.
        noise_px: of one coordinate, as :func:`corner_noise` gives it.
    """
    network, linear = adjusted.network, adjusted.linear
    used = network.used
    residuals, by_pose = linear.residuals[used], linear.by_pose[used]
    by_global = linear.by_global[used][..., adjusted.free]
    still, rank = _unexplained(residuals, by_global, by_pose)
    n = network.scalars
    if n - rank < len(residuals):
        return None
    found = [] if (blur := _blur(adjusted, n, rank)) is None else [blur]
    for cause, globals_too, by_view in _faults(adjusted, image_size):
        left, more = _unexplained(residuals, globals_too, by_view)
        dof, extra = n - more, more - rank
        if dof < extra or extra <= 0:
            continue
        found.append(
            Rival(
                cause=cause,
                left_px=math.sqrt(left / dof),
                # Which view belongs to which of two cameras is chosen by the residuals too: a bit for each.
                criterion=n * math.log(max(left, 1e-300) / still)
                + extra * math.log(n)
                + (2 * math.log(2) * len(residuals) if cause is Cause.TWO_CAMERAS else 0.0),
                p=f_test(still, left, extra, dof)[1],
            )
        )
    return Misfit(
        rivals=tuple(sorted(found, key=lambda one: one.criterion)),
        sigma_px=math.sqrt(still / (n - rank)),
        noise_px=noise_px,
        scalars=n,
    )


def _faults(adjusted: Adjusted, image_size: ImageSize) -> Iterator[tuple[Cause, FloatArray, FloatArray]]:
    """Each fault as columns: (V, 2M, g) the same for all views, and (V, 2M, k) of each view by itself."""
    network, linear, state = adjusted.network, adjusted.linear, adjusted.state
    used, lens = network.used, len(state.parameters)
    residuals, by_pose = linear.residuals[used], linear.by_pose[used]
    everything, seen = linear.by_global[used], network.seen[used]
    by_global = everything[..., adjusted.free]
    zoom = everything[..., 0] * state.parameters[0] + everything[..., 1] * state.parameters[1]

    def each(columns: FloatArray) -> FloatArray:
        return np.concatenate([by_pose, columns], axis=-1)

    # Where the corners should be, not where they were seen: else their noise would explain itself.
    rows = np.where(seen, network.pixels[used, :, 1] - residuals[:, 1::2], 0.0)
    # Time within each view, about its own middle: else a small board's motion could not be separated from its pose.
    time = np.where(seen, rows - (rows.sum(axis=1) / seen.sum(axis=1))[:, None], 0.0) / image_size[1]
    yield Cause.ROLLING_SHUTTER, by_global, each(by_pose * np.repeat(time, 2, axis=1)[..., None])
    yield Cause.FOCUS_CHANGES, by_global, each(zoom[..., None])
    yield Cause.STABILISED, by_global, each(everything[..., 2:4])
    of_one = _two_kinds(residuals, by_pose, zoom)
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
    """Corners of each view that are uncertain along one direction, that of the motion while the shutter was open.

    It moves no corner by a rule, it widens their scatter, so what it explains is judged by the likelihood of normal
    residuals of that scatter. None where neighbouring corners are off together, or the scatter is no more elongated
    than chance makes it.
    """
    network, residuals = adjusted.network, adjusted.linear.residuals
    shape, alone, by_view, together, alike = network.seen.shape, 0.0, 0.0, 0.0, 0.0
    views = np.flatnonzero(network.seen.sum(axis=1) >= FEWEST_TO_SCATTER).tolist()
    errors = residuals.reshape(*shape, 2)
    for row in views:
        own = errors[row][network.seen[row]]
        count = len(own)
        small, large = np.linalg.eigvalsh(own.T @ own / count)
        if not small > 0:
            return None
        by_view += count * float(np.log(small) + np.log(large))
        alone += 2 * count * math.log((small + large) / 2)
        alike += float((own[1:] * own[:-1]).sum())
        together += float((own**2).sum())
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


def _two_kinds(residuals: FloatArray, by_pose: FloatArray, zoom: FloatArray) -> FloatArray:
    """(V,) 1 for the views of the one of two focal lengths, 0 for those of the other, where the gap is widest."""
    wanted = np.zeros(len(residuals))
    for row, (e, A, c) in enumerate(zip(residuals, by_pose, zoom, strict=True)):
        basis = np.linalg.qr(A)[0]
        left = c - basis @ (basis.T @ c)
        wanted[row] = float(left @ e) / max(float(left @ left), 1e-300)
    order = np.sort(wanted)
    # Two means in one dimension: the cut that leaves the least within both.
    within = [order[:at].var() * at + order[at:].var() * (len(order) - at) for at in range(1, len(order))]
    cut = 1 + int(np.argmin(within)) if within else 0
    return np.asarray(wanted >= order[min(cut, len(order) - 1)], dtype=np.float64)


def _unexplained(residuals: FloatArray, by_global: FloatArray, by_view: FloatArray) -> tuple[float, int]:
    """(px², rank): what is left of the residuals when everything has done its best, and by how many parameters.

    By singular values rather than normal equations: a small board's motion has directions that show nowhere.
    """
    scale = np.linalg.norm(by_view, axis=1, keepdims=True)
    U, values, _ = np.linalg.svd(by_view / np.where(scale > 0, scale, 1.0), full_matrices=False)
    U = U * (values > SMALLEST_SINGULAR * values[:, :1])[:, None, :]
    rank = int((values > SMALLEST_SINGULAR * values[:, :1]).sum())
    e: FloatArray = residuals - np.einsum("vmk,vk->vm", U, np.einsum("vmk,vm->vk", U, residuals))
    carried: FloatArray = by_global - U @ (U.transpose(0, 2, 1) @ by_global)
    flat = carried.reshape(residuals.size, -1)
    size = np.linalg.norm(flat, axis=0)
    unit = flat / np.where(size > 0, size, 1.0)
    solution = np.linalg.lstsq(unit, e.ravel(), rcond=1e-10)
    return float(((e.ravel() - unit @ solution[0]) ** 2).sum()), rank + int(solution[2])


def corner_noise(observations: Observations) -> float | None:
    """px, standard deviation of one coordinate as neighbouring corners show it, whatever the camera model.

    By the median, for a corner that is displaced is no noise.

    Returns:
        None where no row of five neighbouring corners was seen.
    """
    board = observations.board
    if not isinstance(board, Board) or len(board.points) != board.rows * board.columns:
        return None
    weights = np.array(FOURTH_DIFFERENCE)
    found: list[FloatArray] = []
    for view in observations.views:
        corners = np.full((len(board.points), 2), np.nan)
        corners[view.ids] = view.image_points
        grid = corners.reshape(board.rows, board.columns, 2)
        for along in (grid, grid.transpose(1, 0, 2)):
            if along.shape[1] < len(weights):
                continue
            left = np.lib.stride_tricks.sliding_window_view(along, len(weights), axis=1) @ weights
            found.append(np.abs(left[np.isfinite(left)]))
    every = np.concatenate(found) if found else np.empty(0)
    return NORMAL_MAD * float(np.median(every)) / math.sqrt(float(weights @ weights)) if len(every) else None
