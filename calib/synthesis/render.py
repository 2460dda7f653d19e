"""Rendering of board images by a known camera."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibrary.calib.board import Board
from calibrary.calib.synthesis.scene import light
from calibrary.calib.synthesis.sensor import expose, jpeg_round_trip
from calibrary.calib.synthesis.settings import Settings
from calibrary.calib.synthesis.sheet import Pose
from calibrary.calibration import Calibration

__all__ = ["render", "render_raw"]

Pixels: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16]


def render(board: Board, calibration: Calibration, pose: Pose, settings: Settings, seed: int) -> Pixels:
    """Render an image as a reader of the file sees it.

    Args:
        board: the board.
        calibration: the true camera; any distortion model.
        pose: pose of the board.
        settings: light, lens, sensor and file.
        seed: seed of backdrop, glare and noise; the same arguments give the same image.

    Returns:
        (H, W) uint8 or uint16, gray. Its corners are those of :func:`seen_corners`.
    """
    pixels = render_raw(board, calibration, pose, settings, seed)
    if settings.quality is None or pixels.dtype != np.uint8:
        return pixels
    return jpeg_round_trip(pixels.astype(np.uint8, copy=False), settings.quality)


def render_raw(board: Board, calibration: Calibration, pose: Pose, settings: Settings, seed: int) -> Pixels:
    """Render the image before compression."""
    frame = light(board, calibration, pose, settings, seed)
    return expose(frame, settings, np.random.default_rng([seed, 2]))
