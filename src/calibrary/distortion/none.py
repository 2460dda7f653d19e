"""A lens, or an undistorted image, that is known to be free of distortion."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Distortion, as_rows, finite_pair, unit_ray

__all__ = ["NoDistortion"]


class NoDistortion(Distortion):
    """Distorted = undistorted. This states that the lens has no distortion; an *unknown* distortion is ``None``."""

    model: ClassVar[str] = "none"

    def distort(self, xy: FloatArray) -> FloatArray:
        """The same coordinates; a row that is not finite becomes NaN."""
        return _copied(xy)

    def undistort(self, xy: FloatArray) -> FloatArray:
        """The same coordinates; a row that is not finite becomes NaN."""
        return _copied(xy)

    def distort_ray(self, x: float, y: float, z: float, /) -> tuple[float, float] | None:
        """One direction, without arrays."""
        return (x / z, y / z) if z > 0 and math.isfinite(x / z) and math.isfinite(y / z) else None

    def undistort_to_ray(self, x: float, y: float, /) -> tuple[float, float, float] | None:
        """One point, without arrays."""
        return unit_ray(x, y) if math.isfinite(x) and math.isfinite(y) else None

    def valid_radius(self) -> float:
        """Infinite: a pinhole has no limit."""
        return math.inf


def _copied(xy: FloatArray) -> FloatArray:
    copy = np.array(as_rows(xy, 2))
    finite_pair(copy[:, 0], copy[:, 1])
    return copy
