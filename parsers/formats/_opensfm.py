"""Shared by the files of OpenSfM and ODM: cameras by name in a JSON object."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from typing import TypeAlias

from calibrary.calibration import Calibration, Grade, ImageSize, Quality
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.document import Node
from calibrary.parsers.format import ReadContext
from calibrary.parsers.formats._json_text import Writable, extra, restored
from calibrary.parsers.opensfm_models import (
    PROJECTIONS,
    ProjectionType,
    calibrated,
    opensfm_camera,
    projection_named,
)
from calibrary.records import Json, replace

Named: TypeAlias = tuple[str, Node, int | None]
"""A camera's name, its object, and the number of its images."""

MAX_CAMERAS = 1_000_000
NAME = "opensfm/camera"
PREFIX = "opensfm/"
PROJECTION = "opensfm/projection_type"
MEANINGFUL = frozenset(key for item in PROJECTIONS for key in item.keys[3:])
"""Keys of numbers, of any projection type."""
PERSPECTIVE = "perspective"
"""OpenSfM's default projection type."""


def camera_names(document: Json) -> tuple[str, ...]:
    """Names in a plain JSON object of cameras; empty for any other document."""
    if not isinstance(document, dict) or not document:
        return ()
    if all(
        isinstance(item, dict) and isinstance(item.get("projection_type"), str) for item in document.values()
    ):
        return tuple(document)
    return ()


def is_full_name(name: str) -> bool:
    """Whether it is a name made by OpenSfM: make, model, width, height, projection and focal length."""
    return len(name.split(" ")) >= 6


def plain_name(name: str) -> str:
    """The name without the prefix "v2 ", which OpenSfM adds and ODM removes."""
    return name.removeprefix("v2 ")


def fresh(name: str, taken: Container[str]) -> str:
    """The name, with a number appended if it is already in use."""
    number, candidate = 2, name
    while candidate in taken:
        candidate, number = f"{name} #{number}", number + 1
    return candidate


def cameras(found: Sequence[Named], context: ReadContext, *, adjusted: bool) -> list[Calibration]:
    """All cameras with a K, in order; a note names the others.

    Args:
        found: the cameras.
        context: of the file.
        adjusted: whether the file is always the result of an adjustment, never its input.

    Raises:
        ParseError: there are too many cameras, or one is broken.
        UnsupportedModelError: no camera has a K.
    """
    if len(found) > MAX_CAMERAS:
        raise ParseError(f"there are over {MAX_CAMERAS} cameras")
    kinds = [_projection(node) for _, node, _ in found]
    without = [
        f"{strict.shown(name)} is {kind}"
        for (name, _, _), kind in zip(found, kinds, strict=True)
        if isinstance(kind, str)
    ]
    if without and len(without) == len(found):
        raise UnsupportedModelError(
            f"camera {without[0]}, which has no counterpart here; expected one of "
            f"{', '.join(item.name for item in PROJECTIONS)}"
        )
    note = (f"left out, for want of a counterpart: {', '.join(without[:20])}",) if without else ()
    several = len(found) > 1
    return [
        _calibration(item, kind, context, several=several, adjusted=adjusted, notes=note)
        for item, kind in zip(found, kinds, strict=True)
        if isinstance(kind, ProjectionType)
    ]


def written(calibration: Calibration) -> dict[str, Writable]:
    """A camera's object, including unknown keys that were read."""
    kept = dict(calibration.extras)
    camera: dict[str, Writable] = dict(opensfm_camera(calibration, kept.get(PROJECTION)))
    for key, text in kept.items():
        name = key.removeprefix(PREFIX)
        if key.startswith(PREFIX) and key not in {NAME, PROJECTION} and name not in camera:
            camera[name] = restored(text)
    return camera


def _projection(node: Node) -> ProjectionType | str:
    """The projection type of a camera, or its name if it has no counterpart."""
    kind = node.get("projection_type")
    name = PERSPECTIVE if kind is None else kind.text()
    return projection_named(name) or name[:40]


def _calibration(
    item: Named,
    projection: ProjectionType,
    context: ReadContext,
    *,
    several: bool,
    adjusted: bool,
    notes: tuple[str, ...],
) -> Calibration:
    name, node, views = item
    stated = _size(node)
    if stated is None and context.image_size is None and "width" in node and node["width"].value == 0:
        raise ParseError(
            "width and height are 0, and its numbers are shares of the image's longer side; give --image-size WxH",
            place=name,
        )
    size = context.size(stated)
    numbers = {key: node[key].number() for key in projection.needed}
    numbers |= {key: node[key].number() for key in projection.keys[3:] if key in node}
    intrinsics, distortion = calibrated(projection, numbers, size, source=context.name)
    plain = plain_name(name)
    calibration = context.calibration(
        intrinsics,
        distortion,
        name=plain if several else None,
        tag=name,
        grade=Grade.ADJUSTED,
        quality=Quality(views=views) if views else None,
        notes=(*notes, *_ignored(node, projection)),
    )
    if not adjusted and _is_untouched(plain, projection, numbers):
        note = "these are the numbers OpenSfM starts from, a focal length out of EXIF and nothing else"
        calibration = replace(calibration, grade=Grade.PRIOR, notes=(*calibration.notes, note))
    return replace(calibration, extras=tuple(_extras(calibration, plain, node, projection, several=several)))


def _size(node: Node) -> ImageSize | None:
    """Image size; None if missing or 0, which OpenSfM writes for an unknown size."""
    if not any(key in node and node[key].value for key in ("width", "height")):
        return None
    return node.image_size("width", "height")


def _is_untouched(name: str, projection: ProjectionType, numbers: dict[str, float]) -> bool:
    """Whether the camera contains only the focal length at the end of its name."""
    focals = {numbers[key] for key in projection.needed}
    rest = any(value for key, value in numbers.items() if key not in projection.needed)
    return not rest and len(focals) == 1 and str(focals.pop())[:6] == name.rsplit(" ", maxsplit=1)[-1]


def _ignored(node: Node, projection: ProjectionType) -> Iterator[str]:
    """Yield non-zero numbers that only another projection type uses."""
    rest = sorted(set(node.keys()) - {*projection.keys, "focal"})
    given = [key for key in rest if key in MEANINGFUL and node[key].value]
    if given:
        yield f"OpenSfM does not look at {', '.join(given)} of a {projection.name} camera, nor was it read"


def _extras(
    calibration: Calibration, name: str, node: Node, projection: ProjectionType, *, several: bool
) -> Iterator[tuple[str, str]]:
    if not several:
        yield NAME, name
    if opensfm_camera(calibration)["projection_type"] != projection.name:
        yield PROJECTION, projection.name
    known = projection.keys
    for key, value in node.entries():
        if key not in known and (text := extra(value.value)) is not None:
            yield PREFIX + key, text
