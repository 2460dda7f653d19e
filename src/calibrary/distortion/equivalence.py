"""Exact conversion between distortion models that are the same map: coefficients are renamed, never fitted.

Conversions without a closed form are fitted, and the error is measured, by :mod:`calibrary.parsers.fit`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

from calibrary.distortion import BrownConrady, Distortion, NoDistortion, Rational, ThinPrism, Tilted
from calibrary.errors import UnsupportedModelError

__all__ = ["exact", "required"]

Model = TypeVar("Model", bound=Distortion)

NESTED: tuple[type[Distortion], ...] = (NoDistortion, BrownConrady, Rational, ThinPrism, Tilted)
"""OpenCV's perspective models: each contains the ones before it, with coefficients of the same names."""

_NESTED_NAMES = {member: dict.fromkeys(member.names(), 0.0) for member in NESTED}


def required(distortion: Distortion | None, target: type[Model]) -> Model:
    """Return the same map in the model ``target``, for a writer; None (unknown) counts as no distortion.

    Raises:
        UnsupportedModelError: ``target`` cannot represent the map exactly; the format's capacity should exclude this.
    """
    lens = distortion or NoDistortion()
    found = exact(lens, target)
    if found is None:
        raise UnsupportedModelError(f"{type(lens).__name__} cannot be written as {target.__name__}")
    return found


def exact(distortion: Distortion, target: type[Model]) -> Model | None:
    """Return the same map in the model ``target``; None if that cannot represent it exactly."""
    for same in _equals(distortion, (target,)):
        if isinstance(same, target) and type(same) is target:
            return same
    for same in _equals(distortion) if target not in NESTED else ():
        converted = target.from_equivalent(same)
        if isinstance(converted, target):
            return converted
    return None


def _equals(distortion: Distortion, members: tuple[type[Distortion], ...] = NESTED) -> Iterator[Distortion]:
    """Yield the same map in every known model, itself first; of the nested models only those in ``members``."""
    for value in (distortion, *distortion.equivalents()):
        yield value
        if isinstance(value, NESTED):
            given = {name: c for name, c in value.coefficients.items() if c != 0.0}
            for member in members:
                names = _NESTED_NAMES.get(member)
                if names is not None and member is not type(value) and given.keys() <= names.keys():
                    yield member(**(names | given))
