"""D. Scaramuzza's omnidirectional model: the ray, not the image point, is given by a (Taylor) polynomial."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import ClassVar

from calibrary.arrays import FloatArray, np
from calibrary.distortion.base import Columns, by_columns, finite_pair
from calibrary.distortion.omnidirectional import Omnidirectional, unit
from calibrary.distortion.polynomial import Rising, first_positive_root, inverse_of_rising

FARTHEST = 1e6
"""Largest image radius considered; beyond it the ray of a lens without a limit hardly changes its direction."""

TABLE_NODES = 2048


class Scaramuzza(Omnidirectional):
    """OCamCalib's and MATLAB's ``fisheyeIntrinsics``; the ray follows from the distorted point in closed form.

    With (x', y') the distorted point and s = √(x'² + y'²), the ray is::

        (X, Y, Z) ∝ (x', y', 1 + c2·s² + c3·s³ + c4·s⁴)

    Files contain the polynomial a0 + a2·ρ² + a3·ρ³ + a4·ρ⁴ of the radius ρ in px, with the axis pointing backwards.
    It equals this one with f = −a0 and c_i = −a_i·f^(i−1). The inverse has no closed form and is solved to machine
    precision; the "inverse polynomial" in files is an approximation of it.

    Source: D. Scaramuzza, A. Martinelli, R. Siegwart, "A toolbox for easily calibrating omnidirectional
    cameras", IROS 2006.
    """

    model: ClassVar[str] = "scaramuzza"
    example: ClassVar[Mapping[str, float]] = {"c2": -0.35, "c4": -0.05}

    c2: float
    c3: float
    c4: float

    def max_angle_rad(self) -> float:
        """Largest angle of a ray, at the image radius at which the angle stops growing."""
        end = self._end()
        with np.errstate(all="ignore"):
            return float(np.arctan2(end, self._depth(np.array([end]))[0]))

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""
        table = _table(self)

        def miss_and_step(s: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
            depth = self._depth(s)
            miss = np.arctan2(s, depth) - theta
            turning = 1.0 - s * s * (self.c2 + s * (2.0 * self.c3 + s * (3.0 * self.c4)))
            return miss, miss * (s * s + depth * depth) / turning

        def image(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
            r = np.hypot(x, y)
            stretch = inverse_of_rising(np.arctan2(r, z), table, miss_and_step) / r
            stretch[(r == 0) & (z > 0)] = 0.0
            return finite_pair(x * stretch, y * stretch)

        return by_columns(image, rays, 3, 2)

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN from the radius of the largest angle on."""
        end = self._end()

        def direction(x: FloatArray, y: FloatArray) -> Columns:
            x, y = finite_pair(x, y)
            s = np.hypot(x, y)
            z = self._depth(s)
            z[~(s < end)] = math.nan
            return unit(x, y, z)

        return by_columns(direction, xy, 2, 3)

    def _end(self) -> float:
        """Image radius of the ray's largest angle; the angle's derivative has the sign of depth − s·depth'."""
        limit = first_positive_root((1.0, 0.0, -self.c2, -2.0 * self.c3, -3.0 * self.c4))
        return min(limit, FARTHEST)

    def _depth(self, s: FloatArray) -> FloatArray:
        """Component of the ray along the axis."""
        return 1.0 + s * s * (self.c2 + s * (self.c3 + s * self.c4))


@lru_cache(maxsize=64)
def _table(model: Scaramuzza) -> Rising:
    """Tabulate the angle over the image radius; cached, because this takes longer than a single point."""
    nodes = np.sinh(np.linspace(0.0, math.asinh(model._end()), TABLE_NODES))
    with np.errstate(all="ignore"):
        return Rising.of(nodes, np.maximum.accumulate(np.arctan2(nodes, model._depth(nodes))))
