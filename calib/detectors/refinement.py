"""A reduced copy of the image for detection, and measurement of saddle points at full resolution."""

from __future__ import annotations

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.frames import Gray

DETECTION_SIDE = 1280
"""Longer side in px of the copy. The corners equal those from the full image, in a hundredth of the time."""

HALVED_FROM = 3
"""Reduction from which an image is halved first: to average whole pixels takes OpenCV a tenth of the time."""

SMALLEST_WINDOW, LARGEST_WINDOW = 3, 15
WINDOW_SHARE = 0.3
"""Half-width of the window in spacings. A window that reaches close to the next corner biases the corner, like a fixed
one of 11 px with small squares: half a percent of the focal length in OpenCV's own sample set."""

ITERATIONS, STEP_PX = 60, 0.001


def reduced(gray: Gray, side: int = DETECTION_SIDE) -> tuple[Gray, FloatArray]:
    """Return the image reduced to at most ``side`` px along its longer side.

    Returns:
        The reduced image, and the scale (x, y) from it to the given one.
    """
    import cv2

    height, width = gray.shape
    if max(width, height) <= side:
        return gray, np.ones(2)
    shrink = side / max(width, height)
    size = max(1, round(width * shrink)), max(1, round(height * shrink))
    halved = 1
    while max(gray.shape) >= HALVED_FROM * side and min(gray.shape) > 1:
        # Without an odd last row or column: OpenCV would leave it out and count it.
        even = gray[: gray.shape[0] // 2 * 2, : gray.shape[1] // 2 * 2]
        half = cv2.resize(even, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        gray, halved = np.asarray(half, dtype=np.uint8), 2 * halved
    small = np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return small, halved * np.array([gray.shape[1] / size[0], gray.shape[0] / size[1]])


def enlarged(points: FloatArray, scale: FloatArray) -> FloatArray:
    """Return points of a reduced copy in the image; OpenCV's pixel origin lies half a pixel of either inside."""
    return (points + 0.5) * scale - 0.5


def half_window(spacing_px: float, free_share: float = WINDOW_SHARE) -> int:
    """Return half the side in px of the window in which a corner is measured."""
    return int(np.clip(round(min(WINDOW_SHARE, free_share) * spacing_px), SMALLEST_WINDOW, LARGEST_WINDOW))


def refined(gray: Gray, corners: FloatArray, half: int) -> FloatArray:
    """Measure the saddle points near ``corners``.

    Args:
        gray: (H, W).
        corners: (…, 2) px with OpenCV's pixel origin.
        half: half the side of the window, px.
    """
    import cv2

    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, ITERATIONS, STEP_PX)
    # A copy, since the function overwrites its input. (N, 1, 2) works with OpenCV 4 and 5.
    start = np.array(corners, dtype=np.float32).reshape(-1, 1, 2)
    found = cv2.cornerSubPix(gray, start, (half, half), (-1, -1), criteria)
    return np.asarray(found, dtype=np.float64).reshape(corners.shape)
