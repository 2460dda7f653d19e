"""Frames that were turned or mirrored: a ray and its pixel are turned together, whatever the lens model."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.projection_difference import pixel_grid
from calibrary.calibration import Calibration, ImageSize
from calibrary.jobs.diff.verdicts import Kind

TURNED_PX: Final = 0.05
"""Pixels of a turned frame that differ by less are the same numbers."""
LEAST_PX: Final = 1.0
"""Frames that differ by less whichever way they are turned do not show the way."""
SEEN: Final = (9, 7)
"""Columns and rows of the pixels at which causes are compared."""

Turn: TypeAlias = tuple[tuple[int, int], tuple[int, int]]
TURNS: Final[dict[Turn, tuple[Kind, str]]] = {
    ((-1, 0), (0, -1)): (Kind.TURNED, "the frame was turned by 180°"),
    ((-1, 0), (0, 1)): (Kind.MIRRORED, "the frame was mirrored left to right"),
    ((1, 0), (0, -1)): (Kind.MIRRORED, "the frame was mirrored top to bottom"),
}
QUARTERS: Final[dict[Turn, tuple[Kind, str]]] = {
    ((0, -1), (1, 0)): (Kind.TURNED, "the frame was turned by 90° clockwise"),
    ((0, 1), (-1, 0)): (Kind.TURNED, "the frame was turned by 270° clockwise"),
}
Pixels: TypeAlias = Callable[[Calibration], FloatArray]
"""What a map makes of a calibration: the pixels of given rays."""


def turns(size: ImageSize, other: ImageSize) -> dict[Turn, tuple[Kind, str]]:
    """Return the turns that keep the image size, each with what it is called."""
    if size != other:
        return {}
    return TURNS | QUARTERS if size[0] == size[1] else TURNS


def turned(turn: Turn, rays: FloatArray, image_size: ImageSize) -> Pixels:
    """Pixels in a turned frame of ``image_size``, which may also have another scale."""
    M = np.array(turn, dtype=np.float64)
    back = np.column_stack([rays[:, :2] @ M, rays[:, 2:]])

    def pixels_of(calibration: Calibration) -> FloatArray:
        size = np.array(calibration.intrinsics.image_size)
        by = image_size[0] / float(np.abs(M[0]) @ size)
        return np.asarray((calibration.project(back) - size / 2) @ M.T * by + np.array(image_size) / 2)

    return pixels_of


def seen(b: Calibration) -> tuple[FloatArray, FloatArray]:
    """Pixels over the frame and their rays."""
    at = pixel_grid(b.intrinsics.image_size, SEEN).reshape(-1, 2)
    rays = b.unproject(at)
    known = np.isfinite(rays).all(axis=1)
    return at[known], rays[known]


def is_turned(a: Calibration, b: Calibration, turn: Turn) -> bool:
    """Whether ``b`` is ``a`` turned, to the digits of a file; the axis is asked first, which is quick."""
    axis, size = np.array([[0.0, 0.0, 1.0]]), b.intrinsics.image_size
    on_axis = float(np.hypot(*(turned(turn, axis, size)(a) - b.project(axis))[0]))
    return not on_axis > TURNED_PX and _apart_px(a, b, turn) <= TURNED_PX


def _apart_px(a: Calibration, b: Calibration, turn: Turn) -> float:
    at, rays = seen(b)
    apart = np.hypot(*(turned(turn, rays, b.intrinsics.image_size)(a) - at).T)
    return float(np.nanmax(apart, initial=0.0)) if np.isfinite(apart).any() else math.inf


def quarter_turn(a: Calibration, b: Calibration) -> str:
    """Direction of a quarter turn, as far as the pixels show it, in words."""
    (near, said), (far, _) = sorted((_apart_px(a, b, turn), reason) for turn, (_, reason) in QUARTERS.items())
    if far < LEAST_PX or far < 2 * near:
        return "the frame was turned by 90°, one way or the other"
    return said
