"""An omnidirectional camera whose rays, not its pixels, are a polynomial: D. Scaramuzza's Taylor model."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion.base import as_rows, blocks, finite_pair
from calibrary.distortion.omnidirectional import Omnidirectional
from calibrary.distortion.roots import first_positive_root

__all__ = ["Scaramuzza"]

FARTHEST = 1e6
"""Image radii are looked at up to here; a lens without a limit has turned its ray as far as it will by then."""

TABLE_NODES = 2048

SETTLED = 1e-9
"""A Newton step this short, relative to the radius, leaves an error of its square: nothing in float64."""

SOLVER_STEPS = 60


class Scaramuzza(Omnidirectional):
    """OCamCalib's and MATLAB's ``fisheyeIntrinsics``; distorted coordinates give the ray in closed form.

    With (x', y') distorted and s = √(x'² + y'²), the ray is::

        (X, Y, Z) ∝ (x', y', 1 + c2·s² + c3·s³ + c4·s⁴)

    A file's polynomial of the radius ρ in px, a0 + a2·ρ² + a3·ρ³ + a4·ρ⁴ along the axis pointing backwards, is
    this one with f = −a0 and c_i = −a_i·f^(i−1). The other way round has no closed form and is solved to
    machine precision; the "inverse polynomial" that files hold is an approximation of it.

    Source: D. Scaramuzza, A. Martinelli, R. Siegwart, "A toolbox for easily calibrating omnidirectional
    cameras", IROS 2006.
    """

    model: ClassVar[str] = "scaramuzza"

    c2: float
    c3: float
    c4: float

    def max_angle_rad(self) -> float:
        """The angle of the ray at the image radius where it stops turning outwards."""
        end = self._end()
        with np.errstate(all="ignore"):
            return float(np.arctan2(end, self._depth(np.array([end]))[0]))

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""
        rays = as_rows(rays, 3)
        out = np.empty((len(rays), 2))
        nodes = np.sinh(np.linspace(0.0, math.asinh(self._end()), TABLE_NODES))
        with np.errstate(all="ignore"):
            angles = np.maximum.accumulate(np.arctan2(nodes, self._depth(nodes)))
            for rows in blocks(len(rays)):
                x, y, z = np.ascontiguousarray(rays[rows].T)
                r = np.hypot(x, y)
                stretch = self._radius(np.arctan2(r, z), nodes, angles) / r
                stretch[(r == 0) & (z > 0)] = 0.0
                out[rows, 0], out[rows, 1] = finite_pair(x * stretch, y * stretch)
        return out

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN from where the image turns back."""
        xy = as_rows(xy, 2)
        out = np.empty((len(xy), 3))
        end = self._end()
        with np.errstate(all="ignore"):
            for rows in blocks(len(xy)):
                x, y = finite_pair(*np.array(xy[rows].T, order="C"))
                s = np.hypot(x, y)
                z = self._depth(s)
                z[~(s < end)] = math.nan
                # hypot does not overflow where the sum of squares would.
                shrink = 1.0 / np.hypot(s, z)
                out[rows, 0], out[rows, 1], out[rows, 2] = x * shrink, y * shrink, z * shrink
        return out

    def _end(self) -> float:
        """The image radius at which the ray's angle, whose slope has the sign of depth − s·depth', is largest."""
        limit = first_positive_root((1.0, 0.0, -self.c2, -2.0 * self.c3, -3.0 * self.c4))
        return min(limit, FARTHEST)

    def _depth(self, s: FloatArray) -> FloatArray:
        """The ray's component along the axis."""
        return 1.0 + s * s * (self.c2 + s * (self.c3 + s * self.c4))

    def _radius(self, theta: FloatArray, nodes: FloatArray, angles: FloatArray) -> FloatArray:
        """The image radius of rays ``theta`` off the axis; NaN where there is none.

        Newton's method from a tabulated start. A step that would leave the bracket halves it instead.
        """
        s: FloatArray = np.interp(theta, angles, nodes)
        s[~(theta < angles[-1])] = math.nan
        low, high = np.zeros_like(s), np.full_like(s, nodes[-1])
        moving = np.flatnonzero(s > 0)
        for _ in range(SOLVER_STEPS):
            at = s[moving]
            depth = self._depth(at)
            miss = np.arctan2(at, depth) - theta[moving]
            low[moving] = np.where(miss <= 0, at, low[moving])
            high[moving] = np.where(miss >= 0, at, high[moving])
            turning = 1.0 - at * at * (self.c2 + at * (2.0 * self.c3 + at * (3.0 * self.c4)))
            to = at - miss * (at * at + depth * depth) / turning
            inside = (to >= low[moving]) & (to <= high[moving])
            to = np.where(inside, to, 0.5 * (low[moving] + high[moving]))
            s[moving] = to
            moving = moving[~(np.abs(to - at) <= SETTLED * at)]
            if len(moving) == 0:
                break
        s[~(s < nodes[-1])] = math.nan
        return s
