"""Distortion models, a module each (OpenCV's family shares one), all independent of K, and how to add one.

The set is closed: a model that a file calls by another name either equals one of these exactly or is refused.

A new model is a module and a row here:

1.  Write ``distortion/<name>.py`` with one class. It derives from :class:`Distortion`; from
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

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, TypeAlias, Union

from msgspec import NODEFAULT
from msgspec.structs import fields

from calibrary.distortion.australis import Australis
from calibrary.distortion.base import Distortion
from calibrary.distortion.division import Division
from calibrary.distortion.double_sphere import DoubleSphere
from calibrary.distortion.extended_unified import ExtendedUnified
from calibrary.distortion.field_of_view import FieldOfView
from calibrary.distortion.fisheye624 import Fisheye624
from calibrary.distortion.fisheye_polynomial import FisheyePolynomial
from calibrary.distortion.inverse_brown import InverseBrown
from calibrary.distortion.inverse_polynomial import InversePolynomial
from calibrary.distortion.kannala_brandt import KannalaBrandt
from calibrary.distortion.metashape import MetashapeFrame
from calibrary.distortion.none import NoDistortion
from calibrary.distortion.off_centre import OffCentreBrown
from calibrary.distortion.opencv import BrownConrady, Rational, ThinPrism, Tilted
from calibrary.distortion.rad_tan_thin_prism_fisheye import RadTanThinPrismFisheye
from calibrary.distortion.radial_polynomial import RadialPolynomial
from calibrary.distortion.scaramuzza import Scaramuzza
from calibrary.distortion.thin_prism_fisheye import ThinPrismFisheye
from calibrary.distortion.unified import Unified
from calibrary.errors import InputError, UnsupportedModelError

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
    "ThinPrism",
    "ThinPrismFisheye",
    "Tilted",
    "Unified",
    "distortion_from",
]

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
        )
    }
)
"""All models by the name in files and reports."""

if TYPE_CHECKING:
    AnyDistortion: TypeAlias = Distortion
else:
    AnyDistortion = Union[tuple(MODELS.values())]  # noqa: UP007  the models are not written out twice
"""Type of a record's field for a distortion model; the name of the model selects the class on reading."""


def distortion_from(model: str, coefficients: Mapping[str, float]) -> Distortion:
    """Make a model from its name and its named coefficients, as in files and reports.

    Args:
        model: one of :data:`MODELS`.
        coefficients: all coefficients of the model; only those with a default (``k3`` of ``brown``) may be missing.

    Raises:
        UnsupportedModelError: there is no model of this name.
        InputError: a coefficient is missing, unknown to the model, or not a finite number.
    """
    kind = MODELS.get(model)
    if kind is None:
        raise UnsupportedModelError(
            f"distortion model {model!r:.60} is not known, expected one of {', '.join(MODELS)}; "
            "nothing is approximated silently"
        )
    unknown = [name for name in coefficients if name not in kind.names()]
    if unknown:
        raise InputError(
            f"the {model} model has no coefficient {_name_list(unknown)}; it has {_name_list(kind.names()) or 'none'}"
        )
    required = [f.name for f in fields(kind) if f.default is NODEFAULT]
    missing = [name for name in required if name not in coefficients]
    if missing:
        raise InputError(
            f"the {model} model lacks {_name_list(missing)}; expected {_name_list(kind.names())}, "
            "zero where measured as zero"
        )
    return kind(**coefficients)


def _name_list(names: Sequence[str]) -> str:
    return ", ".join(f"{name!s:.40}" for name in names[:20])
