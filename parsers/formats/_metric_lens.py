"""Coefficients per millimetre as coefficients of normalised coordinates.

A term c·rⁿ of a correction in mm, with r in mm, is c·fⁿ⁻¹·(r/f)ⁿ of one in units of the focal length f.
"""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["normalised", "per_length"]

RADIAL_POWERS = (2, 4, 6, 8)


def normalised(values: Sequence[float], focal: float, powers: Sequence[int] = RADIAL_POWERS) -> list[float]:
    """Every value times its power of the focal length; past the largest float it is infinite, no error."""
    return [value * _power(focal, power) for value, power in zip(values, powers, strict=False)]


def per_length(values: Sequence[float], focal: float, powers: Sequence[int] = RADIAL_POWERS) -> list[float]:
    """The inverse of :func:`normalised`."""
    return [value / _power(focal, power) for value, power in zip(values, powers, strict=False)]


def _power(focal: float, power: int) -> float:
    """By multiplication: ``**`` raises where a product is infinite."""
    product = 1.0
    for _ in range(power):
        product *= focal
    return product
