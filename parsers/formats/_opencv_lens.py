"""OpenCV's distortion vector, in which the number of coefficients determines the model; some files have only four."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from calibrary.distortion import BrownConrady, Distortion, NoDistortion, Rational, ThinPrism, Tilted
from calibrary.distortion.opencv import OpenCVDistortion

__all__ = ["COUNTS", "BrownWithoutK3", "lens", "smallest_lens"]

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
