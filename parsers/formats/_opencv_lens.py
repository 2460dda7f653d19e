"""OpenCV's distortion vector, whose length is its model, and the four terms that some files stop at."""

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
"""How many coefficients OpenCV takes."""


class BrownWithoutK3(OpenCVDistortion):
    """What a file with four places can hold, so that a lens with k3 is refitted rather than robbed of it."""

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
    """The model of as many coefficients, which are one of :data:`COUNTS`; all zero means no distortion."""
    if not any(values):
        return NoDistortion()
    kind = _MODELS[len(values)]
    return kind(**dict(zip(kind.names(), values, strict=False)))


def smallest_lens(values: Sequence[float]) -> Distortion:
    """The smallest model that has a place for them, for files that fill a vector of fixed length with zeros."""
    used = max((index for index, value in enumerate(values, start=1) if value), default=0)
    return lens(values[: min(count for count in COUNTS if count >= used)])
