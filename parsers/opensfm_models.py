"""OpenSfM's and ODM's projection types: what each contains, and how a calibration becomes one and back.

OpenSfM counts in units of the image's longer side from the middle of the image. Some of its types have one focal
length, ``focal``, and the principal point in the middle; the others ``focal_x``, ``focal_y``, ``c_x`` and ``c_y``.
A coefficient that is left out is zero.

Half a pixel: OpenSfM's features count from (W − 1)/2 between the centres of pixels, which is the middle of the
image. Its ``get_K_in_pixel_coordinates`` adds W/2 to the same number, which is half a pixel off.

Sources: OpenSfM, ``opensfm/io.py``, ``features.py`` and ``camera_distortions_functions.h``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, ImageSize, Intrinsics
from calibrary.conventions import Origin
from calibrary.distortion import BrownConrady, Distortion, Fisheye624, KannalaBrandt, NoDistortion
from calibrary.distortion.equivalence import exact
from calibrary.errors import UnsupportedModelError
from calibrary.parsers.convention import Convention, Native, Unit

__all__ = ["CONVENTION", "PROJECTIONS", "ProjectionType", "calibrated", "opensfm_camera", "projection_named"]


class ProjectionType(Struct, frozen=True):
    """One of OpenSfM's projection types that has a K.

    Attributes:
        name: as files have it.
        focals: how many focal lengths it has; with 2, the principal point may leave the middle too.
        lens: the model here.
        coefficients: those of ``lens`` that it has, under their own names; the rest are zero.
    """

    name: str
    focals: int
    lens: type[Distortion]
    coefficients: tuple[str, ...]

    @property
    def needed(self) -> tuple[str, ...]:
        """The keys that no camera of the type can be without."""
        return ("focal_x", "focal_y") if self.focals == 2 else ("focal",)

    @property
    def keys(self) -> tuple[str, ...]:
        """All keys that OpenSfM looks at."""
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
    """The type of that name, None when it has no K or is not known."""
    return _BY_NAME.get(name)


def calibrated(
    projection: ProjectionType, numbers: Mapping[str, float], size: ImageSize, *, source: str | None = None
) -> tuple[Intrinsics, Distortion]:
    """K and the lens from OpenSfM's numbers.

    Args:
        projection: the type of the camera.
        numbers: those of the type's keys that the file has, all that are needed among them.
        size: (width, height) px.
        source: the file's name, for messages.

    Raises:
        InputError: they make no K.
    """
    fx, fy = (numbers[projection.needed[index]] for index in (0, -1))
    native = Native(fx=fx, fy=fy, cx=numbers.get("c_x", 0.0), cy=numbers.get("c_y", 0.0))
    given = {name: numbers.get(name, 0.0) for name in projection.coefficients}
    lens = projection.lens(**{name: given.get(name, 0.0) for name in projection.lens.names()})
    straight = isinstance(lens, BrownConrady) and not any(lens.coefficients.values())
    return CONVENTION.intrinsics(native, size, source=source), NoDistortion() if straight else lens


def opensfm_camera(calibration: Calibration, projection: str | None = None) -> dict[str, str | int | float]:
    """A camera as OpenSfM's files have it.

    Args:
        calibration: with an unknown lens it becomes one without distortion.
        projection: the type to use if it contains the calibration exactly.

    Raises:
        UnsupportedModelError: OpenSfM has no type that is exactly this.
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
        coefficients = _held(lens, candidate)
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
    """One focal length, and the principal point in the middle."""
    width, height = K.image_size
    return K.fx == K.fy and (K.cx, K.cy) == (width / 2, height / 2)


def _held(lens: Distortion, projection: ProjectionType) -> dict[str, float] | None:
    """The coefficients of the same lens in a type, None when it lacks one that is at work."""
    same = exact(lens, projection.lens)
    if same is None:
        return None
    coefficients = same.coefficients
    if any(value for name, value in coefficients.items() if name not in projection.coefficients):
        return None
    return {name: coefficients[name] for name in projection.coefficients}
