"""The sphere models, and their common parts: two closed-form maps of directions, and their exact inverses.

:func:`lifted` views directions from a point ``xi`` behind the centre of the unit sphere, which brings them closer to
the axis. :func:`divided` divides by a mixture of depth and distance instead of by depth alone, which projects
directions beyond 90° to a plane. The models of C. Mei, B. Khomutenko and V. Usenko consist of one or both.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import ClassVar

from calibrary.arrays import FloatArray, np
from calibrary.distortion.base import (
    Columns,
    Distortion,
    NoDistortion,
    as_rows,
    by_columns,
    finite_pair,
    perspective,
    unit_rays,
)
from calibrary.distortion.opencv import BrownConrady
from calibrary.kernel import Form, Front


class Omnidirectional(Distortion):
    """A camera with a field of view that may exceed 90° from the axis, which x/z and y/z cannot express.

    :meth:`distort_rays` and :meth:`undistort_to_rays` are the whole map; :meth:`distort` and :meth:`undistort` are
    its part in front of the camera.
    """

    example_reach_deg: ClassVar[float] = 63.0

    @abstractmethod
    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""

    @abstractmethod
    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN for points without a direction."""

    @abstractmethod
    def max_angle_rad(self) -> float:
        """Angle at which the image radius stops growing or becomes infinite; 0 if no direction has an image."""

    def valid_radius(self) -> float:
        """Tangent of :meth:`max_angle_rad`; ``inf`` if that is 90° or more."""
        angle = self.max_angle_rad()
        return math.tan(angle) if angle < math.pi / 2 else math.inf

    def distort(self, xy: FloatArray) -> FloatArray:
        """Undistorted (x/z, y/z), less than 90° from the axis, to distorted; NaN from :meth:`valid_radius` on."""
        xy = as_rows(xy, 2)
        return self.distort_rays(np.column_stack([xy, np.ones(len(xy))]))

    def undistort(self, xy: FloatArray) -> FloatArray:
        """Distorted to undistorted (x/z, y/z); NaN if the ray is 90° or more from the axis or does not exist."""
        return perspective(self.undistort_to_rays(xy))


def unit(x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the columns of directions, normalised to length 1."""
    # hypot does not overflow where the sum of squares would.
    shrink = 1.0 / np.hypot(np.hypot(x, y), z)
    return x * shrink, y * shrink, z * shrink


def lifted(rays: FloatArray, xi: float) -> FloatArray:
    """View (N, 3) directions from a point ``xi`` behind the centre of the unit sphere.

    With |P| = 1: (x, y, z + xi). From outside the sphere, xi > 1, only the part in front of its outline is visible.
    """

    def moved(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        x, y, z = unit(x, y, z)
        z[~(1.0 + xi * z > 0)] = math.nan
        return x, y, z + xi

    return by_columns(moved if xi > -1 else _unseen(3), rays, 3, 3)


def lowered(rays: FloatArray, xi: float) -> FloatArray:
    """Inverse of :func:`lifted`: (N, 3) unit directions to the original unit directions."""

    def moved(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        inside = 1.0 - xi * xi * (x * x + y * y)
        inside[~(inside > 0)] = math.nan
        reach = xi * z + np.sqrt(inside)
        return reach * x, reach * y, reach * z - xi

    return by_columns(moved if xi > -1 else _unseen(3), rays, 3, 3)


def widest_lifted(angle: float, xi: float) -> float:
    """Return the angle from the axis that :func:`lifted` maps to ``angle``, or the outline's if that is smaller."""
    if xi <= -1:
        return 0.0
    if xi > 1 and angle >= math.asin(1.0 / xi):
        return math.pi / 2 + math.asin(1.0 / xi)
    return min(math.pi, angle + math.asin(max(-1.0, min(1.0, xi * math.sin(angle)))))


def divided(rays: FloatArray, alpha: float, beta: float) -> FloatArray:
    """(N, 3) directions to (N, 2): x and y divided by alpha·d + (1 − alpha)·z, where d² = beta·(x² + y²) + z².

    NaN from the angle at which the divisor vanishes or the image radius stops growing: its derivative by the angle
    has the sign of (1 − alpha)·d + alpha·z.
    """

    def quotient(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        x, y, z = unit(x, y, z)
        d = np.sqrt(beta * (x * x + y * y) + z * z)
        divisor = alpha * d + (1.0 - alpha) * z
        divisor[~((divisor > 0) & ((1.0 - alpha) * d + alpha * z > 0))] = math.nan
        return finite_pair(x / divisor, y / divisor)

    return by_columns(quotient if beta >= 0 else _unseen(2), rays, 3, 2)


def undivided(xy: FloatArray, alpha: float, beta: float) -> FloatArray:
    """Inverse of :func:`divided`: (N, 2) to (N, 3) unit directions.

    With the divisor scaled to 1, the depth solves (2·alpha − 1)·z² + 2·(1 − alpha)·z = 1 − alpha²·beta·r². Of the two
    forms of its root, the code uses the one without cancellation.
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
    """Return the largest angle from the axis at which :func:`divided` is valid."""
    if beta < 0:
        return 0.0
    # Both conditions bound z/d from below; for alpha outside 0 to 1, one of them always holds.
    bounds = [-alpha / (1.0 - alpha)] if alpha < 1 else []
    bounds += [(alpha - 1.0) / alpha] if alpha > 0 else []
    cosine = max(-1.0, *bounds)
    return math.atan2(math.sqrt(1.0 - cosine * cosine), math.sqrt(beta) * cosine)


def _unseen(columns: int) -> Callable[..., Columns]:
    """Return a function that gives NaN for everything, for parameters with which no direction has an image."""
    return lambda first, *_rest: [np.full_like(first, math.nan)] * columns


class Unified(Omnidirectional):
    """Kalibr ``omni`` with ``radtan`` or none, camodocal ``MEI``, OpenCV's ``cv2.omnidir``.

    With |P| the length of the ray (X, Y, Z)::

        x = X / (Z + ξ·|P|)        y = Y / (Z + ξ·|P|)        r² = x² + y²
        x' = x·(1 + k1·r² + k2·r⁴) + 2·p1·x·y + p2·(r² + 2x²)
        y' = y·(1 + k1·r² + k2·r⁴) + p1·(r² + 2y²) + 2·p2·x·y

    The focal lengths in K are Mei's generalised γ: near the axis the camera is a pinhole with the focal length
    γ/(1 + ξ). With ξ ≤ −1 no point has an image.

    Source: C. Mei and P. Rives, "Single view point omnidirectional camera calibration from planar grids", 2007.
    """

    model: ClassVar[str] = "unified"
    example: ClassVar[Mapping[str, float]] = {"xi": 0.9}

    xi: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""
        return self._plane().distort(perspective(lifted(rays, self.xi)))

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN for points without a direction."""
        return lowered(unit_rays(self._plane().undistort(xy)), self.xi)

    def form(self) -> Form | None:
        """See :meth:`Distortion.form`; None where no direction has an image."""
        plane = self._plane()
        return plane._lens().form(plane.valid_radius(), Front.UNIFIED, (self.xi,)) if self.xi > -1 else None

    def max_angle_rad(self) -> float:
        """Angle at which the terms in the plane reach their limit or the ray becomes parallel to the plane."""
        return widest_lifted(math.atan(self._plane().valid_radius()), self.xi)

    def equivalents(self) -> tuple[Distortion, ...]:
        """Brown–Conrady, if ξ is zero."""
        return () if self.xi else (self._plane(),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> Unified | None:
        """Convert Brown–Conrady without k3; None for every other model."""
        if not isinstance(other, BrownConrady) or other.k3:
            return None
        return cls(xi=0.0, k1=other.k1, k2=other.k2, p1=other.p1, p2=other.p2)

    def _plane(self) -> BrownConrady:
        return BrownConrady(k1=self.k1, k2=self.k2, p1=self.p1, p2=self.p2)


class ExtendedUnified(Omnidirectional):
    """Kalibr and Basalt ``eucm``, COLMAP ``EUCM``; with beta = 1 Basalt's ``ucm``.

    For the ray (X, Y, Z)::

        d  = √(beta·(X² + Y²) + Z²)
        x' = X / (alpha·d + (1 − alpha)·Z)        y' = Y / (alpha·d + (1 − alpha)·Z)

    Real cameras have 0 ≤ alpha ≤ 1 and beta > 0. With a negative beta no point has an image.

    Source: B. Khomutenko, G. Garcia and P. Martinet, "An enhanced unified camera model", 2016.
    """

    model: ClassVar[str] = "extended-unified"
    example: ClassVar[Mapping[str, float]] = {"alpha": 0.6, "beta": 1.1}

    alpha: float
    beta: float

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""
        return divided(rays, self.alpha, self.beta)

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN for points without a direction."""
        return undivided(xy, self.alpha, self.beta)

    def form(self) -> Form | None:
        """See :meth:`Distortion.form`; of real cameras only."""
        real = 0 <= self.alpha <= 1 and self.beta >= 0
        return Form(Front.EUCM, (self.alpha, self.beta)) if real else None

    def max_angle_rad(self) -> float:
        """Angle at which the image radius stops growing or, with alpha < 1/2, becomes infinite."""
        return widest(self.alpha, self.beta)

    def equivalents(self) -> tuple[Distortion, ...]:
        """A pinhole, if alpha is zero."""
        return () if self.alpha else (NoDistortion(),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> ExtendedUnified | None:
        """Convert a pinhole; None for every other model."""
        return cls(alpha=0.0, beta=1.0) if isinstance(other, NoDistortion) else None


class DoubleSphere(Omnidirectional):
    """Kalibr and Basalt ``ds``.

    For the ray (X, Y, Z)::

        d1 = √(X² + Y² + Z²)        d2 = √(X² + Y² + (ξ·d1 + Z)²)
        x' = X / (alpha·d2 + (1 − alpha)·(ξ·d1 + Z))        y' = Y / (…)

    Near the axis the camera is a pinhole with the focal length fx/(1 + ξ). Real cameras have −1 < ξ < 1 and
    0 ≤ alpha ≤ 1; with ξ ≤ −1 no point has an image.

    Source: V. Usenko, N. Demmel and D. Cremers, "The double sphere camera model", 2018.
    """

    model: ClassVar[str] = "double-sphere"
    example: ClassVar[Mapping[str, float]] = {"xi": -0.2, "alpha": 0.6}

    xi: float
    alpha: float

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN from :meth:`max_angle_rad` on."""
        return divided(lifted(rays, self.xi), self.alpha, 1.0)

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN for points without a direction."""
        return lowered(undivided(xy, self.alpha, 1.0), self.xi)

    def form(self) -> Form | None:
        """See :meth:`Distortion.form`; of real cameras only."""
        real = 0 <= self.alpha <= 1 and self.xi > -1
        return Form(Front.DOUBLE_SPHERE, (self.xi, self.alpha)) if real else None

    def max_angle_rad(self) -> float:
        """Angle at which the image radius stops growing or, with alpha < 1/2, becomes infinite."""
        return widest_lifted(widest(self.alpha, 1.0), self.xi)

    def equivalents(self) -> tuple[Distortion, ...]:
        """The model of one sphere, if xi or alpha is zero."""
        one_sphere: list[Distortion] = []
        if not self.xi:
            one_sphere.append(ExtendedUnified(alpha=self.alpha, beta=1.0))
        if not self.alpha:
            one_sphere.append(Unified(xi=self.xi))
        return (*one_sphere, NoDistortion()) if len(one_sphere) == 2 else tuple(one_sphere)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> DoubleSphere | None:
        """Convert a pinhole or a one-sphere model without further terms; None for every other model."""
        if isinstance(other, NoDistortion):
            return cls(xi=0.0, alpha=0.0)
        if isinstance(other, ExtendedUnified) and other.beta == 1:
            return cls(xi=0.0, alpha=other.alpha)
        if isinstance(other, Unified) and other == Unified(xi=other.xi):
            return cls(xi=other.xi, alpha=0.0)
        return None
