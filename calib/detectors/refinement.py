"""A small copy of the image to look for the board in, and saddle points measured at full resolution."""

from __future__ import annotations

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.frames import Gray

__all__ = ["DETECTION_SIDE", "half_window", "reduced", "refined"]


DETECTION_SIDE = 1280
"""px of the longer side. The corners come out the same as from the full image, at a hundredth of the time."""

SMALLEST_WINDOW, LARGEST_WINDOW = 3, 15
WINDOW_SHARE = 0.3
"""Of the spacing. A window that reaches near the next corner, as a fixed one of 11 px does where squares are
small, pulls the corner: half a percent of the focal length in OpenCV's own sample set."""

ITERATIONS, STEP_PX = 60, 0.001


def reduced(gray: Gray, side: int = DETECTION_SIDE) -> tuple[Gray, FloatArray]:
    """The image with its longer side at most ``side`` px.

    Returns:
        The smaller image, and how much larger the given one is, (x, y).
    """
    import cv2

    height, width = gray.shape
    if max(width, height) <= side:
        return gray, np.ones(2)
    shrink = side / max(width, height)
    size = max(1, round(width * shrink)), max(1, round(height * shrink))
    small = np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return small, np.array([width / size[0], height / size[1]])


def half_window(spacing_px: float, free_share: float = WINDOW_SHARE) -> int:
    """Half the side of the window, px, in which a corner is measured."""
    return int(np.clip(round(min(WINDOW_SHARE, free_share) * spacing_px), SMALLEST_WINDOW, LARGEST_WINDOW))


def refined(gray: Gray, corners: FloatArray, half: int) -> FloatArray:
    """Saddle points near ``corners``.

    Args:
        gray: (H, W).
        corners: (…, 2) px as OpenCV counts them.
        half: of the window's side, px.
    """
    import cv2

    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, ITERATIONS, STEP_PX)
    # A copy: the function writes into what it is given. (N, 1, 2) suits OpenCV 4 and 5 alike.
    start = np.array(corners, dtype=np.float32).reshape(-1, 1, 2)
    found = cv2.cornerSubPix(gray, start, (half, half), (-1, -1), criteria)
    return np.asarray(found, dtype=np.float64).reshape(corners.shape)
