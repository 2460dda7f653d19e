"""The models with a polynomial from the distorted to the undistorted point, and their common base.

Photogrammetry corrects measured points, so its polynomial has the opposite direction to OpenCV's. Here
:meth:`undistort` evaluates the polynomial, and :meth:`distort` inverts it exactly; changing signs would not be exact.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from calibrary.arrays import FloatArray, np
from calibrary.distortion.base import Distortion, NoDistortion, as_rows
from calibrary.distortion.brown_polynomial import BrownPolynomial


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


class InverseBrown(InverseModel):
    """Distorted to undistorted, with OpenCV's names and order; PhotoModeler, VisualSfM, MicMac's C2M.

    With (x', y') the distorted point, x = x' − x0, y = y' − y0 and r² = x² + y², the undistorted point is::

        x0 + x·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸ + k5·r¹⁰) + 2·p1·x·y + p2·(r² + 2x²) + b1·x + b2·y
        y0 + y·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸ + k5·r¹⁰) + p1·(r² + 2y²) + 2·p2·x·y

    (x0, y0) is the centre of the distortion in normalised coordinates, relative to the principal point. b1 and b2
    are an affinity and a shear that cannot be moved into K, because r is measured before them. Barrel distortion
    has k1 > 0 here.

    Source: D. C. Brown, "Close-range camera calibration", 1971.

    Raises:
        InputError: a coefficient is not finite, or b1 or b2 exceeds 0.1.
    """

    model: ClassVar[str] = "observed-brown"
    example: ClassVar[Mapping[str, float]] = {"k1": 0.3, "p1": 0.01, "p2": 0.01}

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    b1: float = 0.0
    b2: float = 0.0
    x0: float = 0.0
    y0: float = 0.0

    def _polynomial(self) -> BrownPolynomial:
        return BrownPolynomial(
            k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4, k5=self.k5,
            p1=self.p1, p2=self.p2, b1=self.b1, b2=self.b2,
        )  # fmt: skip

    def _centre(self) -> tuple[float, float]:
        return self.x0, self.y0

    def equivalents(self) -> tuple[Distortion, ...]:
        """No distortion, if every term is zero; the centre does not matter."""
        terms = (value for name, value in self.coefficients.items() if name not in {"x0", "y0"})
        return () if any(terms) else (NoDistortion(),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> InverseBrown | None:
        """Convert no distortion; other models with an exact inverse-Brown form list it in their ``equivalents``."""
        return cls(k1=0.0, k2=0.0, p1=0.0, p2=0.0) if isinstance(other, NoDistortion) else None


class InversePolynomial(InverseModel):
    """Distorted to undistorted: USGS reports with P3 or P4, and the Stereo Pipeline's decentring by an angle.

    With (x, y) the distorted point, r² = x² + y² and t = 1 + p3·r² + p4·r⁴, the undistorted point is::

        x·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸) + (2·p1·x·y + p2·(r² + 2x²))·t + s1·r² + s2·r⁴
        y·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸) + (p1·(r² + 2y²) + 2·p2·x·y)·t + s3·r² + s4·r⁴

    Sources: the SMAC adjustment of the USGS for p3 and p4; D. C. Brown, "Decentering distortion of lenses", 1966,
    for s1 to s4 (profile P1·r² + P2·r⁴ at an angle φ).

    Raises:
        InputError: a coefficient is not finite.
    """

    model: ClassVar[str] = "observed-polynomial"
    example: ClassVar[Mapping[str, float]] = {"k1": 0.3, "s1": 0.03, "s3": 0.02}

    k1: float
    k2: float
    k3: float
    k4: float
    p1: float
    p2: float
    p3: float
    p4: float
    s1: float
    s2: float
    s3: float
    s4: float

    def _polynomial(self) -> BrownPolynomial:
        return BrownPolynomial(**self.coefficients)

    def equivalents(self) -> tuple[Distortion, ...]:
        """Brown's inverse model and its equivalents, if the other terms have no effect."""
        grows = (self.p1 or self.p2) and (self.p3 or self.p4)
        if grows or self.s1 or self.s2 or self.s3 or self.s4:
            return ()
        brown = InverseBrown(k1=self.k1, k2=self.k2, p1=self.p1, p2=self.p2, k3=self.k3, k4=self.k4)
        return (brown, *brown.equivalents())

    @classmethod
    def from_equivalent(cls, other: Distortion) -> InversePolynomial | None:
        """Convert Brown's inverse model about the principal point, up to r⁸, without affinity; None for every other."""
        if not isinstance(other, InverseBrown):
            return None
        if other.k5 or other.b1 or other.b2 or other.x0 or other.y0:
            return None
        rest = dict.fromkeys(("p3", "p4", "s1", "s2", "s3", "s4"), 0.0)
        return cls(k1=other.k1, k2=other.k2, k3=other.k3, k4=other.k4, p1=other.p1, p2=other.p2, **rest)


class Australis(InverseModel):
    """Distorted to undistorted: Australis, iWitness, CameraCalibrator, with OpenCV's axes, names and order.

    With (x, y) the distorted point, y down, and r² = x² + y², the undistorted point is::

        x·(1 + k1·r² + k2·r⁴ + k3·r⁶) + 2·p1·x·y + p2·(r² + 2x²) + b1·x + b2·y
        y·(1 + k1·r² + k2·r⁴ + k3·r⁶) + p1·(r² + 2y²) + 2·p2·x·y

    The program's own coefficients are per mm, with y up and the decentring terms in the other order.

    Source: C. S. Fraser, "Digital camera self-calibration", 1997.

    Raises:
        InputError: a coefficient is not finite, or b1 or b2 exceeds 0.1.
    """

    model: ClassVar[str] = "australis"
    example: ClassVar[Mapping[str, float]] = {"k1": 0.3, "p1": 0.01, "b1": 0.01}

    k1: float
    k2: float
    k3: float
    p1: float
    p2: float
    b1: float
    b2: float

    def _polynomial(self) -> BrownPolynomial:
        return BrownPolynomial(**self.coefficients)

    def equivalents(self) -> tuple[Distortion, ...]:
        """Brown's inverse model, and its equivalents."""
        brown = InverseBrown(**self.coefficients)
        return (brown, *brown.equivalents())

    @classmethod
    def from_equivalent(cls, other: Distortion) -> Australis | None:
        """Convert Brown's inverse model about the principal point with terms up to r⁶; None for every other model."""
        if isinstance(other, NoDistortion):
            return cls(**dict.fromkeys(cls.names(), 0.0))
        if not isinstance(other, InverseBrown) or other.k4 or other.k5 or other.x0 or other.y0:
            return None
        return cls(**{name: value for name, value in other.coefficients.items() if name in cls.names()})
