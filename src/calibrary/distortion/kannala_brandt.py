"""Kannala–Brandt: the fisheye model, which works in the angle from the axis and so reaches past 90°."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Distortion, as_rows, blocks, finite_pair
from calibrary.distortion.roots import first_positive_root

__all__ = ["KannalaBrandt"]

TABLE_NODES = 1024

SETTLED = 1e-9
"""A Newton step this short, relative to the angle, leaves an error of its square: nothing in float64."""

SOLVER_STEPS = 60


class KannalaBrandt(Distortion):
    """OpenCV's fisheye model, COLMAP ``OPENCV_FISHEYE``, Kalibr ``equidistant``.

    With θ the angle between the ray (X, Y, Z) and the axis, and R² = X² + Y²::

        θ  = atan2(R, Z)
        θd = θ·(1 + k1·θ² + k2·θ⁴ + k3·θ⁶ + k4·θ⁸)
        x' = θd·X / R        y' = θd·Y / R

    Source: J. Kannala and S. Brandt, "A generic camera model and calibration method for conventional,
    wide-angle, and fish-eye lenses", 2006, in the form of ``cv2.fisheye``. OpenCV and COLMAP take θ as
    atan(R/Z) and stop at 90°; with atan2 the same coefficients go on to the limit, or to the point behind the
    camera. :meth:`distort_rays` and :meth:`undistort_to_rays` cover all of it; :meth:`distort` and
    :meth:`undistort` the part in front, which is all that x/z and y/z can say.
    """

    model: ClassVar[str] = "kannala-brandt"

    k1: float
    k2: float
    k3: float
    k4: float

    def max_angle_rad(self) -> float:
        """The angle at which θd stops growing, at most π: a ray straight back has no direction in the image."""
        slope_by_square = (1.0, 3.0 * self.k1, 5.0 * self.k2, 7.0 * self.k3, 9.0 * self.k4)
        return min(math.pi, math.sqrt(first_positive_root(slope_by_square)))

    def valid_radius(self) -> float:
        """The tangent of the limiting angle; ``inf`` when the model is one-to-one up to 90° and beyond."""
        limit = self.max_angle_rad()
        return math.tan(limit) if limit < math.pi / 2 else math.inf

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on, and straight back."""
        rays = as_rows(rays, 3)
        out = np.empty((len(rays), 2))
        limit = self.max_angle_rad()
        with np.errstate(all="ignore"):
            for rows in blocks(len(rays)):
                x, y, z = rays[rows].T.copy()
                out[rows, 0], out[rows, 1] = self._distorted(x, y, z, limit)
        return out

    def distort(self, xy: FloatArray) -> FloatArray:
        """Undistorted (x/z, y/z), so less than 90° off the axis, to distorted; NaN from :meth:`valid_radius` on."""
        xy = as_rows(xy, 2)
        out = np.empty_like(xy)
        limit = self.max_angle_rad()
        with np.errstate(all="ignore"):
            for rows in blocks(len(xy)):
                x, y = xy[rows].T.copy()
                out[rows, 0], out[rows, 1] = self._distorted(x, y, np.ones_like(x), limit)
        return out

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN from the image of :meth:`max_angle_rad` on."""
        xy = as_rows(xy, 2)
        out = np.empty((len(xy), 3))
        angles = self._angles()
        with np.errstate(all="ignore"):
            for rows in blocks(len(xy)):
                theta, x, y = self._polar(xy[rows], angles)
                sine = np.sin(theta)
                out[rows, 0], out[rows, 1], out[rows, 2] = x * sine, y * sine, np.cos(theta)
        return out

    def undistort(self, xy: FloatArray) -> FloatArray:
        """Distorted to undistorted (x/z, y/z); NaN where the ray is 90° or more off the axis, or there is none."""
        xy = as_rows(xy, 2)
        out = np.empty_like(xy)
        angles = self._angles()
        with np.errstate(all="ignore"):
            for rows in blocks(len(xy)):
                theta, x, y = self._polar(xy[rows], angles)
                theta[theta >= math.pi / 2] = math.nan
                tangent = np.tan(theta)
                out[rows, 0], out[rows, 1] = x * tangent, y * tangent
        return out

    def _distorted(
        self, x: FloatArray, y: FloatArray, z: FloatArray, limit: float
    ) -> tuple[FloatArray, FloatArray]:
        r = np.hypot(x, y)
        theta = np.arctan2(r, z)
        stretch = self._image(theta) / r
        # On the axis itself the image is the principal point; straight back it would be a whole circle.
        stretch[(r == 0) & (z > 0)] = 0.0
        stretch[~(theta < limit)] = math.nan
        return finite_pair(x * stretch, y * stretch)

    def _angles(self) -> FloatArray:
        """(2, nodes): angles up to the limit and where they are seen, the start of the inverse."""
        theta = np.linspace(0.0, self.max_angle_rad(), TABLE_NODES)
        with np.errstate(all="ignore"):
            return np.stack([theta, np.maximum.accumulate(self._image(theta))])

    def _polar(self, xy: FloatArray, angles: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """θ of every distorted point, and the unit vector towards it in the image."""
        x, y = xy.T.copy()
        rho = np.hypot(x, y)
        theta = self._angle(rho, angles)
        centre = rho == 0
        rho[centre] = 1.0
        return theta, x / rho, y / rho

    def _angle(self, rho: FloatArray, angles: FloatArray) -> FloatArray:
        """θ such that θd = ``rho``, below the limiting angle; NaN where there is none.

        Newton's method from a tabulated start. A step that would leave the bracket halves it instead, so the
        solution next to the limit, where the slope vanishes, is found as surely as any other.
        """
        nodes, image = angles
        limit = nodes[-1]
        theta: FloatArray = np.interp(rho, image, nodes)
        theta[~(rho < image[-1])] = math.nan
        low, high = np.zeros_like(theta), np.full_like(theta, limit)
        moving = np.flatnonzero(theta > 0)
        for _ in range(SOLVER_STEPS):
            at = theta[moving]
            miss = self._image(at) - rho[moving]
            low[moving] = np.where(miss <= 0, at, low[moving])
            high[moving] = np.where(miss >= 0, at, high[moving])
            to = at - miss / self._slope(at)
            inside = (to >= low[moving]) & (to <= high[moving])
            to = np.where(inside, to, 0.5 * (low[moving] + high[moving]))
            theta[moving] = to
            moving = moving[~(np.abs(to - at) <= SETTLED * at)]
            if len(moving) == 0:
                break
        theta[~(theta < limit)] = math.nan
        return theta

    def _image(self, theta: FloatArray) -> FloatArray:
        """θd of θ."""
        square = theta * theta
        value = np.full_like(theta, self.k4)
        for k in (self.k3, self.k2, self.k1, 1.0):
            value *= square
            value += k
        value *= theta
        return value

    def _slope(self, theta: FloatArray) -> FloatArray:
        """dθd/dθ."""
        square = theta * theta
        value = np.full_like(theta, 9.0 * self.k4)
        for slope in (7.0 * self.k3, 5.0 * self.k2, 3.0 * self.k1, 1.0):
            value *= square
            value += slope
        return value
