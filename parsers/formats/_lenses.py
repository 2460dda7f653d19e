"""Lenses from the coefficients that files state: in OpenCV's vector their number determines the model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

from calibrary.distortion import (
    BrownConrady,
    Distortion,
    DoubleSphere,
    ExtendedUnified,
    FieldOfView,
    FisheyePolynomial,
    KannalaBrandt,
    NoDistortion,
    RadialPolynomial,
    Rational,
    ThinPrism,
    Tilted,
    Unified,
)
from calibrary.distortion.opencv import OpenCVDistortion
from calibrary.distortion.scaramuzza import Scaramuzza
from calibrary.errors import ParseError, UnsupportedModelError

_MODELS: dict[int, type[Distortion]] = {
    0: NoDistortion,
    4: BrownConrady,
    5: BrownConrady,
    8: Rational,
    12: ThinPrism,
    14: Tilted,
}
COUNTS = tuple(_MODELS)
"""Numbers of coefficients that OpenCV accepts."""
OPENCV_ORDER = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
"""Names of the coefficients in the order of OpenCV's vector."""
BROWN5, FISHEYE4 = OPENCV_ORDER[:5], ("k1", "k2", "k3", "k4")
MOST_READ = 5
LONGEST_PX = 1e9
"""Largest focal length, far above any camera's, whose cube is still a number."""


class BrownWithoutK3(OpenCVDistortion):
    """The model of a file with four coefficients; a lens with k3 is refitted to it instead of losing k3."""

    model: ClassVar[str] = "brown without k3"

    k1: float
    k2: float
    p1: float
    p2: float

    def equivalents(self) -> tuple[Distortion, ...]:
        """Brown–Conrady with k3 = 0."""
        return (BrownConrady(**self.coefficients),)

    @classmethod
    def from_equivalent(cls, other: Distortion) -> BrownWithoutK3 | None:
        """Brown–Conrady without k3; None for every other model."""
        if not isinstance(other, BrownConrady) or other.k3:
            return None
        return cls(k1=other.k1, k2=other.k2, p1=other.p1, p2=other.p2)


def lens(values: Sequence[float]) -> Distortion:
    """The lens of coefficients with a count in :data:`COUNTS`; all zeros mean no distortion.

    Raises:
        ParseError: there are more or fewer.
    """
    if not any(values):
        return NoDistortion()
    if len(values) not in _MODELS:
        wanted = ", ".join(map(str, COUNTS[1:]))
        raise ParseError(f"{len(values)} distortion coefficients, expected {wanted}")
    kind = _MODELS[len(values)]
    return kind(**dict(zip(kind.names(), values, strict=False)))


def smallest_lens(values: Sequence[float]) -> Distortion:
    """The smallest model with all non-zero coefficients, for files that pad a vector of fixed length with zeros."""
    used = max((index for index, value in enumerate(values, start=1) if value), default=0)
    return lens(values[: next((count for count in COUNTS if count >= used), used)])


def radial(values: Sequence[float]) -> Distortion:
    """Of k1, k2 and k3, as far as they are stated."""
    k1, k2, k3 = (*values, 0.0, 0.0, 0.0)[:3]
    return lens((k1, k2, 0.0, 0.0, k3))


def fisheye(values: Sequence[float]) -> KannalaBrandt:
    """The model of cv2.fisheye from its four coefficients."""
    return KannalaBrandt(**dict(zip(KannalaBrandt.names(), values, strict=True)))


def double_sphere(values: Sequence[float]) -> DoubleSphere:
    """Of xi and alpha."""
    xi, alpha = values
    return DoubleSphere(xi=_above(xi), alpha=_alpha(alpha))


def extended_unified(values: Sequence[float]) -> ExtendedUnified:
    """Of alpha and beta, which is 1 in the unified model."""
    alpha, beta = (*values, 1.0)[:2]
    if beta <= 0:
        raise ParseError(f"beta is {beta:g}, expected a positive number")
    return ExtendedUnified(alpha=_alpha(alpha), beta=beta)


def field_of_view(values: Sequence[float]) -> Distortion:
    """Of the angle; zero is no distortion."""
    return FieldOfView(omega=values[0]) if values[0] else NoDistortion()


def unified(values: Sequence[float]) -> Unified:
    """Of xi and perhaps k1, k2, p1 and p2."""
    xi, *rest = values
    return Unified(xi=_above(xi), **dict(zip(("k1", "k2", "p1", "p2"), rest, strict=False)))


def _above(xi: float) -> float:
    if xi <= -1:
        raise ParseError(f"xi is {xi:g}, expected a number above −1")
    return xi


def _alpha(value: float) -> float:
    if not 0 <= value <= 1:
        raise ParseError(f"alpha is {value:g}, expected a number from 0 to 1")
    return value


def of_radius(
    constant: float, powers: Sequence[float], unit: float, *, is_fisheye: bool, place: str | None
) -> Distortion:
    """The lens that takes ρ to ρ·(constant + Σ powers[i]·ρ^(i+1)), which has ``constant`` times the focal length.

    Args:
        constant: factor of ρ itself.
        powers: up to four, of ρ, ρ², ρ³ and ρ⁴; a perspective lens has no ρ⁴ beside odd powers.
        unit: ρ of a ray at 45°, or of one radian in a fisheye.
        is_fisheye: whether ρ is proportional to the angle from the axis, else to its tangent.
        place: of the polynomial in the file.

    Raises:
        ParseError: a term is beyond every number.
    """
    terms = [term / constant for term in (*powers, *[0.0] * 4)[:4]]
    for power in range(1, 5):
        terms[power - 1 :] = [term * unit for term in terms[power - 1 :]]
    if not all(map(math.isfinite, terms)):
        raise ParseError(
            f"the focal length is {unit:g} times the unit of the radius, at which the polynomial has no finite terms; "
            "expected a lens's",
            place=place,
        )
    first, second, third, fourth = terms
    if first or third:
        return (FisheyePolynomial if is_fisheye else RadialPolynomial)(k2=first, k3=second, k4=third)
    if is_fisheye:
        return KannalaBrandt(k1=second, k2=fourth, k3=0.0, k4=0.0)
    return lens((second, fourth, 0.0, 0.0))


def taylor_lens(a: Sequence[float], *, place: str) -> tuple[Scaramuzza, float]:
    """The lens of the ray (x, y, a0 + a1·ρ + a2·ρ² + …) with an axis that points forwards, and its focal length in px.

    Raises:
        ParseError: there are no coefficients, or a0 is no focal length.
        UnsupportedModelError: there is a linear term, or one above the fourth power.
    """
    if not a:
        raise ParseError("there are no coefficients, expected up to 5", place=place)
    a0, a1, a2, a3, a4 = (*a, 0.0, 0.0, 0.0, 0.0)[:MOST_READ]
    if not 0 < a0 < LONGEST_PX:
        raise ParseError(
            f"the constant term is {a0:g}, expected a focal length above zero in px", place=place
        )
    if a1 or any(a[MOST_READ:]):
        raise UnsupportedModelError(
            "it has a linear term or terms above the fourth power, which are not known here; calibrate with a "
            "polynomial of order 4, the toolbox's own proposal, or with OpenCV's fisheye model",
            place=place,
        )
    return Scaramuzza(c2=a2 * a0, c3=a3 * a0**2, c4=a4 * a0**3), a0


def upper_triangle(
    f: float, c: float, d: float, e: float, *, place: str
) -> tuple[float, float, float, float]:
    """fx, skew, fy and the angle of the rotation Q in f·(1 e; d c) = (fx skew; 0 fy)·Q.

    Raises:
        ParseError: the matrix is singular or mirrored.
    """
    length = math.hypot(d, c)
    determinant = c - d * e
    if not (length > 0 and determinant > 0):
        raise ParseError("the affine parameters make no image", place=place)
    sine, cosine = d / length, c / length
    return f * determinant / length, f * (sine + e * cosine), f * length, math.atan2(sine, cosine)
