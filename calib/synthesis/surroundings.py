"""Surroundings of a board: a backdrop out of focus, and the reflection of a lamp."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibrary.calib.synthesis.settings import Settings
from calibrary.calibration import ImageSize

__all__ = ["backdrop", "lamp"]

Light: TypeAlias = NDArray[np.float32]

OCTAVES = (6, 17, 61, 211)
"""Number of blobs across the image, per layer of the backdrop."""
LAMP_SIZE = 0.12
"""Standard deviation of a lamp's reflection, as a share of the board's width in the image."""


def backdrop(size: ImageSize, settings: Settings, random: np.random.Generator) -> Light:
    """Return the light from behind the board, (H, W): blobs of several sizes, like a room out of focus."""
    import cv2

    width, height = size
    picture = np.full((height, width), 0.25, dtype=np.float32)
    for number, blobs in enumerate(OCTAVES):
        rows = max(2, round(blobs * height / width))
        layer = random.random((rows, blobs), dtype=np.float32) - np.float32(0.5)
        strength = np.float32(settings.texture * 0.6 / (number + 1))
        if settings.texture:
            picture += strength * cv2.resize(layer, size, interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.maximum(picture, np.float32(0.01)), dtype=np.float32)


def lamp(
    size: ImageSize, outline: NDArray[np.float64], strength: float, random: np.random.Generator
) -> Light | None:
    """Return the light, (H, W), of a lamp's reflection on the board with the given outline, (M, 2) px."""
    shift = random.uniform(-0.25, 0.25, 2)
    if not strength or not np.isfinite(outline).all():
        return None
    low, high = outline.min(axis=0), outline.max(axis=0)
    centre = (low + high) / 2 + shift * (high - low)
    radius = LAMP_SIZE * (high - low)[0]
    x = np.exp(-0.5 * ((np.arange(size[0]) + 0.5 - centre[0]) / radius) ** 2)
    y = np.exp(-0.5 * ((np.arange(size[1]) + 0.5 - centre[1]) / radius) ** 2)
    return np.asarray(strength * y[:, None] * x, dtype=np.float32)
