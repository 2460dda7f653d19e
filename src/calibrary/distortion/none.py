"""A lens, or an image already corrected, that is known to be free of distortion."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Distortion, as_rows, finite_pair

__all__ = ["NoDistortion"]


class NoDistortion(Distortion):
    """Distorted = undistorted. This is a statement; an *unknown* distortion is ``None``, not this."""

    model: ClassVar[str] = "none"

    def distort(self, xy: FloatArray) -> FloatArray:
        """The same coordinates; a row that is not finite becomes NaN."""
        return _copied(xy)

    def undistort(self, xy: FloatArray) -> FloatArray:
        """The same coordinates; a row that is not finite becomes NaN."""
        return _copied(xy)

    def valid_radius(self) -> float:
        """Infinite: a pinhole has no limit."""
        return math.inf


def _copied(xy: FloatArray) -> FloatArray:
    copy = np.array(as_rows(xy, 2))
    finite_pair(copy[:, 0], copy[:, 1])
    return copy
