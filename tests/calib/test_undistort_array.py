"""``calibrary.undistort``: an array, at its own size, with K as it is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import calibrary
from calibrary.errors import FrameError, UnsupportedModelError
from calibrary.records import replace

K = [[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]]
CAMERA = calibrary.Calibration.from_opencv(K, [-0.1, 0.01, 0, 0, 0], image_size=(320, 240))


@pytest.mark.parametrize("size", [(320, 240), (640, 480)])
def test_an_array_is_undistorted_as_opencv_does_at_its_own_size(size: tuple[int, int]) -> None:
    width, height = size
    image = np.tile(np.linspace(0, 200, width).astype(np.uint8), (height, 1))
    matrix, dist = CAMERA.scaled(size).to_opencv()
    expected = cv2.undistort(image, matrix, dist)
    found = calibrary.undistort(image, CAMERA)
    inner = np.s_[height // 4 : -height // 4, width // 4 : -width // 4]
    assert np.abs(found[inner].astype(int) - expected[inner]).max() <= 2


def test_what_cannot_be_undistorted_is_refused() -> None:
    with pytest.raises(FrameError):
        calibrary.undistort(np.zeros((240, 240), np.uint8), CAMERA)
    with pytest.raises(UnsupportedModelError):
        calibrary.undistort(np.zeros((240, 320), np.uint8), replace(CAMERA, distortion=None))
