"""OpenCV's distortion vector, in which the number of coefficients determines the model; some files have only four.

And the polynomial of a radius in any unit, of programs that correct photographs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

from calibrary.distortion import (
    BrownConrady,
    Distortion,
    FisheyePolynomial,
    KannalaBrandt,
    NoDistortion,
    RadialPolynomial,
    Rational,
    ThinPrism,
    Tilted,
)
from calibrary.distortion.opencv import OpenCVDistortion
from calibrary.errors import ParseError

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
    """The lens of coefficients with a count in :data:`COUNTS`; all zeros mean no distortion."""
    if not any(values):
        return NoDistortion()
    kind = _MODELS[len(values)]
    return kind(**dict(zip(kind.names(), values, strict=False)))


def smallest_lens(values: Sequence[float]) -> Distortion:
    """The smallest model with all non-zero coefficients, for files that pad a vector of fixed length with zeros."""
    used = max((index for index, value in enumerate(values, start=1) if value), default=0)
    return lens(values[: min(count for count in COUNTS if count >= used)])


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
