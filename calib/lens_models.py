"""Lens models for the adjustment, as functions of their parameters with analytic derivatives, and how to add one.

The solver needs ∂px/∂parameter and ∂px/∂point for thousands of points at once; :mod:`calibrary.distortion` provides
the map of one camera and its inverse. The formulas are the same; tests compare the two implementations.

A model that :mod:`calibrary.distortion` has can be estimated with:

1.  a member of :class:`Solvable` and its row in :data:`MODELS`, with a function that projects, unless its terms are
    among those of OpenCV's rational model;
2.  if it is omnidirectional, a row in ``RADIAL`` of ``calib/lens_change.py``, by which it starts from a fisheye;
3.  if it may be chosen without being asked for, a place in ``ALL`` of ``calib/solve.py``;
4.  ``make schemas``, its name in ``docs/calibration.md``, and a lens in ``tests/calib/test_lens_models.py``, which
    names what is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import Final, NamedTuple, Self, TypeAlias

import numpy as np

from calibrary.arrays import BoolArray, FloatArray
from calibrary.calibration import ImageSize, Intrinsics
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    DoubleSphere,
    KannalaBrandt,
    Rational,
    Unified,
)
from calibrary.errors import InputError

Projected: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""Pixels (…, 2), ∂px/∂parameters (…, 2, n) and ∂px/∂point (…, 2, 3)."""

PINHOLE: Final = ("fx", "fy", "cx", "cy")
PERSPECTIVE: Final = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


class Solvable(StrEnum):
    """Lens models by the names that ``--model`` takes, in order of the number of parameters."""

    K1K2 = "k1k2"
    K1K2K3 = "k1k2k3"
    K1K2P1P2 = "k1k2p1p2"
    FISHEYE = "fisheye"
    BROWN = "brown"
    RATIONAL = "rational"
    DOUBLE_SPHERE = "double_sphere"
    MEI = "mei"

    @classmethod
    def named(cls, name: str) -> Self | None:
        """Return the lens model with this name; None for "auto", which leaves the choice to the corners.

        Raises:
            InputError: there is none.
        """
        if name == "auto":
            return None
        try:
            return cls(name)
        except ValueError:
            raise InputError(f"no lens model {name!r:.40}; expected auto, {', '.join(cls)}") from None

    @property
    def is_omnidirectional(self) -> bool:
        """Whether the model also covers directions at 90° and more from the axis."""
        return MODELS[self].is_omnidirectional

    @property
    def is_sphere(self) -> bool:
        """Whether fx is (1 + ξ) times the focal length of the pinhole camera near the axis."""
        return "xi" in self.coefficients

    @property
    def trades_terms(self) -> bool:
        """Whether the coefficients can nearly replace one another, so that the condition number says little."""
        return MODELS[self].trades_terms

    @property
    def next_power(self) -> int:
        """Power of r, or of θ if omnidirectional, of the radial term after the last one; 0 if not considered."""
        return MODELS[self].next_power

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Distortion coefficients that are estimated."""
        return MODELS[self].coefficients

    @property
    def parameters(self) -> tuple[str, ...]:
        """fx, fy, cx, cy and the coefficients, in the order of all matrices and vectors of this model."""
        return PINHOLE + self.coefficients

    def distortion(self, values: Mapping[str, float]) -> Distortion:
        """Return the distortion with these coefficients; those that are not estimated are zero."""
        kind = MODELS[self].lens
        return kind(**{name: values.get(name, 0.0) for name in kind.names()})

    def intrinsics(self, values: Mapping[str, float], image_size: ImageSize) -> Intrinsics:
        """Return K from the parameters."""
        return Intrinsics(**{name: values[name] for name in PINHOLE}, image_size=image_size)

    def values(self, intrinsics: Intrinsics, distortion: Distortion | None) -> FloatArray:
        """Return the parameter vector of a calibration in this model.

        Raises:
            InputError: the camera has skew, or a distortion that this model cannot represent.
        """
        theirs = {} if distortion is None else distortion.coefficients
        fits = isinstance(distortion, MODELS[self].lens) or (
            not self.is_omnidirectional and isinstance(distortion, BrownConrady | Rational)
        )
        if intrinsics.skew or (
            any(value and name not in self.coefficients for name, value in theirs.items())
            or (bool(theirs) and not fits)
        ):
            raise InputError(
                f"a {self.value} model cannot hold {distortion!s:.200} with skew {intrinsics.skew:g}"
            )
        pinhole = [getattr(intrinsics, name) for name in PINHOLE]
        return np.array(pinhole + [theirs.get(name, 0.0) for name in self.coefficients])

    def axial_focal(self, values: Mapping[str, float]) -> tuple[float, dict[str, float]]:
        """Return the focal length of the pinhole camera near the axis, px, and its derivatives by parameter name.

        The fx of the sphere models is (1 + ξ) times that, and poorly determined by itself.
        """
        fx = values["fx"]
        if not self.is_sphere:
            return fx, {"fx": 1.0}
        behind = 1.0 + values["xi"]
        return fx / behind, {"fx": 1.0 / behind, "xi": -fx / behind**2}

    def project(self, parameters: FloatArray, points: FloatArray) -> Projected:
        """Project points from the camera frame to pixels, with derivatives.

        Args:
            parameters: parameters in the order of :attr:`parameters`.
            points: (…, 3), in front of the camera if the model is perspective.
        """
        row = MODELS[self]
        if row.project is not None:
            return row.project(parameters, points)
        return _perspective(parameters, points, row.coefficients)

    def faces(self, parameters: FloatArray, points: FloatArray) -> BoolArray:
        """Return which points, (…, 3), the model can project: those in front of a perspective lens, or all."""
        del parameters
        everywhere = self.is_omnidirectional
        return np.asarray((points[..., 2] > 0) | everywhere)

    def is_possible(self, parameters: FloatArray) -> bool:
        """Return whether both focal lengths are positive."""
        return bool((parameters[:2] > 0).all())


def _perspective(parameters: FloatArray, points: FloatArray, coefficients: tuple[str, ...]) -> Projected:
    """OpenCV's rational model and its special cases (:class:`~calibrary.distortion.Rational`)."""
    inverse_depth = 1.0 / points[..., 2]
    x, y = points[..., 0] * inverse_depth, points[..., 1] * inverse_depth
    u, v, columns, (ux, cross, vy) = _in_the_plane(x, y, parameters[4:], coefficients)
    by_point = columns_of(points.shape[:-1], 3)
    by_point[..., 0, 0], by_point[..., 0, 1] = ux * inverse_depth, cross * inverse_depth
    by_point[..., 1, 0], by_point[..., 1, 1] = cross * inverse_depth, vy * inverse_depth
    by_point[..., 0, 2] = -(ux * x + cross * y) * inverse_depth
    by_point[..., 1, 2] = -(cross * x + vy * y) * inverse_depth
    return _in_pixels(parameters, u, v, columns, by_point)


def _in_the_plane(
    x: FloatArray, y: FloatArray, values: FloatArray, coefficients: tuple[str, ...]
) -> tuple[FloatArray, FloatArray, list[tuple[FloatArray, FloatArray]], tuple[FloatArray, ...]]:
    """Return distorted u and v, their derivatives by each coefficient, and ∂u/∂x, ∂u/∂y = ∂v/∂x, ∂v/∂y."""
    value = dict.fromkeys(PERSPECTIVE, 0.0) | dict(zip(coefficients, values.tolist(), strict=True))
    p1, p2 = value["p1"], value["p2"]
    xx, yy, xy = x * x, y * y, x * y
    r2 = xx + yy
    r4, r6 = r2 * r2, r2 * r2 * r2
    over = 1.0 / (1.0 + value["k4"] * r2 + value["k5"] * r4 + value["k6"] * r6)
    gain = (1.0 + value["k1"] * r2 + value["k2"] * r4 + value["k3"] * r6) * over
    slope = over * (
        value["k1"] + 2 * value["k2"] * r2 + 3 * value["k3"] * r4
        - gain * (value["k4"] + 2 * value["k5"] * r2 + 3 * value["k6"] * r4)
    )  # fmt: skip
    u = x * gain + 2 * p1 * xy + p2 * (r2 + 2 * xx)
    v = y * gain + p1 * (r2 + 2 * yy) + 2 * p2 * xy

    def column(name: str) -> tuple[FloatArray, FloatArray]:
        if name == "p1":
            return 2 * xy, r2 + 2 * yy
        if name == "p2":
            return r2 + 2 * xx, 2 * xy
        order = int(name[1]) - 1
        radial = (r2, r4, r6)[order % 3] * over
        # k4 to k6 are in the denominator.
        return (x * radial, y * radial) if order < 3 else (-x * gain * radial, -y * gain * radial)

    columns = [column(name) for name in coefficients]
    cross = 2 * slope * xy + 2 * p1 * x + 2 * p2 * y
    ux = gain + 2 * slope * xx + 2 * p1 * y + 6 * p2 * x
    vy = gain + 2 * slope * yy + 6 * p1 * y + 2 * p2 * x
    return u, v, columns, (ux, cross, vy)


def _mei(parameters: FloatArray, points: FloatArray) -> Projected:
    """Mei and Rives's unified model (:class:`~calibrary.distortion.Unified`)."""
    xi = parameters[4]
    distance = np.linalg.norm(points, axis=-1)
    divisor = points[..., 2] + xi * distance
    by_divisor = xi * points / distance[..., None]
    by_divisor[..., 2] += 1.0
    divisor = np.where((divisor > 0) & (distance + xi * points[..., 2] > 0), divisor, np.nan)
    x, y = points[..., 0] / divisor, points[..., 1] / divisor
    u, v, columns, (ux, cross, vy) = _in_the_plane(x, y, parameters[5:], Unified.names()[1:])
    # ∂(x, y)/∂point = (1 − (x, y)·∂divisor/∂point) / divisor
    along_u, along_v = (ux * x + cross * y) / divisor, (cross * x + vy * y) / divisor
    by_point = np.stack([-along_u[..., None] * by_divisor, -along_v[..., None] * by_divisor], axis=-2)
    by_point[..., 0, 0] += ux / divisor
    by_point[..., 0, 1] += cross / divisor
    by_point[..., 1, 0] += cross / divisor
    by_point[..., 1, 1] += vy / divisor
    by_xi = (-along_u * distance, -along_v * distance)
    return _in_pixels(parameters, u, v, [by_xi, *columns], by_point)


def _double_sphere(parameters: FloatArray, points: FloatArray) -> Projected:
    """Usenko's double sphere (:class:`~calibrary.distortion.DoubleSphere`)."""
    xi, alpha = parameters[4:]
    X, Y, Z = points[..., 0], points[..., 1], points[..., 2]
    d1 = np.linalg.norm(points, axis=-1)
    depth = xi * d1 + Z
    d2 = np.sqrt(X * X + Y * Y + depth * depth)
    divisor = alpha * d2 + (1 - alpha) * depth
    seen = (divisor > 0) & (d1 + xi * Z > 0) & ((1 - alpha) * d2 + alpha * depth > 0)
    divisor = np.where(seen, divisor, np.nan)
    u, v = X / divisor, Y / divisor
    by_depth = alpha * depth / d2 + 1 - alpha
    by_divisor = (by_depth * xi / d1 + np.stack([alpha / d2, alpha / d2, 0 * d2])) * np.stack([X, Y, Z])
    by_divisor[2] += by_depth
    by_point = np.stack([-u * by_divisor, -v * by_divisor]) / divisor
    by_point[0, 0] += 1 / divisor
    by_point[1, 1] += 1 / divisor
    by_xi, by_alpha = by_depth * d1 / divisor, (d2 - depth) / divisor
    columns = [(-u * by_xi, -v * by_xi), (-u * by_alpha, -v * by_alpha)]
    return _in_pixels(parameters, u, v, columns, np.moveaxis(by_point, (0, 1), (-2, -1)).copy())


def _fisheye(parameters: FloatArray, points: FloatArray) -> Projected:
    """Kannala and Brandt's model (:class:`~calibrary.distortion.KannalaBrandt`)."""
    k1, k2, k3, k4 = parameters[4:]
    X, Y, Z = points[..., 0], points[..., 1], points[..., 2]
    # The map is smooth on the axis, but its formula is not; at 1e-9 of the distance from it the error is 1e-18.
    distance2 = X * X + Y * Y + Z * Z
    r, nearest = np.hypot(X, Y), 1e-9 * np.sqrt(distance2)
    on_axis = r < nearest
    r = np.maximum(r, nearest)
    theta = np.arctan2(r, Z)
    t2 = theta * theta
    seen = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    slope = 1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)))
    unit_x, unit_y, stretch = np.where(on_axis, 1.0, X / r), np.where(on_axis, 0.0, Y / r), seen / r
    columns = []
    power = theta
    for _ in range(4):
        power = power * t2
        columns.append((unit_x * power, unit_y * power))
    # d(seen · X/r): the radial derivative is the slope, the tangential one the ratio of the radii.
    radial, across = slope * Z / distance2, stretch
    by_point = columns_of(points.shape[:-1], 3)
    by_point[..., 0, 0] = radial * unit_x**2 + across * unit_y**2
    by_point[..., 1, 1] = radial * unit_y**2 + across * unit_x**2
    by_point[..., 0, 1] = by_point[..., 1, 0] = (radial - across) * unit_x * unit_y
    by_point[..., 0, 2] = -slope * X / distance2
    by_point[..., 1, 2] = -slope * Y / distance2
    return _in_pixels(parameters, X * stretch, Y * stretch, columns, by_point)


def _in_pixels(
    parameters: FloatArray,
    u: FloatArray,
    v: FloatArray,
    columns: list[tuple[FloatArray, FloatArray]],
    by_point: FloatArray,
) -> Projected:
    """Apply K to distorted coordinates and to their derivatives."""
    fx, fy, cx, cy = parameters[:4]
    by_parameter = columns_of(u.shape, 4 + len(columns))
    by_parameter[..., :4] = 0.0
    by_parameter[..., 0, 0], by_parameter[..., 1, 1] = u, v
    by_parameter[..., 0, 2] = by_parameter[..., 1, 3] = 1.0
    for index, (du, dv) in enumerate(columns, start=4):
        by_parameter[..., 0, index], by_parameter[..., 1, index] = fx * du, fy * dv
    by_point[..., 0, :] *= fx
    by_point[..., 1, :] *= fy
    return np.stack([fx * u + cx, fy * v + cy], axis=-1), by_parameter, by_point


class _Model(NamedTuple):
    """Facts about a lens model.

    Attributes:
        lens: type of its distortion.
        coefficients: as :attr:`Solvable.coefficients`.
        project: as :meth:`Solvable.project`; None for terms of OpenCV's rational model.
        is_omnidirectional, trades_terms, next_power: as the properties of :class:`Solvable`.
    """

    lens: type[Distortion]
    coefficients: tuple[str, ...]
    project: Callable[[FloatArray, FloatArray], Projected] | None = None
    is_omnidirectional: bool = False
    trades_terms: bool = False
    next_power: int = 0


MODELS: Final[Mapping[Solvable, _Model]] = {
    Solvable.K1K2: _Model(BrownConrady, ("k1", "k2")),
    Solvable.K1K2K3: _Model(BrownConrady, ("k1", "k2", "k3")),
    Solvable.K1K2P1P2: _Model(BrownConrady, ("k1", "k2", "p1", "p2")),
    Solvable.FISHEYE: _Model(
        KannalaBrandt, KannalaBrandt.names(), _fisheye, is_omnidirectional=True, next_power=11
    ),
    Solvable.BROWN: _Model(BrownConrady, BrownConrady.names(), next_power=9),
    Solvable.RATIONAL: _Model(Rational, PERSPECTIVE, trades_terms=True, next_power=9),
    # The sphere models are not power series; one with as many parameters would end before these.
    Solvable.DOUBLE_SPHERE: _Model(
        DoubleSphere, DoubleSphere.names(), _double_sphere, is_omnidirectional=True, next_power=7
    ),
    Solvable.MEI: _Model(
        Unified, Unified.names(), _mei, is_omnidirectional=True, trades_terms=True, next_power=9
    ),
}


def columns_of(shape: tuple[int, ...], number: int) -> FloatArray:
    """Return an empty array (…, M, 2, number) with each column of the M points together, as the solver uses them."""
    return np.moveaxis(np.empty((*shape[:-1], number, shape[-1], 2)), -3, -1)
