"""OpenCV's distortion vector, whose length is its model."""

from __future__ import annotations

from collections.abc import Sequence

from calibrary.distortion import BrownConrady, Distortion, NoDistortion, Rational, ThinPrism, Tilted

__all__ = ["COUNTS", "lens", "smallest_lens"]

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


def lens(values: Sequence[float]) -> Distortion:
    """The model of as many coefficients, which are one of :data:`COUNTS`; all zero is no distortion."""
    if not any(values):
        return NoDistortion()
    kind = _MODELS[len(values)]
    return kind(**dict(zip(kind.names(), values, strict=False)))


def smallest_lens(values: Sequence[float]) -> Distortion:
    """The smallest model that holds them, for files that fill a vector of fixed length with zeros."""
    used = max((index for index, value in enumerate(values, start=1) if value), default=0)
    return lens(values[: min(count for count in COUNTS if count >= used)])
