"""Image circle of a fisheye lens: the part of the frame that shows something.

Outside the circle every frame is as dark as every other. The brightest value that each place of the frame ever has
shows where that is: within the circle something bright passes sooner or later.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calib.frames import Gray
from calibrary.calibration import ImageSize
from calibrary.quality import ImageCircle

SIDE: Final = 160
"""Cells along the longer side of the frame; each has the mean of its pixels."""
BRIGHT: Final = 90.0
"""Percentile of the cells that counts as bright."""
DARK: Final = 0.1
"""Cells that never reach this share of it, above the darkest, count as dark."""
MANY: Final = 10
"""One frame in so many may have a glare outside the circle."""
MOSTLY: Final = 0.75
"""Share of the cells outside a circle that have to be dark: the lens may reflect light there."""
FEWEST_DARK: Final = 0.02
"""Smallest share of the frame outside a circle."""
FEWEST_DIRECTIONS: Final = 24
DIRECTIONS: Final = 180
NEAREST_EDGE: Final = 1.5
"""Cells; a boundary nearer to the frame's edge than this is the edge."""
OFF_CENTRE: Final = 0.15
"""Largest distance of the circle's centre from the frame's, relative to the shorter side."""
ROUND: Final = 0.02
"""Largest median distance of the boundary from the circle, relative to its radius."""
ROUNDS: Final = 8


def brightness(gray: Gray) -> FloatArray:
    """Return the mean brightness of the cells of a frame, (rows, columns), from some eight rows of pixels of each."""
    height, width = gray.shape
    step = max(1, round(max(width, height) / SIDE))
    rows, columns = height // step, width // step
    cut = gray[: rows * step, : columns * step].reshape(rows, step, columns, step)
    cut = cut[:, :: max(1, step // 8)]
    return np.asarray(cut.mean(axis=(1, 3), dtype=np.float32), dtype=np.float64)


def find_circle(frames: Sequence[FloatArray], image_size: ImageSize) -> ImageCircle | None:
    """Return the image circle, px; None if the image fills the frame.

    Args:
        frames: brightness of each frame, all of one shape.
        image_size: (width, height) px.
    """
    if not frames:
        return None
    most = np.sort(np.stack(frames), axis=0)[len(frames) - 1 - len(frames) // MANY]
    floor = float(most.min())
    dark = most < floor + DARK * (float(np.percentile(most, BRIGHT)) - floor)
    corners = (dark[:2, :2], dark[:2, -2:], dark[-2:, :2], dark[-2:, -2:])
    if dark.mean() < FEWEST_DARK or sum(bool(one.all()) for one in corners) < 3:
        return None
    rows, columns = dark.shape
    edge = _boundary(~dark)
    if len(edge) < FEWEST_DIRECTIONS:
        return None
    x, y, radius = _fitted(edge)
    off = np.abs(np.hypot(edge[:, 0] - x, edge[:, 1] - y) - radius)
    off_centre = np.hypot(x - columns / 2, y - rows / 2) / min(rows, columns)
    if not (np.median(off) <= ROUND * radius and off_centre <= OFF_CENTRE):
        return None
    across, down = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    outside = np.hypot(across - x, down - y) > radius * (1 + 2 * ROUND)
    # What a circle leaves out has to be dark nearly everywhere, and there has to be enough of it.
    if outside.mean() < FEWEST_DARK or dark[outside].mean() < MOSTLY:
        return None
    scale = np.array(image_size) / (columns, rows)
    return ImageCircle(
        x=float(x * scale[0]), y=float(y * scale[1]), radius=float(radius * np.sqrt(scale.prod()))
    )


def _boundary(bright: BoolArray) -> FloatArray:
    """Return the outermost bright cell in each direction from the middle, (N, 2), without those at the frame's edge."""
    rows, columns = bright.shape
    middle = np.array([columns, rows]) / 2
    reach = np.arange(0.0, float(np.hypot(columns, rows)) / 2, 0.5)
    found = []
    for angle in np.linspace(0, 2 * np.pi, DIRECTIONS, endpoint=False):
        along = middle + reach[:, None] * (np.cos(angle), np.sin(angle))
        along = along[((along >= 0) & (along < (columns, rows))).all(axis=1)]
        lit = np.flatnonzero(bright[along[:, 1].astype(np.intp), along[:, 0].astype(np.intp)])
        if not len(lit):
            continue
        last = along[lit[-1]]
        gap = min(*last, *(np.array([columns, rows]) - last))
        if gap > NEAREST_EDGE:
            found.append(last)
    return np.array(found).reshape(-1, 2)


def _fitted(points: FloatArray) -> tuple[float, float, float]:
    """Fit a circle to points with outliers on its inside; return x, y and the radius."""
    weight = np.ones(len(points))
    x = y = radius = 0.0
    for _ in range(ROUNDS):
        A = np.column_stack([points, np.ones(len(points))]) * weight[:, None]
        a, b, c = np.linalg.lstsq(A, (points**2).sum(axis=1) * weight, rcond=None)[0].tolist()
        x, y = a / 2, b / 2
        radius = float(np.sqrt(max(c + x * x + y * y, 0.0)))
        off = np.hypot(points[:, 0] - x, points[:, 1] - y) - radius
        scale = max(float(np.median(np.abs(off))), 0.5)
        weight = 1.0 / (1.0 + (off / (2 * scale)) ** 2)
    return x, y, radius
