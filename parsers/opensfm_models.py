"""Projection types of OpenSfM and ODM: their parameters, and conversion from and to calibrations.

OpenSfM's unit is the image's longer side, its origin the image centre. Some of its types have one focal length,
``focal``, and the principal point in the centre; the others have ``focal_x``, ``focal_y``, ``c_x`` and
``c_y``. A missing coefficient is zero.

Half a pixel: the origin of OpenSfM's features is (W − 1)/2, counted between pixel centres, which is the image
centre. Its ``get_K_in_pixel_coordinates`` adds W/2 to the same number, which is wrong by half a pixel.

Sources: OpenSfM, ``opensfm/io.py``, ``features.py`` and ``camera_distortions_functions.h``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, ImageSize, Intrinsics, Origin
from calibrary.distortion import BrownConrady, Distortion, Fisheye624, KannalaBrandt, NoDistortion, exact
from calibrary.errors import UnsupportedModelError
from calibrary.parsers.convention import Convention, Native, Unit


class ProjectionType(Struct, frozen=True):
    """An OpenSfM projection type that has a K.

    Attributes:
        name: in files.
        focals: number of focal lengths; with 2, it also has a principal point.
        lens: the equivalent lens model of calibrary.
        coefficients: names of the coefficients of ``lens`` that it has; all others are zero.
    """

    name: str
    focals: int
    lens: type[Distortion]
    coefficients: tuple[str, ...]

    @property
    def needed(self) -> tuple[str, ...]:
        """The required keys of a camera."""
        return ("focal_x", "focal_y") if self.focals == 2 else ("focal",)

    @property
    def keys(self) -> tuple[str, ...]:
        """All keys that OpenSfM reads."""
        place = ("c_x", "c_y") if self.focals == 2 else ()
        return ("projection_type", "width", "height", *self.needed, *place, *self.coefficients)


PROJECTIONS: Final = (
    ProjectionType("perspective", 1, BrownConrady, ("k1", "k2")),
    ProjectionType("simple_radial", 2, BrownConrady, ("k1",)),
    ProjectionType("radial", 2, BrownConrady, ("k1", "k2")),
    ProjectionType("brown", 2, BrownConrady, ("k1", "k2", "p1", "p2", "k3")),
    ProjectionType("fisheye", 1, KannalaBrandt, ("k1", "k2")),
    ProjectionType("fisheye_opencv", 2, KannalaBrandt, ("k1", "k2", "k3", "k4")),
    ProjectionType("fisheye62", 2, Fisheye624, Fisheye624.names()[:8]),
    ProjectionType("fisheye624", 2, Fisheye624, Fisheye624.names()),
)
_WRITTEN = ("brown", "fisheye_opencv", "fisheye62", "fisheye624")
_BY_NAME = {item.name: item for item in PROJECTIONS}

CONVENTION: Final = Convention(
    unit=Unit.LONGER_SIDE,
    origin=Origin.IMAGE_CENTRE,
    remarks=(
        "every number is named, and a missing one is zero",
        "perspective and fisheye have one focal length and the principal point in the middle",
    ),
)


def projection_named(name: str) -> ProjectionType | None:
    """The type with this name; None if it has no K or is unknown."""
    return _BY_NAME.get(name)


def calibrated(
    projection: ProjectionType, numbers: Mapping[str, float], size: ImageSize, *, source: str | None = None
) -> tuple[Intrinsics, Distortion]:
    """Convert OpenSfM's numbers to K and a lens.

    Args:
        projection: the type of the camera.
        numbers: values by key, with all required keys.
        size: (width, height) px.
        source: file name, for messages.

    Raises:
        InputError: the numbers are not a valid K.
    """
    fx, fy = (numbers[projection.needed[index]] for index in (0, -1))
    native = Native(fx=fx, fy=fy, cx=numbers.get("c_x", 0.0), cy=numbers.get("c_y", 0.0))
    given = {name: numbers.get(name, 0.0) for name in projection.coefficients}
    lens = projection.lens(**{name: given.get(name, 0.0) for name in projection.lens.names()})
    straight = isinstance(lens, BrownConrady) and not any(lens.coefficients.values())
    return CONVENTION.intrinsics(native, size, source=source), NoDistortion() if straight else lens


def opensfm_camera(calibration: Calibration, projection: str | None = None) -> dict[str, str | int | float]:
    """Convert a calibration to a camera in OpenSfM's files.

    Args:
        calibration: an unknown lens is written as one without distortion.
        projection: the type to use if it represents the calibration exactly.

    Raises:
        UnsupportedModelError: no OpenSfM type represents the calibration exactly.
    """
    K, lens = calibration.intrinsics, calibration.distortion or NoDistortion()
    if K.skew:
        raise UnsupportedModelError(f"OpenSfM's models have no skew, this K has {K.skew:g} px")
    candidates = [_BY_NAME[name] for name in _WRITTEN]
    if projection in _BY_NAME:
        candidates.insert(0, _BY_NAME[projection])
    native = CONVENTION.native(K)
    width, height = K.image_size
    for candidate in candidates:
        coefficients = _coefficients_in(lens, candidate)
        if coefficients is None or not (candidate.focals == 2 or _is_plain(K)):
            continue
        numbers = {"focal_x": native.fx, "focal_y": native.fy, "c_x": native.cx, "c_y": native.cy}
        return {
            "projection_type": candidate.name,
            "width": width,
            "height": height,
            **(numbers if candidate.focals == 2 else {"focal": native.fx}),
            **coefficients,
        }
    raise UnsupportedModelError(f"OpenSfM has no model that is exactly {lens.model!r}")


def _is_plain(K: Intrinsics) -> bool:
    """Whether K has a single focal length and the principal point in the image centre."""
    width, height = K.image_size
    return K.fx == K.fy and (K.cx, K.cy) == (width / 2, height / 2)


def _coefficients_in(lens: Distortion, projection: ProjectionType) -> dict[str, float] | None:
    """The coefficients of the lens in a type; None if the type lacks one that is not zero."""
    same = exact(lens, projection.lens)
    if same is None:
        return None
    coefficients = same.coefficients
    if any(value for name, value in coefficients.items() if name not in projection.coefficients):
        return None
    return {name: coefficients[name] for name in projection.coefficients}
