"""Fisheye models of two steps: an equidistant projection, then polynomials in the plane.

With θ the angle between the ray (X, Y, Z) and the axis, and R² = X² + Y², the equidistant point is θ·(X, Y)/R. The
polynomials map the plane to itself; their limit and inverse are computed as for the perspective models.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from functools import cached_property
from typing import ClassVar

from calibrary.arrays import FloatArray, np
from calibrary.distortion.base import Columns, Distortion, as_rows, by_columns, finite_pair
from calibrary.distortion.omnidirectional import Omnidirectional
from calibrary.distortion.opencv import OpenCVDistortion
from calibrary.distortion.polynomial import PolynomialMap, trimmed
from calibrary.distortion.radial_fisheye import KannalaBrandt
from calibrary.kernel import Form, Front


class PlanarPolynomial(OpenCVDistortion):
    """Polynomial of the fisheye models, not a model of its own; no coefficient is in a denominator.

    With r² = u² + v²::

        u' = u·(1 + k1·r² + … + k6·r¹²) + 2·p1·u·v + p2·(r² + 2u²) + s1·r² + s2·r⁴
        v' = v·(1 + k1·r² + … + k6·r¹²) + p1·(r² + 2v²) + 2·p2·u·v + s3·r² + s4·r⁴
    """

    model: ClassVar[str] = "planar-polynomial"

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    k5: float = 0.0
    k6: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    s1: float = 0.0
    s2: float = 0.0
    s3: float = 0.0
    s4: float = 0.0

    def _lens(self) -> PolynomialMap:
        """The map; k4 to k6 multiply r⁸ to r¹², whereas OpenCV's k4 to k6 are in the denominator."""
        return _Map(
            k1=self.k1, k2=self.k2, k3=self.k3, r8=self.k4, r10=self.k5, r12=self.k6, p1=self.p1, p2=self.p2,
            s1=self.s1, s2=self.s2, s3=self.s3, s4=self.s4,
        )  # fmt: skip


class EquidistantDistortion(Omnidirectional):
    """A model of one or several planar maps of the equidistant point.

    All maps but the last are radial. The whole is therefore one-to-one up to the smallest radius at which one of the
    maps reaches its limit.
    """

    @abstractmethod
    def _stages(self) -> tuple[PlanarPolynomial, ...]:
        """The maps, in the order of their application."""

    def max_angle_rad(self) -> float:
        """Smallest angle at which one of the maps reaches its limit, at most π."""
        *radial, last = self._stages()
        radius = last.valid_radius()
        for stage in reversed(radial):
            limit = stage.valid_radius()
            # If the limit of the later maps is outside this map's image, this map's own limit comes first.
            inner = stage.undistort(np.array([[radius, 0.0]]))[0, 0] if math.isfinite(radius) else math.nan
            radius = float(inner) if math.isfinite(inner) else limit
        return min(math.pi, radius)

    def form(self) -> Form | None:
        """See :meth:`Distortion.form`; of two maps the first, which is radial, is one of the angle."""
        *radial, last = self._stages()
        shape = tuple(c for stage in radial for c in stage._lens().numerator[1:])
        limit = min([math.pi, *(stage.valid_radius() for stage in radial)])
        return last._lens().form(last.valid_radius(), Front.ANGLE, shape, limit)

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""
        point = _equidistant(rays)
        for stage in self._stages():
            point = stage.distort(point)
        return point

    def distort_unlimited(self, rays: FloatArray) -> FloatArray:
        """The formula alone; NaN only for straight backwards."""
        point = _equidistant(rays)
        for stage in self._stages():
            point = stage._image_unlimited(point)
        return point

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN for points without a direction."""
        point = as_rows(xy, 2)
        for stage in reversed(self._stages()):
            point = stage.undistort(point)
        return _directions(point)


def only(distortion: Distortion, *names: str) -> bool:
    """Return whether all coefficients other than those named are zero."""
    return not any(value for name, value in distortion.coefficients.items() if name not in names)


def _equidistant(rays: FloatArray) -> FloatArray:
    """(N, 3) directions to (N, 2) equidistant points; NaN for straight backwards, whose image is a whole circle."""

    def image(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        r = np.hypot(x, y)
        stretch = np.arctan2(r, z) / r
        stretch[(r == 0) & (z > 0)] = 0.0
        return finite_pair(x * stretch, y * stretch)

    return by_columns(image, rays, 3, 2)


def _directions(points: FloatArray) -> FloatArray:
    """The inverse of :func:`_equidistant`; NaN from 180° on."""

    def direction(u: FloatArray, v: FloatArray) -> Columns:
        theta = np.hypot(u, v)
        theta[~(theta < math.pi)] = math.nan
        # sin θ / θ without a division by zero on the axis; numpy's sinc(x) is sin(πx)/(πx).
        stretch = np.sinc(theta / math.pi)
        return *finite_pair(u * stretch, v * stretch), np.cos(theta)

    return by_columns(direction, points, 2, 3)


class _Map(PolynomialMap, frozen=True, kw_only=True):
    """OpenCV's map with three more radial terms in the numerator."""

    POWERS: ClassVar[dict[str, int]] = PolynomialMap.POWERS | {"r8": 8, "r10": 10, "r12": 12}

    r8: float = 0.0
    r10: float = 0.0
    r12: float = 0.0

    @cached_property
    def numerator(self) -> list[float]:
        """1 + k1·s + … + r12·s⁶, constant term first, without trailing zeros."""
        return trimmed([1.0, self.k1, self.k2, self.k3, self.r8, self.r10, self.r12])


class ThinPrismFisheye(EquidistantDistortion):
    """COLMAP ``THIN_PRISM_FISHEYE``; Metashape's fisheye, with its p1 and p2 exchanged.

    With θ the angle between the ray (X, Y, Z) and the axis, R² = X² + Y² and (u, v) = θ·(X, Y)/R::

        x' = u·(1 + k1·θ² + k2·θ⁴ + k3·θ⁶ + k4·θ⁸) + 2·p1·u·v + p2·(θ² + 2u²) + sx1·θ²
        y' = v·(1 + k1·θ² + k2·θ⁴ + k3·θ⁶ + k4·θ⁸) + p1·(θ² + 2v²) + 2·p2·u·v + sy1·θ²

    Source: COLMAP, ``ThinPrismFisheyeCameraModel``, with its order of the coefficients.
    """

    model: ClassVar[str] = "thin-prism-fisheye"
    example: ClassVar[Mapping[str, float]] = {"k1": 0.02, "k2": -0.01, "sx1": 0.03, "sy1": 0.02}

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float
    k4: float
    sx1: float
    sy1: float

    def _stages(self) -> tuple[PlanarPolynomial, ...]:
        return (
            PlanarPolynomial(
                k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4, p1=self.p1, p2=self.p2, s1=self.sx1, s3=self.sy1
            ),
        )  # fmt: skip

    def equivalents(self) -> tuple[Distortion, ...]:
        """Kannala–Brandt, if there are only radial terms."""
        if not only(self, "k1", "k2", "k3", "k4"):
            return ()
        return (KannalaBrandt(k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> ThinPrismFisheye | None:
        """Convert Kannala–Brandt; None for every other model."""
        if not isinstance(other, KannalaBrandt):
            return None
        return cls(k1=other.k1, k2=other.k2, p1=0.0, p2=0.0, k3=other.k3, k4=other.k4, sx1=0.0, sy1=0.0)


RADIAL = ("k1", "k2", "k3", "k4")


class Fisheye624(EquidistantDistortion):
    """OpenSfM ``fisheye624`` and, without s0 to s3, ``fisheye62``.

    With θ the angle between the ray (X, Y, Z) and the axis, R² = X² + Y² and (u, v) = θ·(X, Y)/R::

        x' = u·(1 + k1·θ² + … + k6·θ¹²) + 2·p1·u·v + p2·(θ² + 2u²) + s0·θ² + s1·θ⁴
        y' = v·(1 + k1·θ² + … + k6·θ¹²) + p1·(θ² + 2v²) + 2·p2·u·v + s2·θ² + s3·θ⁴

    Meta's model of the same name, COLMAP's ``RAD_TAN_THIN_PRISM_FISHEYE``, differs. It computes the last
    two groups of terms at the point that the first group gives, and exchanges p1 and p2.

    Source: OpenSfM, ``camera_distortions_functions.h``.
    """

    model: ClassVar[str] = "fisheye624"
    example: ClassVar[Mapping[str, float]] = {"k1": 0.02, "k2": -0.01, "s0": 0.03, "s2": 0.02}

    k1: float
    k2: float
    k3: float
    k4: float
    k5: float
    k6: float
    p1: float
    p2: float
    s0: float = 0.0
    s1: float = 0.0
    s2: float = 0.0
    s3: float = 0.0

    def _stages(self) -> tuple[PlanarPolynomial, ...]:
        return (
            PlanarPolynomial(
                k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4, k5=self.k5, k6=self.k6,
                p1=self.p1, p2=self.p2, s1=self.s0, s2=self.s1, s3=self.s2, s4=self.s3,
            ),
        )  # fmt: skip

    def equivalents(self) -> tuple[Distortion, ...]:
        """The smaller fisheye models, if the terms that they lack are zero."""
        same: list[Distortion] = []
        if only(self, *RADIAL):
            same.append(KannalaBrandt(k1=self.k1, k2=self.k2, k3=self.k3, k4=self.k4))
        if only(self, *RADIAL, "p1", "p2", "s0", "s2"):
            same.append(
                ThinPrismFisheye(
                    k1=self.k1, k2=self.k2, p1=self.p1, p2=self.p2, k3=self.k3, k4=self.k4, sx1=self.s0, sy1=self.s2
                )
            )  # fmt: skip
        return tuple(same)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> Fisheye624 | None:
        """Convert one of the smaller fisheye models; None for every other model."""
        if isinstance(other, KannalaBrandt):
            return cls(k1=other.k1, k2=other.k2, k3=other.k3, k4=other.k4, k5=0.0, k6=0.0, p1=0.0, p2=0.0)
        if isinstance(other, ThinPrismFisheye):
            return cls(
                k1=other.k1, k2=other.k2, k3=other.k3, k4=other.k4, k5=0.0, k6=0.0, p1=other.p1, p2=other.p2,
                s0=other.sx1, s2=other.sy1,
            )  # fmt: skip
        return None


class RadTanThinPrismFisheye(EquidistantDistortion):
    """COLMAP ``RAD_TAN_THIN_PRISM_FISHEYE``, Project Aria ``FISHEYE624``.

    With θ the angle between the ray (X, Y, Z) and the axis, and R² = X² + Y²::

        θd = θ·(1 + k0·θ² + k1·θ⁴ + k2·θ⁶ + k3·θ⁸ + k4·θ¹⁰ + k5·θ¹²)        (u, v) = θd·(X, Y)/R
        x' = u + p0·(θd² + 2u²) + 2·p1·u·v + s0·θd² + s1·θd⁴
        y' = v + p1·(θd² + 2v²) + 2·p0·u·v + s2·θd² + s3·θd⁴

    p0 and p1 are OpenCV's p2 and p1.

    Source: Project Aria, "Camera intrinsic models", FisheyeRadTanThinPrism; COLMAP's order of coefficients.
    """

    model: ClassVar[str] = "rad-tan-thin-prism-fisheye"
    example: ClassVar[Mapping[str, float]] = {"k0": 0.02, "k1": -0.01, "p0": 0.02, "s2": 0.02}

    k0: float
    k1: float
    k2: float
    k3: float
    k4: float
    k5: float
    p0: float
    p1: float
    s0: float
    s1: float
    s2: float
    s3: float

    def _stages(self) -> tuple[PlanarPolynomial, ...]:
        return (
            PlanarPolynomial(k1=self.k0, k2=self.k1, k3=self.k2, k4=self.k3, k5=self.k4, k6=self.k5),
            PlanarPolynomial(p1=self.p1, p2=self.p0, s1=self.s0, s2=self.s1, s3=self.s2, s4=self.s3),
        )

    def equivalents(self) -> tuple[Distortion, ...]:
        """OpenSfM's model if there are only radial terms, and Kannala–Brandt if there are at most four."""
        same: list[Distortion] = []
        if only(self, "k0", "k1", "k2", "k3", "k4", "k5"):
            same.append(
                Fisheye624(
                    k1=self.k0, k2=self.k1, k3=self.k2, k4=self.k3, k5=self.k4, k6=self.k5, p1=0.0, p2=0.0
                )
            )
        if only(self, "k0", "k1", "k2", "k3"):
            same.append(KannalaBrandt(k1=self.k0, k2=self.k1, k3=self.k2, k4=self.k3))
        return tuple(same)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> RadTanThinPrismFisheye | None:
        """Convert Kannala–Brandt, or OpenSfM's fisheye with radial terms only; None for every other model."""
        if isinstance(other, KannalaBrandt):
            radial = (other.k1, other.k2, other.k3, other.k4, 0.0, 0.0)
        elif isinstance(other, Fisheye624) and only(other, "k1", "k2", "k3", "k4", "k5", "k6"):
            radial = (other.k1, other.k2, other.k3, other.k4, other.k5, other.k6)
        else:
            return None
        k0, k1, k2, k3, k4, k5 = radial
        return cls(k0=k0, k1=k1, k2=k2, k3=k3, k4=k4, k5=k5, p0=0.0, p1=0.0, s0=0.0, s1=0.0, s2=0.0, s3=0.0)
