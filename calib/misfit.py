"""What is left in the residuals, and which known fault would explain it.

A fault is added to the solution as further parameters, to first order, and the sum of squares it would save is held
against what noise would save.

A shutter that reads row after row shears and stretches each view in its own way while camera or board move. So do
other things, a board that flexes above all; but only where motion explains the views *down to the noise of single
corners*, which is known without any camera model, is it named as the cause.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted
from calibrary.calib.board import Board
from calibrary.calib.model_choice import f_test
from calibrary.calib.network import Linear
from calibrary.calib.observations import Observations
from calibrary.calibration import ImageSize
from calibrary.records import Record, replace

__all__ = ["Shutter", "corner_noise", "rolling_shutter"]


FOURTH_DIFFERENCE: Final = (1.0, -4.0, 6.0, -4.0, 1.0)
"""Of five neighbouring corners; perspective and distortion pass through it with next to nothing left."""
SHUTTER_LEVEL: Final = 1e-4
SMALLEST_SINGULAR: Final = 1e-5
LEFT_BY_MOTION: Final = 1.2
"""What is left when the cause is found is corner noise; its estimate from neighbours is this good."""


class Shutter(Record):
    """Motion of each view while its rows were read.

    Attributes:
        f: of six velocities a view.
        p: chance of such an F from noise.
        left_px: standard deviation of a coordinate that motion leaves unexplained.
        noise_px: the same as neighbouring corners show it, None where they do not; then nothing is named.
    """

    f: float
    p: float
    left_px: float
    noise_px: float | None

    @property
    def is_rolling(self) -> bool:
        """Whether there is motion, and nothing but noise beside it."""
        explained = self.noise_px is not None and self.left_px <= LEFT_BY_MOTION * self.noise_px
        return self.p < SHUTTER_LEVEL and explained


def rolling_shutter(adjusted: Adjusted, image_size: ImageSize, noise_px: float | None) -> Shutter | None:
    """Test for motion along the rows, whatever the print's stretch; None where there are too few corners for it.

    Args:
        adjusted: the solution.
        image_size: (width, height) px.
        noise_px: of one coordinate, as :func:`corner_noise` gives it.
    """
    network = adjusted.network
    linear, free = _with_stretch(adjusted) if network.is_planar else (adjusted.linear, adjusted.free)
    used = network.used
    residuals, by_global = linear.residuals[used], linear.by_global[used][..., free]
    by_pose, seen = linear.by_pose[used], network.seen[used]
    # Where the corners should be, not where they were seen: else their noise would explain itself.
    rows = np.where(seen, network.pixels[used, :, 1] - residuals[:, 1::2], 0.0)
    # Time within each view, about its own middle: else a small board's motion could not be told from its pose.
    time = np.where(seen, rows - (rows.sum(axis=1) / seen.sum(axis=1))[:, None], 0.0) / image_size[1]
    moving = np.concatenate([by_pose, by_pose * np.repeat(time, 2, axis=1)[..., None]], axis=-1)
    still_rss, still_rank = _unexplained(residuals, by_global, by_pose)
    left_rss, left_rank = _unexplained(residuals, by_global, moving)
    dof, extra = network.scalars - left_rank, left_rank - still_rank
    if dof < extra or extra <= 0:
        return None
    f, p = f_test(still_rss, left_rss, extra, dof)
    return Shutter(f=f, p=p, left_px=math.sqrt(left_rss / dof), noise_px=noise_px)


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

    Returns:
        None where no row of five neighbouring corners was seen.
    """
    board = observations.board
    if not isinstance(board, Board) or len(board.points) != board.rows * board.columns:
        return None
    total, count = 0.0, 0
    weights = np.array(FOURTH_DIFFERENCE)
    for view in observations.views:
        corners = np.full((len(board.points), 2), np.nan)
        corners[view.ids] = view.image_points
        grid = corners.reshape(board.rows, board.columns, 2)
        for along in (grid, grid.transpose(1, 0, 2)):
            if along.shape[1] < len(weights):
                continue
            windows = np.lib.stride_tricks.sliding_window_view(along, len(weights), axis=1)
            left = windows @ weights
            whole = np.isfinite(left)
            total += float((left[whole] ** 2).sum())
            count += int(whole.sum())
    return math.sqrt(total / count / float(weights @ weights)) if count else None


def _with_stretch(adjusted: Adjusted) -> tuple[Linear, NDArray[np.intp]]:
    """The linearised network with one more global column, of the print's length down, and what is free in it."""
    turns, points = adjusted.state.rotations, adjusted.network.points
    by_place = adjusted.linear.by_pose[..., 3:].reshape(*points.shape[:2], 2, 3)
    column = np.einsum("vmcx,vx,vm->vmc", by_place, turns[:, :, 1], points[..., 1])
    by_global = np.concatenate([adjusted.linear.by_global, column.reshape(len(turns), -1, 1)], axis=-1)
    return replace(adjusted.linear, by_global=by_global), np.append(adjusted.free, by_global.shape[-1] - 1)
