"""Common base of the models with a polynomial from the distorted to the undistorted point.

Photogrammetry corrects measured points, so its polynomial has the opposite direction to OpenCV's. Here
:meth:`undistort` evaluates the polynomial, and :meth:`distort` inverts it exactly; changing signs would not be exact.
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
    """A model with a polynomial, about a centre, that gives the undistorted point for the distorted one."""

    def __post_init__(self) -> None:
        Distortion.__post_init__(self)
        self._polynomial()

    @abstractmethod
    def _polynomial(self) -> BrownPolynomial:
        """Polynomial from distorted to undistorted, both relative to the centre."""

    def _centre(self) -> tuple[float, float]:
        """Centre of the polynomial in normalised coordinates; the principal point is (0, 0)."""
        return 0.0, 0.0

    def valid_radius(self) -> float:
        """Radius of the largest disc around the axis inside the undistorted image of the one-to-one distorted disc.

        The polynomial is one-to-one on a disc around its centre in the *distorted* image. The result is the distance
        from the axis to the nearest point of the *undistorted* image of that disc's edge.
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
        """Distorted to undistorted (x/z, y/z), by the polynomial; NaN for results outside :meth:`valid_radius`."""
        centre = np.array(self._centre())
        with np.errstate(all="ignore"):
            undistorted: FloatArray = self._polynomial().distort(as_rows(xy, 2) - centre) + centre
            undistorted[~(np.hypot(undistorted[:, 0], undistorted[:, 1]) < self.valid_radius())] = math.nan
        return undistorted

    def undistort_unlimited(self, xy: FloatArray) -> FloatArray:
        """The polynomial alone, for a search: beyond :meth:`valid_radius` it means nothing."""
        centre = np.array(self._centre())
        undistorted: FloatArray = self._polynomial()._image_unlimited(as_rows(xy, 2) - centre) + centre
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
    """Return the smallest distance of the image of the circle of ``radius`` from the axis.

    The square of the distance is a trigonometric polynomial of degree three in the direction. It has at most three
    minima, which 256 directions separate.
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
