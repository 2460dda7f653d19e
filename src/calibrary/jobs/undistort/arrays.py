"""Undistortion of an image that is an array already."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from calibrary.calib.undistort import Undistorter
from calibrary.calib.undistort_plan import plan
from calibrary.calibration import Calibration
from calibrary.extras import CALIBRATE, require

Pixel = TypeVar("Pixel", bound=np.generic)


def undistort(image: NDArray[Pixel], calibration: Calibration) -> NDArray[Pixel]:
    """Remove the lens distortion from one image; K stays the same.

    Args:
        image: (H, W) or (H, W, channels), of any size that is the calibration's image resized.
        calibration: of the camera, with known distortion.

    Returns:
        An image of the same size; pixels that the camera did not see are 0.

    Raises:
        FrameError: the image has another aspect ratio than that of the calibration.
        UnsupportedModelError: the distortion is unknown.
        MissingExtraError: OpenCV is not installed.

    >>> import numpy
    >>> camera = calibrary.read("camera.xml")
    >>> calibrary.undistort(numpy.zeros((912, 1368, 3), "uint8"), camera).shape
    (912, 1368, 3)
    """
    require(CALIBRATE, "undistort")
    height, width = image.shape[:2]
    return Undistorter(plan(calibration.scaled((width, height))))(image)
