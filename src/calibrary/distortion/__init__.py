"""Distortion models, a module per family, all independent of K; how to convert between them, and how to add one.

The set is closed: a model that a file calls by another name either equals one of these exactly or is refused.

Conversion is exact, between models that are the same map: coefficients are renamed, never fitted. Those without a
closed form are fitted, and the error is measured, by :mod:`calibrary.parsers.fit`.

A new model is a class and a row here:

1.  Write its class, in the module of its family or a new one. It derives from :class:`Distortion`; from
    :class:`~calibrary.distortion.omnidirectional.Omnidirectional` if it can see 90° from the axis or more, from
    :class:`~calibrary.distortion.radial_fisheye.RadialFisheye` if its image radius depends on the angle alone, and
    from :class:`~calibrary.distortion.opencv.OpenCVDistortion` if it adds terms to the point in the plane.
2.  Its fields are the coefficients, by the names and in the order of its source. Its docstring states which programs
    have it, the formula as an indented block, and ``Source:``; page, schemas and registries are generated from it.
    ``model`` is its name in files, ``example`` a lens that the page draws.
3.  Outside the field of view where it is one-to-one it gives NaN. ``equivalents`` and ``from_equivalent`` name the
    models that are the same map for some coefficients, so that files of these convert without a fit.
4.  Import it here, and add it to ``__all__`` and :data:`MODELS`.
5.  Run ``make schemas pictures docs``. Add a row to ``tests/core/lens_models.py``: its names, its formula written
    independently of the package, and lenses to draw; the contract tests then cover it.

If COLMAP or OpenCV has the model, its rows in the two tables of :mod:`calibrary.interop.colmap` or
:mod:`calibrary.interop.opencv` make all their formats read and write it. If calibrations may estimate it,
``calib/lens_models.py`` has the steps. ``tests/core/test_distortion_contract.py`` names each part that is missing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, TypeAlias, TypeVar, Union

from calibrary.distortion.base import Distortion, NoDistortion
from calibrary.distortion.brown_polynomial import MetashapeFrame, OffCentreBrown
from calibrary.distortion.equidistant import Fisheye624, RadTanThinPrismFisheye, ThinPrismFisheye
from calibrary.distortion.inverse_model import Australis, InverseBrown, InversePolynomial
from calibrary.distortion.omnidirectional import DoubleSphere, ExtendedUnified, Unified
from calibrary.distortion.one_parameter import Division, FieldOfView
from calibrary.distortion.opencv import BrownConrady, Rational, ThinPrism, Tilted
from calibrary.distortion.radial_fisheye import FisheyePolynomial, KannalaBrandt
from calibrary.distortion.radial_polynomial import RadialPolynomial
from calibrary.distortion.scaramuzza import Scaramuzza
from calibrary.distortion.splined import SplinedStereographic
from calibrary.errors import UnsupportedModelError

__all__ = [
    "MODELS",
    "AnyDistortion",
    "Australis",
    "BrownConrady",
    "Distortion",
    "Division",
    "DoubleSphere",
    "ExtendedUnified",
    "FieldOfView",
    "Fisheye624",
    "FisheyePolynomial",
    "InverseBrown",
    "InversePolynomial",
    "KannalaBrandt",
    "MetashapeFrame",
    "NoDistortion",
    "OffCentreBrown",
    "RadTanThinPrismFisheye",
    "RadialPolynomial",
    "Rational",
    "Scaramuzza",
    "SplinedStereographic",
    "ThinPrism",
    "ThinPrismFisheye",
    "Tilted",
    "Unified",
    "exact",
    "required",
]

Model = TypeVar("Model", bound=Distortion)

MODELS: Final[Mapping[str, type[Distortion]]] = MappingProxyType(
    {
        kind.model: kind
        for kind in (
            NoDistortion,
            BrownConrady,
            Rational,
            ThinPrism,
            Tilted,
            KannalaBrandt,
            MetashapeFrame,
            InverseBrown,
            OffCentreBrown,
            Unified,
            ExtendedUnified,
            DoubleSphere,
            FieldOfView,
            FisheyePolynomial,
            Australis,
            InversePolynomial,
            Division,
            Fisheye624,
            RadTanThinPrismFisheye,
            ThinPrismFisheye,
            Scaramuzza,
            RadialPolynomial,
            SplinedStereographic,
        )
    }
)
"""All models by the name in files and reports."""

NESTED: tuple[type[Distortion], ...] = (NoDistortion, BrownConrady, Rational, ThinPrism, Tilted)
"""OpenCV's perspective models: each contains the ones before it, with coefficients of the same names."""

_NESTED_NAMES = {member: dict.fromkeys(member.names(), 0.0) for member in NESTED}

if TYPE_CHECKING:
    AnyDistortion: TypeAlias = Distortion
else:
    AnyDistortion = Union[tuple(MODELS.values())]  # noqa: UP007  the models are not written out twice
"""Type of a record's field for a distortion model; the name of the model selects the class on reading."""


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
