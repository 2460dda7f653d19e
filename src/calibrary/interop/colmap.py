"""COLMAP's camera models: their parameters, and the conversion of K and a lens to them and back.

COLMAP's pixel origin is the outer corner of the top-left pixel, as in calibrary, and it has no skew. Each of
its models is a K with one or two focal lengths and the first coefficients of a lens; the table below lists
them in COLMAP's order.

Sources: COLMAP, ``src/colmap/sensor/models.h`` and its documentation, "Camera Models".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

from msgspec import Struct

from calibrary.distortion import (
    BrownConrady,
    Distortion,
    Division,
    ExtendedUnified,
    FieldOfView,
    KannalaBrandt,
    NoDistortion,
    RadTanThinPrismFisheye,
    Rational,
    ThinPrismFisheye,
    exact,
)
from calibrary.errors import UnsupportedModelError


class ColmapCamera(NamedTuple):
    """A camera as accepted by ``pycolmap.Camera`` and COLMAP's command line.

    Attributes:
        model: COLMAP's name for the model.
        width, height: px.
        params: in COLMAP's order, principal point from the outer corner of the top-left pixel.
    """

    model: str
    width: int
    height: int
    params: tuple[float, ...]


class ColmapModel(Struct, frozen=True):
    """A COLMAP model that has a K.

    Attributes:
        number: model id in ``cameras.bin`` and the database.
        name: model name in ``cameras.txt``.
        focals: number of focal lengths before the principal point, 1 or 2.
        lens: the equivalent lens model of calibrary.
        coefficients: coefficients of ``lens`` after the principal point, in COLMAP's order; all others are
            zero.
    """

    number: int
    name: str
    focals: int
    lens: type[Distortion]
    coefficients: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """Number of parameters."""
        return self.focals + 2 + len(self.coefficients)


_RADIAL = ("k1", "k2", "k3", "k4")

COLMAP_MODELS: Final = (
    ColmapModel(0, "SIMPLE_PINHOLE", 1, NoDistortion),
    ColmapModel(1, "PINHOLE", 2, NoDistortion),
    ColmapModel(2, "SIMPLE_RADIAL", 1, BrownConrady, ("k1",)),
    ColmapModel(3, "RADIAL", 1, BrownConrady, ("k1", "k2")),
    ColmapModel(4, "OPENCV", 2, BrownConrady, ("k1", "k2", "p1", "p2")),
    ColmapModel(5, "OPENCV_FISHEYE", 2, KannalaBrandt, _RADIAL),
    ColmapModel(6, "FULL_OPENCV", 2, Rational, ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    ColmapModel(7, "FOV", 2, FieldOfView, ("omega",)),
    ColmapModel(8, "SIMPLE_RADIAL_FISHEYE", 1, KannalaBrandt, ("k1",)),
    ColmapModel(9, "RADIAL_FISHEYE", 1, KannalaBrandt, ("k1", "k2")),
    ColmapModel(10, "THIN_PRISM_FISHEYE", 2, ThinPrismFisheye, ThinPrismFisheye.names()),
    ColmapModel(11, "RAD_TAN_THIN_PRISM_FISHEYE", 2, RadTanThinPrismFisheye, RadTanThinPrismFisheye.names()),
    ColmapModel(12, "SIMPLE_DIVISION", 1, Division, ("k",)),
    ColmapModel(13, "DIVISION", 2, Division, ("k",)),
    ColmapModel(14, "SIMPLE_FISHEYE", 1, KannalaBrandt),
    ColmapModel(15, "FISHEYE", 2, KannalaBrandt),
    ColmapModel(16, "EUCM", 2, ExtendedUnified, ("alpha", "beta")),
)
PANORAMAS: Final[Mapping[int, tuple[str, int]]] = MappingProxyType({17: ("EQUIRECTANGULAR", 2)})
"""Models without a K by number: name and number of parameters."""

_WRITTEN = (
    "PINHOLE",
    "OPENCV",
    "FULL_OPENCV",
    "OPENCV_FISHEYE",
    "FOV",
    "EUCM",
    "DIVISION",
    "THIN_PRISM_FISHEYE",
    "RAD_TAN_THIN_PRISM_FISHEYE",
)
"""Models that are written, two focal lengths each so that bundle adjustment can vary both; those that old versions
of COLMAP know come first."""

UNKNOWN_LENS: Final = BrownConrady(k1=0.0, k2=0.0, p1=0.0, p2=0.0, k3=0.0)
"""Start of a bundle adjustment if the distortion is unknown: OPENCV, whose coefficients it can find."""

_BY_NAME = {model.name: model for model in COLMAP_MODELS}
_BY_NUMBER = {model.number: model for model in COLMAP_MODELS}
_DEFAULTS = {_BY_NAME[name].lens: _BY_NAME[name] for name in reversed(_WRITTEN)}

COLMAP_LENSES: Final[tuple[type[Distortion], ...]] = (
    NoDistortion,
    BrownConrady,
    Rational,
    KannalaBrandt,
    ExtendedUnified,
    FieldOfView,
    Division,
    ThinPrismFisheye,
    RadTanThinPrismFisheye,
)
"""Lens models that COLMAP can represent, most common first."""


def model_named(name: str) -> ColmapModel | None:
    """The model with this name; None if COLMAP has none with a K."""
    return _BY_NAME.get(name)


def model_numbered(number: int) -> ColmapModel | None:
    """The model with this number; None if COLMAP has none with a K."""
    return _BY_NUMBER.get(number)


def default_model(lens: type[Distortion]) -> ColmapModel | None:
    """The model in which a lens of this kind is written completely; None if COLMAP has no such model."""
    return _DEFAULTS.get(lens)


def lens_from(model: ColmapModel, coefficients: Sequence[float]) -> Distortion:
    """Make the lens of a COLMAP model.

    Args:
        model: the COLMAP model.
        coefficients: the parameters after the principal point, in COLMAP's order.

    Raises:
        InputError: the coefficients are not valid for this lens.
    """
    given = dict(zip(model.coefficients, coefficients, strict=True))
    return _plainest(model.lens(**{name: given.get(name, 0.0) for name in model.lens.names()}))


def model_for(
    lens: Distortion, *, one_focal: bool, preferred: str | None = None
) -> tuple[ColmapModel, list[float]]:
    """The COLMAP model that represents a lens exactly, and its coefficients in COLMAP's order.

    Args:
        lens: the distortion.
        one_focal: whether fx equals fy; a model with one focal length is used only if it is ``preferred``.
        preferred: name of the model to use if it represents the lens exactly.

    Raises:
        UnsupportedModelError: no COLMAP model represents the lens exactly.
    """
    written = [_BY_NAME[name] for name in _WRITTEN]
    # A lens model with all coefficients zero keeps its kind: bundle adjustment may refine the coefficients.
    candidates = [item for item in written if item.lens is type(lens)] + written
    if preferred in _BY_NAME:
        candidates.insert(0, _BY_NAME[preferred])
    for candidate in candidates:
        coefficients = _coefficients_in(lens, candidate)
        if coefficients is not None and (candidate.focals == 2 or one_focal):
            return candidate, coefficients
    raise UnsupportedModelError(f"COLMAP has no model that is exactly {lens.model!r}")


def _coefficients_in(lens: Distortion, model: ColmapModel) -> list[float] | None:
    """The coefficients of the lens in a model; None if the model lacks one that is not zero."""
    same = lens if type(lens) is model.lens else exact(lens, model.lens)
    if same is None:
        return None
    coefficients = same.coefficients
    if any(value for name, value in coefficients.items() if name not in model.coefficients):
        return None
    return [coefficients[name] for name in model.coefficients]


_STRAIGHT = BrownConrady(k1=0.0, k2=0.0, p1=0.0, p2=0.0)


def _plainest(lens: Distortion) -> Distortion:
    """The simplest of OpenCV's perspective models that has all non-zero terms of the lens."""
    if isinstance(lens, Rational) and not (lens.k4 or lens.k5 or lens.k6):
        lens = BrownConrady(k1=lens.k1, k2=lens.k2, p1=lens.p1, p2=lens.p2, k3=lens.k3)
    return NoDistortion() if lens == _STRAIGHT else lens
