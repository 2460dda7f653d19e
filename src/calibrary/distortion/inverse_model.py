"""What the models have in common whose polynomial takes the distorted point to the undistorted one.

Photogrammetry corrects what was measured, so its polynomial runs the other way than OpenCV's. Here it is
evaluated as it stands for :meth:`undistort`, and inverted exactly for :meth:`distort`; a sign flip would be
neither.
"""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion.base import Distortion, as_rows
from calibrary.distortion.brown_polynomial import BrownPolynomial

__all__ = ["InverseModel"]


class InverseModel(Distortion):
    """A model whose polynomial, about a centre, gives the undistorted point from the distorted one."""

    def __post_init__(self) -> None:
        Distortion.__post_init__(self)
        self._polynomial()

    @abstractmethod
    def _polynomial(self) -> BrownPolynomial:
        """Distorted to undistorted, both counted from the centre."""

    def _centre(self) -> tuple[float, float]:
        """The centre of the polynomial in normalised coordinates; the principal point is (0, 0)."""
        return 0.0, 0.0

    def valid_radius(self) -> float:
        """The radius of the largest disc around the axis that lies inside what the distorted disc corrects to.

        The polynomial is one-to-one on a disc around its centre in the *distorted* image; the nearest point of
        that disc's corrected rim is how far out the *undistorted* side is known.
        """
        polynomial = self._polynomial()
        distorted_radius = polynomial.valid_radius()
        if math.isinf(distorted_radius):
            return math.inf
        x0, y0 = self._centre()
        if np.isnan(polynomial.undistort(np.array([[-x0, -y0]]))).any():
            return 0.0
        return _nearest_rim(polynomial, distorted_radius, (x0, y0))

    def undistort(self, xy: FloatArray) -> FloatArray:
        """Distorted to undistorted (x/z, y/z), by the polynomial; NaN where that lies outside :meth:`valid_radius`."""
        centre = np.array(self._centre())
        with np.errstate(all="ignore"):
            undistorted: FloatArray = self._polynomial().distort(as_rows(xy, 2) - centre) + centre
            undistorted[~(np.hypot(undistorted[:, 0], undistorted[:, 1]) < self.valid_radius())] = math.nan
        return undistorted

    def distort(self, xy: FloatArray) -> FloatArray:
        """Undistorted (x/z, y/z) to distorted, by the exact inverse; NaN from :meth:`valid_radius` on."""
        centre = np.array(self._centre())
        undistorted = np.array(as_rows(xy, 2))
        with np.errstate(all="ignore"):
            undistorted[~(np.hypot(undistorted[:, 0], undistorted[:, 1]) < self.valid_radius())] = math.nan
            distorted: FloatArray = self._polynomial().undistort(undistorted - centre) + centre
        return distorted


def _nearest_rim(polynomial: BrownPolynomial, radius: float, centre: tuple[float, float]) -> float:
    """How close the image of the circle of ``radius`` comes to the axis.

    The square of that distance is a trigonometric polynomial of degree three in the direction: it has three
    minima at most, which 256 directions tell apart.
    """
    lens = polynomial._lens()

    def distance(angle: FloatArray) -> FloatArray:
        u, v = lens.image(radius * np.cos(angle), radius * np.sin(angle))
        return np.hypot(u + centre[0], v + centre[1])

    angle = np.linspace(-math.pi, math.pi, 256, endpoint=False)
    step = angle[1] - angle[0]
    for _ in range(10):
        nearest = angle[np.argmin(distance(angle))]
        angle = nearest + np.linspace(-step, step, 17)
        step /= 8.0
    return float(distance(angle).min())
