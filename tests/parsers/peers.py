"""OpenCV as the independent projection of a camera that was read."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from calibrary.calibration import Calibration
from calibrary.distortion import KannalaBrandt


def assert_projects_as_opencv(
    item: Calibration, K: Sequence[float], D: Sequence[float], *, fisheye: bool = False
) -> None:
    """Hold a camera's projection against cv2's.

    Args:
        item: what was read.
        K: fx, fy, cx, cy in OpenCV's own count, from the centre of the top-left pixel.
        D: its distortion coefficients in OpenCV's order.
        fisheye: whether they are those of cv2.fisheye.
    """
    fx, fy, cx, cy = K
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 13), np.linspace(-0.4, 0.4, 11))
    rays = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    expected = project(rays.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), matrix, np.array(D))[0]
    np.testing.assert_allclose(item.project(rays) - 0.5, expected.reshape(-1, 2), rtol=0, atol=1e-9)
    assert isinstance(item.distortion, KannalaBrandt) == fisheye
