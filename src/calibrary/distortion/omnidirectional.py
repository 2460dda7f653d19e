"""Common parts of the sphere models: two closed-form maps of directions, and their exact inverses.

:func:`lifted` views directions from a point ``xi`` behind the centre of the unit sphere, which brings them closer to
the axis. :func:`divided` divides by a mixture of depth and distance instead of by depth alone, which projects
directions beyond 90° to a plane. The models of C. Mei, B. Khomutenko and V. Usenko consist of one or both.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Columns, Distortion, as_rows, by_columns, finite_pair, perspective

__all__ = ["Omnidirectional", "divided", "lifted", "lowered", "undivided", "unit", "widest", "widest_lifted"]


class Omnidirectional(Distortion):
    """A camera with a field of view that may exceed 90° from the axis, which x/z and y/z cannot express.

    :meth:`distort_rays` and :meth:`undistort_to_rays` are the whole map; :meth:`distort` and :meth:`undistort` are
    its part in front of the camera.
    """

    example_reach_deg: ClassVar[float] = 63.0

    @abstractmethod
    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""

    @abstractmethod
    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN for points without a direction."""

    @abstractmethod
    def max_angle_rad(self) -> float:
        """Angle at which the image radius stops growing or becomes infinite; 0 if no direction has an image."""

    def valid_radius(self) -> float:
        """Tangent of :meth:`max_angle_rad`; ``inf`` if that is 90° or more."""
        angle = self.max_angle_rad()
        return math.tan(angle) if angle < math.pi / 2 else math.inf

    def distort(self, xy: FloatArray) -> FloatArray:
        """Undistorted (x/z, y/z), less than 90° from the axis, to distorted; NaN from :meth:`valid_radius` on."""
        xy = as_rows(xy, 2)
        return self.distort_rays(np.column_stack([xy, np.ones(len(xy))]))

    def undistort(self, xy: FloatArray) -> FloatArray:
        """Distorted to undistorted (x/z, y/z); NaN if the ray is 90° or more from the axis or does not exist."""
        return perspective(self.undistort_to_rays(xy))


def unit(x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the columns of directions, normalised to length 1."""
    # hypot does not overflow where the sum of squares would.
    shrink = 1.0 / np.hypot(np.hypot(x, y), z)
    return x * shrink, y * shrink, z * shrink


def lifted(rays: FloatArray, xi: float) -> FloatArray:
    """View (N, 3) directions from a point ``xi`` behind the centre of the unit sphere.

    With |P| = 1: (x, y, z + xi). From outside the sphere, xi > 1, only the part in front of its outline is visible.
    """

    def moved(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        x, y, z = unit(x, y, z)
        z[~(1.0 + xi * z > 0)] = math.nan
        return x, y, z + xi

    return by_columns(moved if xi > -1 else _unseen(3), rays, 3, 3)


def lowered(rays: FloatArray, xi: float) -> FloatArray:
    """Inverse of :func:`lifted`: (N, 3) unit directions to the original unit directions."""

    def moved(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        inside = 1.0 - xi * xi * (x * x + y * y)
        inside[~(inside > 0)] = math.nan
        reach = xi * z + np.sqrt(inside)
        return reach * x, reach * y, reach * z - xi

    return by_columns(moved if xi > -1 else _unseen(3), rays, 3, 3)


def widest_lifted(angle: float, xi: float) -> float:
    """Return the angle from the axis that :func:`lifted` maps to ``angle``, or the outline's if that is smaller."""
    if xi <= -1:
        return 0.0
    if xi > 1 and angle >= math.asin(1.0 / xi):
        return math.pi / 2 + math.asin(1.0 / xi)
    return min(math.pi, angle + math.asin(max(-1.0, min(1.0, xi * math.sin(angle)))))


def divided(rays: FloatArray, alpha: float, beta: float) -> FloatArray:
    """(N, 3) directions to (N, 2): x and y divided by alpha·d + (1 − alpha)·z, where d² = beta·(x² + y²) + z².

    NaN from the angle at which the divisor vanishes or the image radius stops growing: its derivative by the angle
    has the sign of (1 − alpha)·d + alpha·z.
    """

    def quotient(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        x, y, z = unit(x, y, z)
        d = np.sqrt(beta * (x * x + y * y) + z * z)
        divisor = alpha * d + (1.0 - alpha) * z
        divisor[~((divisor > 0) & ((1.0 - alpha) * d + alpha * z > 0))] = math.nan
        return finite_pair(x / divisor, y / divisor)

    return by_columns(quotient if beta >= 0 else _unseen(2), rays, 3, 2)


def undivided(xy: FloatArray, alpha: float, beta: float) -> FloatArray:
    """Inverse of :func:`divided`: (N, 2) to (N, 3) unit directions.

    With the divisor scaled to 1, the depth solves (2·alpha − 1)·z² + 2·(1 − alpha)·z = 1 − alpha²·beta·r². Of the two
    forms of its root, the code uses the one without cancellation.
    """

    def direction(x: FloatArray, y: FloatArray) -> Columns:
        x, y = finite_pair(x, y)
        r2 = x * x + y * y
        slope = np.sqrt(1.0 - (2.0 * alpha - 1.0) * beta * r2)
        if 0 <= alpha <= 1:
            z = (1.0 - alpha * alpha * beta * r2) / (1.0 - alpha + alpha * slope)
        else:
            z = (1.0 - alpha - alpha * slope) / (1.0 - 2.0 * alpha)
        z[~(slope > 0)] = math.nan
        shrink = 1.0 / np.sqrt(r2 + z * z)
        return x * shrink, y * shrink, z * shrink

    return by_columns(direction if beta >= 0 else _unseen(3), xy, 2, 3)


def widest(alpha: float, beta: float) -> float:
    """Return the largest angle from the axis at which :func:`divided` is valid."""
    if beta < 0:
        return 0.0
    # Both conditions bound z/d from below; for alpha outside 0 to 1, one of them always holds.
    bounds = [-alpha / (1.0 - alpha)] if alpha < 1 else []
    bounds += [(alpha - 1.0) / alpha] if alpha > 0 else []
    cosine = max(-1.0, *bounds)
    return math.atan2(math.sqrt(1.0 - cosine * cosine), math.sqrt(beta) * cosine)


def _unseen(columns: int) -> Callable[..., Columns]:
    """Return a function that gives NaN for everything, for parameters with which no direction has an image."""
    return lambda first, *_rest: [np.full_like(first, math.nan)] * columns
