"""COLMAP's camera models: what each holds, and how a calibration becomes one and back.

COLMAP counts pixels from the outer corner of the top-left one, as calibrary does, and has no skew. Each of its
models is a K with one or two focal lengths and the first coefficients of a lens; which ones, in COLMAP's
order, is the table below.

Sources: COLMAP, ``src/colmap/sensor/models.h`` and its documentation, "Camera Models".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from calibrary.calibration import Calibration, ImageSize, Intrinsics
from calibrary.conventions import Origin
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
)
from calibrary.errors import InputError, UnsupportedModelError
from calibrary.parsers.convention import Convention
from calibrary.parsers.fit import exact
from calibrary.parsers.format import Capacity

__all__ = [
    "CAPACITY",
    "COLMAP_MODELS",
    "CONVENTION",
    "PANORAMAS",
    "ColmapModel",
    "calibrated",
    "colmap_camera",
    "model_named",
    "model_numbered",
]


@dataclass(frozen=True, slots=True)
class ColmapModel:
    """One of COLMAP's models that has a K.

    Attributes:
        number: as ``cameras.bin`` and the database have it.
        name: as ``cameras.txt`` has it.
        focals: how many focal lengths stand before the principal point, 1 or 2.
        lens: the model here.
        coefficients: those of ``lens`` that follow the principal point, in COLMAP's order; the rest are zero.
    """

    number: int
    name: str
    focals: int
    lens: type[Distortion]
    coefficients: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """How many parameters it has."""
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
"""Models without a K by their number: name and how many parameters."""

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
"""Two focal lengths each, so that bundle adjustment may part them; those that old COLMAPs know come first."""

_BY_NAME = {model.name: model for model in COLMAP_MODELS}
_BY_NUMBER = {model.number: model for model in COLMAP_MODELS}

CONVENTION: Final = Convention(
    origin=Origin.CORNER,
    remarks=(
        "one or two focal lengths, the principal point, and then the coefficients, as the camera's model has them",
        "RAD_TAN_THIN_PRISM_FISHEYE has p0 and p1 the other way round than OpenCV",
    ),
)
CAPACITY: Final = Capacity(
    models=(
        NoDistortion,
        BrownConrady,
        Rational,
        KannalaBrandt,
        ExtendedUnified,
        FieldOfView,
        Division,
        ThinPrismFisheye,
        RadTanThinPrismFisheye,
    ),
    several_cameras=True,
)


def model_named(name: str) -> ColmapModel | None:
    """The model of that name, None when COLMAP has none with a K."""
    return _BY_NAME.get(name)


def model_numbered(number: int) -> ColmapModel | None:
    """The model of that number, None when COLMAP has none with a K."""
    return _BY_NUMBER.get(number)


def calibrated(
    model: ColmapModel, parameters: Sequence[float], size: ImageSize
) -> tuple[Intrinsics, Distortion]:
    """K and the lens from COLMAP's parameters.

    Args:
        model: what they are parameters of.
        parameters: finite numbers, as many as the model has, in COLMAP's order.
        size: (width, height) px.

    Raises:
        InputError: there are too many or too few, or they make no K or no lens.
    """
    if len(parameters) != model.count:
        raise InputError(f"{model.name} with {len(parameters)} parameters, wanted {model.count}")
    fx, fy = parameters[0], parameters[model.focals - 1]
    cx, cy = parameters[model.focals : model.focals + 2]
    intrinsics = Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, image_size=size)
    given = dict(zip(model.coefficients, parameters[model.focals + 2 :], strict=True))
    return intrinsics, _plainest(model.lens(**{name: given.get(name, 0.0) for name in model.lens.names()}))


def colmap_camera(calibration: Calibration, model: str | None = None) -> tuple[str, list[float]]:
    """COLMAP's model name and parameters, in COLMAP's order.

    Args:
        calibration: with an unknown lens it becomes a pinhole.
        model: the model to use if it holds the calibration exactly.

    Raises:
        UnsupportedModelError: COLMAP has no model that is exactly this.
    """
    K, lens = calibration.intrinsics, calibration.distortion or NoDistortion()
    if K.skew:
        raise UnsupportedModelError(f"COLMAP's models have no skew, this K has {K.skew:g} px")
    written = [_BY_NAME[name] for name in _WRITTEN]
    # A lens that merely happens to be straight stays a lens: bundle adjustment may bend it.
    candidates = [item for item in written if item.lens is type(lens)] + written
    if model in _BY_NAME:
        candidates.insert(0, _BY_NAME[model])
    for candidate in candidates:
        coefficients = _held(lens, candidate)
        if coefficients is not None and (candidate.focals == 2 or K.fx == K.fy):
            return candidate.name, [*(K.fx, K.fy)[: candidate.focals], K.cx, K.cy, *coefficients]
    raise UnsupportedModelError(f"COLMAP has no model that is exactly {lens.model!r}")


def _held(lens: Distortion, model: ColmapModel) -> list[float] | None:
    """The coefficients of the same lens in a model, None when it lacks one that is at work."""
    same = lens if type(lens) is model.lens else exact(lens, model.lens)
    if same is None:
        return None
    coefficients = same.coefficients
    if any(value for name, value in coefficients.items() if name not in model.coefficients):
        return None
    return [coefficients[name] for name in model.coefficients]


def _plainest(lens: Distortion) -> Distortion:
    """Without the terms of OpenCV's perspective models that are not at work."""
    if isinstance(lens, Rational) and not (lens.k4 or lens.k5 or lens.k6):
        lens = BrownConrady(k1=lens.k1, k2=lens.k2, p1=lens.p1, p2=lens.p2, k3=lens.k3)
    straight = isinstance(lens, BrownConrady) and not any(lens.coefficients.values())
    return NoDistortion() if straight else lens
