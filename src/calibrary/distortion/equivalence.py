"""One distortion model written as another, where both are the same map: coefficients renamed, never fitted.

What has no closed form here is fitted, and measured, by :mod:`calibrary.parsers.fit`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

from calibrary.distortion import BrownConrady, Distortion, NoDistortion, Rational, ThinPrism, Tilted
from calibrary.errors import UnsupportedModelError

__all__ = ["exact", "required"]

Model = TypeVar("Model", bound=Distortion)

NESTED: tuple[type[Distortion], ...] = (NoDistortion, BrownConrady, Rational, ThinPrism, Tilted)
"""OpenCV's perspective models: each holds the ones before it, coefficient by coefficient of the same name."""

_NESTED_NAMES = {member: dict.fromkeys(member.names(), 0.0) for member in NESTED}


def required(distortion: Distortion | None, target: type[Model]) -> Model:
    """The same map in the model ``target``, as a writer needs it; an unknown lens is written as having none.

    Raises:
        UnsupportedModelError: that model has no exact place for it: the format's capacity should have excluded it.
    """
    lens = distortion or NoDistortion()
    found = exact(lens, target)
    if found is None:
        raise UnsupportedModelError(f"{type(lens).__name__} cannot be written as {target.__name__}")
    return found


def exact(distortion: Distortion, target: type[Model]) -> Model | None:
    """The same map in the model ``target``, None when that has no exact place for it."""
    for same in _equals(distortion, (target,)):
        if isinstance(same, target) and type(same) is target:
            return same
    for same in _equals(distortion) if target not in NESTED else ():
        converted = target.from_equivalent(same)
        if isinstance(converted, target):
            return converted
    return None


def _equals(distortion: Distortion, members: tuple[type[Distortion], ...] = NESTED) -> Iterator[Distortion]:
    """The same map in every model known to hold it, itself first; of the nested ones in ``members`` alone."""
    for value in (distortion, *distortion.equivalents()):
        yield value
        if isinstance(value, NESTED):
            given = {name: c for name, c in value.coefficients.items() if c != 0.0}
            for member in members:
                names = _NESTED_NAMES.get(member)
                if names is not None and member is not type(value) and given.keys() <= names.keys():
                    yield member(**(names | given))
