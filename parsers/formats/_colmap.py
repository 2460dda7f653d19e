"""What COLMAP's text file, binary file and database share: how they count, and a list of cameras by number."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics
from calibrary.conventions import Origin
from calibrary.distortion import (
    Distortion,
    FieldOfView,
)
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.interop.colmap import COLMAP_LENSES, ColmapCamera, ColmapModel, default_model, lens_from
from calibrary.parsers.convention import Convention
from calibrary.parsers.format import Capacity, ReadContext
from calibrary.records import replace

__all__ = ["CAPACITY", "CONVENTION", "MAX_CAMERAS", "StoredCamera", "cameras", "records"]

CONVENTION: Final = Convention(
    origin=Origin.CORNER,
    remarks=(
        "one or two focal lengths, the principal point, and then the coefficients, as the camera's model has them",
        "RAD_TAN_THIN_PRISM_FISHEYE has p0 and p1 the other way round than OpenCV",
    ),
)
CAPACITY: Final = Capacity(models=COLMAP_LENSES, several_cameras=True)

MAX_CAMERAS = 1_000_000
"""A camera for every image of the largest collections; each takes some 30 µs and 2 kB."""

CAMERA_ID = "colmap/camera_id"
MODEL = "colmap/model"
SERIES_BELOW = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredCamera:
    """One camera as COLMAP stores it.

    Attributes:
        number: its id.
        model: its model, or the name of one that has no K.
        image_size: (width, height) px.
        parameters: in COLMAP's order.
        place: where it stands, for messages.
    """

    number: int
    model: ColmapModel | str
    image_size: ImageSize
    parameters: tuple[float, ...]
    place: str


def cameras(found: Sequence[StoredCamera], context: ReadContext, *, grade: Grade) -> list[Calibration]:
    """Every camera that has a K, in order; the others are named in a note.

    Raises:
        ParseError: two share an id, or the numbers of one make no camera.
        UnsupportedModelError: none has a K.
    """
    twice = _repeated(camera.number for camera in found)
    if twice is not None:
        raise ParseError(f"there are two cameras {twice}")
    without = [f"camera {item.number} is {item.model}" for item in found if isinstance(item.model, str)]
    if without and len(without) == len(found):
        raise UnsupportedModelError(f"{without[0]}, which has no K; cut perspective views from its images")
    left_out = (f"left out, for want of a K: {', '.join(without[:20])}",) if without else ()
    several = len(found) > 1
    return [
        _calibration(item, item.model, context, several=several, grade=grade, notes=left_out)
        for item in found
        if not isinstance(item.model, str)
    ]


def records(calibrations: Sequence[Calibration]) -> Iterator[tuple[int, ColmapCamera]]:
    """Each with its id; ids that came from COLMAP stay if no two are alike."""
    kept = [dict(item.extras).get(CAMERA_ID) or item.camera.sub_camera or "" for item in calibrations]
    keep = all(text.isdecimal() and int(text) < 1 << 32 for text in kept) and len(set(kept)) == len(kept)
    for index, item in enumerate(calibrations):
        yield int(kept[index]) if keep else index + 1, item.to_colmap(dict(item.extras).get(MODEL))


def _calibration(
    item: StoredCamera,
    model: ColmapModel,
    context: ReadContext,
    *,
    several: bool,
    grade: Grade,
    notes: tuple[str, ...],
) -> Calibration:
    size = context.size(item.image_size)
    try:
        intrinsics, distortion = _k_and_lens(model, item.parameters, size)
    except InputError as error:
        raise ParseError(error.message, place=item.place) from None
    calibration = Calibration(
        camera=CameraKey(image_size=size, sub_camera=str(item.number) if several else None),
        intrinsics=intrinsics,
        distortion=distortion,
        grade=grade,
        provenance=context.provenance(tag=f"camera {item.number}"),
        notes=(*notes, *_series(distortion)),
    )
    extras = ((CAMERA_ID, str(item.number)),) if not several and item.number != 1 else ()
    if default_model(type(distortion)) is not model and calibration.to_colmap().model != model.name:
        extras = (*extras, (MODEL, model.name))
    return replace(calibration, extras=extras)


def _k_and_lens(
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
        raise InputError(f"{model.name} with {len(parameters)} parameters, expected {model.count}")
    fx, fy = parameters[0], parameters[model.focals - 1]
    cx, cy = parameters[model.focals : model.focals + 2]
    intrinsics = Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, image_size=size)
    return intrinsics, lens_from(model, parameters[model.focals + 2 :])


def _series(distortion: Distortion) -> tuple[str, ...]:
    """COLMAP's FOV model is another function for tiny angles, up to a tenth of a pixel away."""
    if isinstance(distortion, FieldOfView) and 0 < abs(distortion.omega) < SERIES_BELOW:
        return (
            "COLMAP evaluates FOV by a series below |omega| = 0.01, which is off by up to 0.1 px; this is not",
        )
    return ()


def _repeated(numbers: Iterator[int]) -> int | None:
    seen: set[int] = set()
    for number in numbers:
        if number in seen:
            return number
        seen.add(number)
    return None
