"""What the sphere models share: two closed-form maps of directions, and their exact inverses.

Seen from a point ``xi`` behind the centre of the unit sphere, directions draw together (:func:`lifted`); divided
by a mixture of depth and distance instead of by depth alone, points beyond 90° land in a plane
(:func:`divided`). The models of C. Mei, of B. Khomutenko and of V. Usenko are these two in turn.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Columns, Distortion, as_rows, by_columns, finite_pair, perspective

__all__ = ["Omnidirectional", "divided", "lifted", "lowered", "undivided", "unit", "widest", "widest_lifted"]


class Omnidirectional(Distortion):
    """A camera that may see past 90°, so that rays say more of it than x/z and y/z.

    :meth:`distort_rays` and :meth:`undistort_to_rays` are the whole map, :meth:`distort` and :meth:`undistort` the
    part of it in front.
    """

    @abstractmethod
    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""

    @abstractmethod
    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN where nothing is seen."""

    @abstractmethod
    def max_angle_rad(self) -> float:
        """The angle at which the image radius stops growing or runs to infinity; 0 where there is no camera."""

    def valid_radius(self) -> float:
        """The tangent of :meth:`max_angle_rad`; ``inf`` when it reaches 90°."""
        angle = self.max_angle_rad()
        return math.tan(angle) if angle < math.pi / 2 else math.inf

    def distort(self, xy: FloatArray) -> FloatArray:
        """Undistorted (x/z, y/z), so less than 90° off the axis, to distorted; NaN from :meth:`valid_radius` on."""
        xy = as_rows(xy, 2)
        return self.distort_rays(np.column_stack([xy, np.ones(len(xy))]))

    def undistort(self, xy: FloatArray) -> FloatArray:
        """Distorted to undistorted (x/z, y/z); NaN where the ray is 90° or more off the axis, or there is none."""
        return perspective(self.undistort_to_rays(xy))


def unit(x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The columns of directions, made one long."""
    # hypot does not overflow where the sum of squares would.
    shrink = 1.0 / np.hypot(np.hypot(x, y), z)
    return x * shrink, y * shrink, z * shrink


def lifted(rays: FloatArray, xi: float) -> FloatArray:
    """(N, 3) directions as they are seen from ``xi`` behind the centre of the unit sphere.

    With |P| = 1: (x, y, z + xi). From outside the sphere, xi > 1, only the part in front of its outline is seen.
    """

    def moved(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        x, y, z = unit(x, y, z)
        z[~(1.0 + xi * z > 0)] = math.nan
        return x, y, z + xi

    return by_columns(moved if xi > -1 else _unseen(3), rays, 3, 3)


def lowered(rays: FloatArray, xi: float) -> FloatArray:
    """The inverse of :func:`lifted`: (N, 3) unit directions to the unit directions they come from."""

    def moved(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        inside = 1.0 - xi * xi * (x * x + y * y)
        inside[~(inside > 0)] = math.nan
        reach = xi * z + np.sqrt(inside)
        return reach * x, reach * y, reach * z - xi

    return by_columns(moved if xi > -1 else _unseen(3), rays, 3, 3)


def widest_lifted(angle: float, xi: float) -> float:
    """The angle from the axis that :func:`lifted` brings to ``angle``, or the outline's if that comes first."""
    if xi <= -1:
        return 0.0
    if xi > 1 and angle >= math.asin(1.0 / xi):
        return math.pi / 2 + math.asin(1.0 / xi)
    return min(math.pi, angle + math.asin(max(-1.0, min(1.0, xi * math.sin(angle)))))


def divided(rays: FloatArray, alpha: float, beta: float) -> FloatArray:
    """(N, 3) directions to (N, 2): x and y over alpha·d + (1 − alpha)·z, d² = beta·(x² + y²) + z².

    NaN from where the divisor vanishes or the image turns back: its slope over the angle has the sign of
    (1 − alpha)·d + alpha·z.
    """

    def quotient(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        x, y, z = unit(x, y, z)
        d = np.sqrt(beta * (x * x + y * y) + z * z)
        divisor = alpha * d + (1.0 - alpha) * z
        divisor[~((divisor > 0) & ((1.0 - alpha) * d + alpha * z > 0))] = math.nan
        return finite_pair(x / divisor, y / divisor)

    return by_columns(quotient if beta >= 0 else _unseen(2), rays, 3, 2)


def undivided(xy: FloatArray, alpha: float, beta: float) -> FloatArray:
    """The inverse of :func:`divided`: (N, 2) to (N, 3) unit directions.

    Where the divisor is 1, depth solves (2·alpha − 1)·z² + 2·(1 − alpha)·z = 1 − alpha²·beta·r². Of the two ways
    to write its root the one is taken in which nothing cancels.
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
    """The angle from the axis at which :func:`divided` ends."""
    if beta < 0:
        return 0.0
    # Both conditions bound z/d from below; where alpha leaves 0 to 1, one of them always holds.
    bounds = [-alpha / (1.0 - alpha)] if alpha < 1 else []
    bounds += [(alpha - 1.0) / alpha] if alpha > 0 else []
    cosine = max(-1.0, *bounds)
    return math.atan2(math.sqrt(1.0 - cosine * cosine), math.sqrt(beta) * cosine)


def _unseen(columns: int) -> Callable[..., Columns]:
    """No direction has an image: the parameters do not make a camera."""
    return lambda first, *_rest: [np.full_like(first, math.nan)] * columns
