"""Aerial pictures that compress well: drawn small and enlarged smoothly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrary.calibration import ImageSize

__all__ = ["farmland", "infrared"]

_STEP = 24
"""Picture pixels per drawn cell."""
_WHOLE = 4
_CROPS = ((96, 128, 62), (128, 148, 78), (170, 160, 98), (146, 122, 84), (80, 110, 70), (186, 176, 122))
_IRON = ((12, 6, 40), (96, 12, 120), (190, 44, 90), (240, 120, 30), (252, 208, 70), (255, 252, 220))


def farmland(size: ImageSize, *, seed: int, along: float = 0.0) -> NDArray[np.uint8]:
    """Fields with tractor lines and paths between them, seen from above.

    Args:
        size: (width, height) px.
        seed: of the random landscape.
        along: distance flown, in picture heights.

    Returns:
        (H, W, 3) uint8 RGB, the same bytes for the same arguments.
    """
    x, y = _cells(size)
    y = y - along
    random = np.random.default_rng(seed)
    angle = random.uniform(0.1, 0.5)
    u, v = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    u = u + 0.03 * np.sin(5 * v + random.uniform(0, 6))
    column, row = np.floor(u * 3.1).astype(int), np.floor(v * 4.3).astype(int)
    crops = np.array(_CROPS, dtype=np.float64)[random.permutation(len(_CROPS))]
    picture = crops[(column * 7 + row * 5) % len(crops)]
    lines = 6 * np.sin(90 * u) + 10 * np.sin(7 * x + 3 * np.sin(4 * y))
    picture = picture + lines[..., None]
    path = (u * 3.1 % 1 < 0.05) | (v * 4.3 % 1 < 0.05)
    picture[path] = (206, 198, 178)
    return _enlarged(picture, size)


def infrared(size: ImageSize, *, seed: int) -> NDArray[np.uint8]:
    """Warm spots on cool ground in the iron palette of thermal cameras.

    Returns:
        (H, W, 3) uint8 RGB, the same bytes for the same arguments.
    """
    x, y = _cells(size, step=4)
    random = np.random.default_rng(seed)
    heat = 0.25 + 0.1 * np.sin(4 * x + 2 * y)
    for centre_x, centre_y, radius in random.uniform((0.1, 0.1, 0.03), (1.2, 0.9, 0.12), (9, 3)):
        heat = heat + 0.6 * np.exp(-((x - centre_x) ** 2 + (y - centre_y) ** 2) / radius**2)
    at = np.clip(heat, 0, 1) * (len(_IRON) - 1)
    iron = np.array(_IRON, dtype=np.float64)
    channels = [np.interp(at, np.arange(len(iron)), iron[:, channel]) for channel in range(3)]
    return _enlarged(np.stack(channels, axis=-1), size)


def _cells(size: ImageSize, step: int = _STEP) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coordinates x and y of the cell centres, in picture heights."""
    width, height = size
    columns, rows = max(2, width // step), max(2, height // step)
    x = (np.arange(columns) + 0.5) / columns * (width / height)
    y = (np.arange(rows) + 0.5) / rows
    return tuple(np.meshgrid(x, y))  # type: ignore[return-value]


def _enlarged(picture: NDArray[np.float64], size: ImageSize) -> NDArray[np.uint8]:
    """Enlarge smoothly to a quarter of the size, then by whole pixels: a tenth of the time, and no eye sees it."""
    from PIL import Image

    (width, height), (quarter_width, quarter_height) = size, (-(-side // _WHOLE) for side in size)
    small = Image.fromarray(np.clip(picture, 0, 255).astype(np.uint8))
    quarter = np.asarray(small.resize((quarter_width, quarter_height), Image.Resampling.BILINEAR))
    return quarter.repeat(_WHOLE, axis=1).repeat(_WHOLE, axis=0)[:height, :width]
