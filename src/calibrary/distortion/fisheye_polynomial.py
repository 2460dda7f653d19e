"""A fisheye whose image radius is any polynomial of the angle from the axis, as Pix4D has it."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Distortion, as_rows, blocks, finite_pair
from calibrary.distortion.kannala_brandt import KannalaBrandt
from calibrary.distortion.omnidirectional import Omnidirectional
from calibrary.distortion.roots import first_positive_root

__all__ = ["FisheyePolynomial"]

TABLE_NODES = 1024

SETTLED = 1e-9
"""A Newton step this short, relative to the angle, leaves an error of its square: nothing in float64."""

SOLVER_STEPS = 60


class FisheyePolynomial(Omnidirectional):
    """Pix4D's and Bentley's fisheye, with even powers of the angle too; k_i multiplies θ^i.

    With θ the angle between the ray (X, Y, Z) and the axis, in radians, and R² = X² + Y²::

        θ  = atan2(R, Z)
        θd = θ + k2·θ² + k3·θ³ + k4·θ⁴
        x' = θd·X / R        y' = θd·Y / R

    Pix4D counts the angle in right angles, ρ = p0 + p1·t + p2·t² + p3·t³ with t = 2θ/π and p0 = 0, p1 = 1:
    hence k_i = p_i·(2/π)^(i−1), and the focal length is 2/π of its affine matrix.

    Source: Pix4D, "Camera internals for fisheye lens".
    """

    model: ClassVar[str] = "fisheye-polynomial"

    k2: float
    k3: float
    k4: float = 0.0

    def max_angle_rad(self) -> float:
        """The angle at which θd stops growing, at most π: a ray straight back has no direction in the image."""
        return min(math.pi, first_positive_root((1.0, 2.0 * self.k2, 3.0 * self.k3, 4.0 * self.k4)))

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on, and straight back."""
        rays = as_rows(rays, 3)
        out = np.empty((len(rays), 2))
        limit = self.max_angle_rad()
        with np.errstate(all="ignore"):
            for rows in blocks(len(rays)):
                x, y, z = rays[rows].T.copy()
                r = np.hypot(x, y)
                theta = np.arctan2(r, z)
                stretch = self._image(theta) / r
                stretch[(r == 0) & (z > 0)] = 0.0
                stretch[~(theta < limit)] = math.nan
                out[rows, 0], out[rows, 1] = finite_pair(x * stretch, y * stretch)
        return out

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN from the image of :meth:`max_angle_rad` on."""
        xy = as_rows(xy, 2)
        out = np.empty((len(xy), 3))
        nodes = np.linspace(0.0, self.max_angle_rad(), TABLE_NODES)
        with np.errstate(all="ignore"):
            image = np.maximum.accumulate(self._image(nodes))
            for rows in blocks(len(xy)):
                x, y = xy[rows].T.copy()
                rho = np.hypot(x, y)
                theta = self._angle(rho, nodes, image)
                rho[rho == 0] = 1.0
                sine = np.sin(theta) / rho
                out[rows, 0], out[rows, 1], out[rows, 2] = x * sine, y * sine, np.cos(theta)
        return out

    def equivalents(self) -> tuple[Distortion, ...]:
        """Kannala and Brandt's model, where the even powers are absent."""
        return () if self.k2 or self.k4 else (KannalaBrandt(k1=self.k3, k2=0.0, k3=0.0, k4=0.0),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> FisheyePolynomial | None:
        """Kannala and Brandt's model, where it ends with θ³."""
        if not isinstance(other, KannalaBrandt) or other.k2 or other.k3 or other.k4:
            return None
        return cls(k2=0.0, k3=other.k1)

    def _angle(self, rho: FloatArray, nodes: FloatArray, image: FloatArray) -> FloatArray:
        """θ such that θd = ``rho``, below the limiting angle; NaN where there is none.

        Newton's method from a tabulated start. A step that would leave the bracket halves it instead.
        """
        theta: FloatArray = np.interp(rho, image, nodes)
        theta[~(rho < image[-1])] = math.nan
        low, high = np.zeros_like(theta), np.full_like(theta, nodes[-1])
        moving = np.flatnonzero(theta > 0)
        for _ in range(SOLVER_STEPS):
            at = theta[moving]
            miss = self._image(at) - rho[moving]
            low[moving] = np.where(miss <= 0, at, low[moving])
            high[moving] = np.where(miss >= 0, at, high[moving])
            to = at - miss / (1.0 + at * (2.0 * self.k2 + at * (3.0 * self.k3 + at * (4.0 * self.k4))))
            inside = (to >= low[moving]) & (to <= high[moving])
            to = np.where(inside, to, 0.5 * (low[moving] + high[moving]))
            theta[moving] = to
            moving = moving[~(np.abs(to - at) <= SETTLED * at)]
            if len(moving) == 0:
                break
        theta[~(theta < nodes[-1])] = math.nan
        return theta

    def _image(self, theta: FloatArray) -> FloatArray:
        """θd of θ."""
        return theta * (1.0 + theta * (self.k2 + theta * (self.k3 + theta * self.k4)))
