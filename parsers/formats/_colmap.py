"""What COLMAP's text file, binary file and database share: a list of cameras by number."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize
from calibrary.distortion import Distortion, FieldOfView
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.parsers.colmap_models import ColmapModel, calibrated, colmap_camera
from calibrary.parsers.format import ReadContext
from calibrary.records import replace

__all__ = ["MAX_CAMERAS", "ColmapCamera", "cameras", "records"]

MAX_CAMERAS = 20_000
"""A camera for every image of a large collection, read in a second or two."""

CAMERA_ID = "colmap/camera_id"
MODEL = "colmap/model"
SERIES_BELOW = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class ColmapCamera:
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


def cameras(found: Sequence[ColmapCamera], context: ReadContext, *, grade: Grade) -> list[Calibration]:
    """Every camera that has a K, in order; the others are named in a note.

    Raises:
        ParseError: two share an id, or the numbers of one make no camera.
        UnsupportedModelError: none has a K.
    """
    twice = _repeated(camera.number for camera in found)
    if twice is not None:
        raise ParseError(f"there are two cameras {twice}", source=context.name)
    without = [f"camera {item.number} is {item.model}" for item in found if isinstance(item.model, str)]
    if without and len(without) == len(found):
        raise UnsupportedModelError(
            f"{without[0]}, which has no K; cut perspective views from its images", source=context.name
        )
    left_out = (f"left out, for want of a K: {', '.join(without[:20])}",) if without else ()
    several = len(found) > 1
    return [
        _calibration(item, item.model, context, several=several, grade=grade, notes=left_out)
        for item in found
        if not isinstance(item.model, str)
    ]


def records(calibrations: Sequence[Calibration]) -> Iterator[tuple[int, str, ImageSize, list[float]]]:
    """Id, model name, image size and parameters of each; ids that came from COLMAP stay if no two are alike."""
    kept = [dict(item.extras).get(CAMERA_ID) or item.camera.sub_camera or "" for item in calibrations]
    keep = all(text.isdecimal() and int(text) < 1 << 32 for text in kept) and len(set(kept)) == len(kept)
    for index, item in enumerate(calibrations):
        name, parameters = colmap_camera(item, dict(item.extras).get(MODEL))
        yield int(kept[index]) if keep else index + 1, name, item.intrinsics.image_size, parameters


def _calibration(
    item: ColmapCamera,
    model: ColmapModel,
    context: ReadContext,
    *,
    several: bool,
    grade: Grade,
    notes: tuple[str, ...],
) -> Calibration:
    size = context.size(item.image_size)
    try:
        intrinsics, distortion = calibrated(model, item.parameters, size)
    except InputError as error:
        raise ParseError(error.message, source=context.name, place=item.place) from None
    calibration = Calibration(
        camera=CameraKey(image_size=size, sub_camera=str(item.number) if several else None),
        intrinsics=intrinsics,
        distortion=distortion,
        grade=grade,
        provenance=context.provenance(tag=f"camera {item.number}"),
        notes=(*notes, *_series(distortion)),
    )
    extras = ((CAMERA_ID, str(item.number)),) if not several and item.number != 1 else ()
    if colmap_camera(calibration)[0] != model.name:
        extras = (*extras, (MODEL, model.name))
    return replace(calibration, extras=extras)


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
