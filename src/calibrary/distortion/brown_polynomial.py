"""Brown's polynomial about its own centre, with all terms that photogrammetry has added, and Metashape's and MicMac's.

The models of the photogrammetric programs use this map in one direction or the other, each with a subset of the
terms. :class:`BrownPolynomial` is their common implementation and not a model of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import ClassVar

from calibrary.arrays import FloatArray, np
from calibrary.distortion.base import Distortion, NoDistortion, as_rows, perspective
from calibrary.distortion.opencv import BrownConrady, OpenCVDistortion
from calibrary.distortion.polynomial import Jacobian, Number, PolynomialMap, trimmed
from calibrary.errors import InputError

LARGEST_AFFINITY = 0.1


class BrownPolynomial(OpenCVDistortion):
    """Map from (x, y) to (x', y'); either of the two can be the distorted point.

    With r² = x² + y² and h = r²·(p3 + p4·r²)::

        x' = x·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸ + k5·r¹⁰) + b1·x + b2·y
             + (2·p1·x·y + p2·(r² + 2x²))·(1 + h) + s1·r² + s2·r⁴
        y' = y·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸ + k5·r¹⁰)
             + (p1·(r² + 2y²) + 2·p2·x·y)·(1 + h) + s3·r² + s4·r⁴

    Raises:
        InputError: a coefficient is not finite, or b1 or b2 exceeds 0.1: see :class:`BrownMap`.
    """

    model: ClassVar[str] = "brown-polynomial"

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    p3: float = 0.0
    p4: float = 0.0
    s1: float = 0.0
    s2: float = 0.0
    s3: float = 0.0
    s4: float = 0.0
    b1: float = 0.0
    b2: float = 0.0

    def __post_init__(self) -> None:
        Distortion.__post_init__(self)
        for name in ("b1", "b2"):
            if abs(getattr(self, name)) > LARGEST_AFFINITY:
                raise InputError(
                    f"{name} is {getattr(self, name):g}, expected an affinity of at most {LARGEST_AFFINITY:g}: "
                    "a sensor is not skewed or stretched by more than a tenth",
                    place=name,
                )

    def _lens(self) -> PolynomialMap:
        """The map; k4 and k5 multiply r⁸ and r¹⁰, whereas OpenCV's k4 and k5 are in the denominator."""
        return BrownMap(
            k1=self.k1, k2=self.k2, k3=self.k3, r8=self.k4, r10=self.k5, p1=self.p1, p2=self.p2, t2=self.p3,
            t4=self.p4, s1=self.s1, s2=self.s2, s3=self.s3, s4=self.s4, b1=self.b1, b2=self.b2,
        )  # fmt: skip


class BrownMap(PolynomialMap, frozen=True, kw_only=True):
    """OpenCV's map with two more radial terms, growing tangential terms, and an affinity.

    In complex notation, the image of a circle of radius r is ``w = m + a·e + b·e² + g·ē`` (e is the unit vector, b
    comes from the tangential terms, g from the affinity). The determinant is therefore still a trigonometric
    polynomial of degree two in the direction, as the search for the limit requires. Two directions s ± d have the
    same image if ``a − g·e⁻²ⁱˢ + 2b·cos d·eⁱˢ = 0``; the tangent vanishes if this holds for d = 0. For
    |g| < 0.3·|a| there are always exactly two s for which the first two terms are parallel to b·eⁱˢ. The image of the
    circle therefore cannot cross itself before its tangent vanishes: a disc with a positive determinant is mapped
    one-to-one, as without an affinity.
    """

    # The affinity is the same at every radius.
    POWERS: ClassVar[dict[str, int]] = PolynomialMap.POWERS | {
        "r8": 8, "r10": 10, "t2": 2, "t4": 4, "b1": 0, "b2": 0,
    }  # fmt: skip

    r8: float = 0.0
    r10: float = 0.0
    t2: float = 0.0
    t4: float = 0.0
    b1: float = 0.0
    b2: float = 0.0

    @cached_property
    def numerator(self) -> list[float]:
        """1 + k1·s + … + r10·s⁵, constant term first, without trailing zeros."""
        return trimmed([1.0, self.k1, self.k2, self.k3, self.r8, self.r10])

    @cached_property
    def has_growth(self) -> bool:
        """Whether the tangential terms have a growth factor."""
        return bool((self.t2 or self.t4) and (self.p1 or self.p2))

    @cached_property
    def has_affinity(self) -> bool:
        """Whether the affinity is not zero."""
        return bool(self.b1 or self.b2)

    @cached_property
    def has_prism(self) -> bool:
        """Whether the limit needs a search, as with a prism, because there is no closed form."""
        return bool(self.s1 or self.s2 or self.s3 or self.s4 or self.has_growth or self.has_affinity)

    @property
    def further(self) -> dict[str, tuple[float, float]]:
        """The growth and the affinity."""
        return {"growth": (self.t2, self.t4), "affinity": (self.b1, self.b2)}

    def image(self, x: Number, y: Number) -> tuple[Number, Number]:
        """(x, y) to (x', y')."""
        u, v = PolynomialMap.image(self, x, y)
        if self.has_growth:
            r2 = x * x + y * y
            growth = r2 * (self.t2 + self.t4 * r2)
            along_x, along_y = self._tangential(x, y, r2)
            u = u + along_x * growth
            v = v + along_y * growth
        if self.has_affinity:
            u = u + (self.b1 * x + self.b2 * y)
        return u, v

    def image_and_jacobian(self, x: Number, y: Number) -> tuple[Number, Number, Jacobian[Number]]:
        """(x, y) to (x', y'), with the four derivatives."""
        u, v, (ux, uy, vx, vy) = PolynomialMap.image_and_jacobian(self, x, y)
        if self.has_growth:
            r2 = x * x + y * y
            growth = r2 * (self.t2 + self.t4 * r2)
            slope = 2.0 * (self.t2 + 2.0 * self.t4 * r2)
            along_x, along_y = self._tangential(x, y, r2)
            p1, p2 = self.p1, self.p2
            cross = 2.0 * (p1 * x + p2 * y)
            u, v = u + along_x * growth, v + along_y * growth
            ux = ux + growth * (6.0 * p2 * x + 2.0 * p1 * y) + along_x * slope * x
            uy = uy + growth * cross + along_x * slope * y
            vx = vx + growth * cross + along_y * slope * x
            vy = vy + growth * (6.0 * p1 * y + 2.0 * p2 * x) + along_y * slope * y
        if self.has_affinity:
            u, ux, uy = u + (self.b1 * x + self.b2 * y), ux + self.b1, uy + self.b2
        return u, v, (ux, uy, vx, vy)

    def _tangential(self, x: Number, y: Number, r2: Number) -> tuple[Number, Number]:
        """The tangential terms without the growth factor."""
        across = 2.0 * (self.p2 * x + self.p1 * y)
        return x * across + self.p2 * r2, y * across + self.p1 * r2


class MetashapeFrame(OpenCVDistortion):
    """Metashape's (PhotoScan's) eight coefficients, in its own order: p1 and p2 are OpenCV's p2 and p1.

    With r² = x² + y²::

        x' = x·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸) + (p1·(r² + 2x²) + 2·p2·x·y)·(1 + p3·r² + p4·r⁴)
        y' = y·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸) + (p2·(r² + 2y²) + 2·p1·x·y)·(1 + p3·r² + p4·r⁴)

    Source: Agisoft Metashape User Manual, appendix "Camera models" (p3 and p4 in its older editions). The
    affinity and skew coefficients b1 and b2 belong to K.
    """

    model: ClassVar[str] = "metashape"
    example: ClassVar[Mapping[str, float]] = {"k1": -0.28, "k2": 0.06, "p1": 0.02, "p2": 0.01}

    k1: float
    k2: float
    k3: float
    k4: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    p3: float = 0.0
    p4: float = 0.0

    def _lens(self) -> PolynomialMap:
        """The map, with OpenCV's names for p1 and p2."""
        return BrownMap(
            k1=self.k1, k2=self.k2, k3=self.k3, p1=self.p2, p2=self.p1, r8=self.k4, t2=self.p3, t4=self.p4
        )  # fmt: skip

    def equivalents(self) -> tuple[Distortion, ...]:
        """Brown–Conrady, if the terms that it lacks are zero."""
        if self.k4 or ((self.p1 or self.p2) and (self.p3 or self.p4)):
            return ()
        return (BrownConrady(k1=self.k1, k2=self.k2, p1=self.p2, p2=self.p1, k3=self.k3),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> MetashapeFrame | None:
        """Convert Brown–Conrady; None for every other model."""
        if not isinstance(other, BrownConrady):
            return None
        return cls(k1=other.k1, k2=other.k2, k3=other.k3, p1=other.p2, p2=other.p1)


class OffCentreBrown(Distortion):
    """Undistorted to distorted about (x0, y0), with OpenCV's names and order.

    With (X, Y) the undistorted point, x = X − x0, y = Y − y0 and r² = x² + y²::

        x' = x0 + x·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸ + k5·r¹⁰) + 2·p1·x·y + p2·(r² + 2x²) + b1·x + b2·y
        y' = y0 + y·(1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸ + k5·r¹⁰) + p1·(r² + 2y²) + 2·p2·x·y

    (x0, y0) is the centre of the distortion in normalised coordinates: (centre − principal point) / focal length. k4
    and k5 are not in a denominator, unlike OpenCV's. b1 and b2 are an affinity and a shear of the *undistorted* point
    and cannot be part of K, which acts on the distorted one.

    Source: MicMac's ``ModRad`` and ``ModPhgrStd``.

    Raises:
        InputError: a coefficient is not finite, or b1 or b2 exceeds 0.1.
    """

    model: ClassVar[str] = "off-centre-brown"
    example: ClassVar[Mapping[str, float]] = {"k1": -0.2, "x0": 0.12, "y0": 0.06}

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

    def __post_init__(self) -> None:
        Distortion.__post_init__(self)
        self._polynomial()

    def valid_radius(self) -> float:
        """Radius of the largest disc around the axis inside the one-to-one disc around (x0, y0)."""
        return max(self._polynomial().valid_radius() - math.hypot(self.x0, self.y0), 0.0)

    def distort(self, xy: FloatArray) -> FloatArray:
        """Undistorted to distorted; NaN from :meth:`valid_radius` on."""
        undistorted = np.array(as_rows(xy, 2))
        centre = self._centre()
        with np.errstate(all="ignore"):
            undistorted[~(np.hypot(undistorted[:, 0], undistorted[:, 1]) < self.valid_radius())] = math.nan
            return self._polynomial().distort(undistorted - centre) + centre

    def distort_unlimited(self, rays: FloatArray) -> FloatArray:
        """The formula alone; NaN only for what is behind the camera."""
        centre = self._centre()
        return self._polynomial()._image_unlimited(perspective(rays) - centre) + centre

    def undistort(self, xy: FloatArray) -> FloatArray:
        """Distorted to undistorted, to machine precision; NaN without a solution inside :meth:`valid_radius`."""
        centre = self._centre()
        with np.errstate(all="ignore"):
            undistorted = self._polynomial().undistort(as_rows(xy, 2) - centre) + centre
            undistorted[~(np.hypot(undistorted[:, 0], undistorted[:, 1]) < self.valid_radius())] = math.nan
        return undistorted

    def equivalents(self) -> tuple[Distortion, ...]:
        """The models about the principal point, if x0 and y0 and the terms that they lack are zero."""
        terms = {name: value for name, value in self.coefficients.items() if name not in {"x0", "y0"}}
        if not any(terms.values()):
            return (NoDistortion(),)
        if self.x0 or self.y0 or self.b1 or self.b2 or self.k5:
            return ()
        frame = MetashapeFrame(k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4, p1=self.p2, p2=self.p1)
        return (frame, *frame.equivalents())

    @classmethod
    def from_equivalent(cls, other: Distortion) -> OffCentreBrown | None:
        """Convert Brown–Conrady, or Metashape's model without p3 and p4; None for every other model."""
        if isinstance(other, BrownConrady):
            return cls(**other.coefficients)
        if isinstance(other, MetashapeFrame) and not (other.p3 or other.p4):
            k = {name: value for name, value in other.coefficients.items() if name.startswith("k")}
            return cls(**k, p1=other.p2, p2=other.p1)
        return None

    def _polynomial(self) -> BrownPolynomial:
        """Return the map with both points relative to the centre."""
        return BrownPolynomial(
            k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4, k5=self.k5,
            p1=self.p1, p2=self.p2, b1=self.b1, b2=self.b2,
        )  # fmt: skip

    def _centre(self) -> FloatArray:
        return np.array([self.x0, self.y0])
