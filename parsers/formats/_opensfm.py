"""What OpenSfM's and ODM's files share: cameras by name in a JSON object."""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from typing import TypeAlias

from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Quality
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

__all__ = [
    "MAX_CAMERAS",
    "NAME",
    "Named",
    "camera_names",
    "cameras",
    "fresh",
    "is_full_name",
    "plain_name",
    "written",
]

Named: TypeAlias = tuple[str, Node, int | None]
"""A camera's name, its object, and how many images it took."""

MAX_CAMERAS = 1_000_000
NAME = "opensfm/camera"
PREFIX = "opensfm/"
PROJECTION = "opensfm/projection_type"
PERSPECTIVE = "perspective"
"""What OpenSfM takes a camera for that says nothing."""


def camera_names(document: Json) -> tuple[str, ...]:
    """The names of the cameras of a bare JSON object of cameras, empty for every other document."""
    if not isinstance(document, dict) or not document:
        return ()
    if all(
        isinstance(item, dict) and isinstance(item.get("projection_type"), str) for item in document.values()
    ):
        return tuple(document)
    return ()


def is_full_name(name: str) -> bool:
    """Whether it is a name as OpenSfM makes them: make, model, width, height, projection and focal length."""
    return len(name.split(" ")) >= 6


def plain_name(name: str) -> str:
    """Without the mark of the second version, which OpenSfM puts before its names and ODM takes off."""
    return name.removeprefix("v2 ")


def fresh(name: str, taken: Container[str]) -> str:
    """The name, or where it is taken, the name with a number."""
    number, candidate = 2, name
    while candidate in taken:
        candidate, number = f"{name} #{number}", number + 1
    return candidate


def cameras(found: Sequence[Named], context: ReadContext, *, adjusted: bool) -> list[Calibration]:
    """Every camera that has a K, in order; the others are named in a note.

    Args:
        found: the cameras.
        context: of the file.
        adjusted: whether the file is the result of an adjustment, and not also what one starts from.

    Raises:
        ParseError: there are too many, or one is broken.
        UnsupportedModelError: none has a K.
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
    """A camera's object, what was not understood included."""
    kept = dict(calibration.extras)
    camera: dict[str, Writable] = dict(opensfm_camera(calibration, kept.get(PROJECTION)))
    for key, text in kept.items():
        name = key.removeprefix(PREFIX)
        if key.startswith(PREFIX) and key not in {NAME, PROJECTION} and name not in camera:
            camera[name] = restored(text)
    return camera


def _projection(node: Node) -> ProjectionType | str:
    """The camera's type, or the name of one that has no counterpart."""
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
    size = context.size(_size(node))
    numbers = {key: node[key].number() for key in projection.needed}
    numbers |= {key: node[key].number() for key in projection.keys[3:] if key in node}
    intrinsics, distortion = calibrated(projection, numbers, size, source=context.name)
    plain = plain_name(name)
    calibration = Calibration(
        camera=CameraKey(image_size=size, sub_camera=plain if several else None),
        intrinsics=intrinsics,
        distortion=distortion,
        grade=Grade.ADJUSTED,
        quality=Quality(views=views) if views else None,
        provenance=context.provenance(tag=name),
        notes=(*notes, *_ignored(node, projection)),
    )
    if not adjusted and _is_untouched(plain, projection, numbers):
        note = "these are the numbers OpenSfM starts from, a focal length out of EXIF and nothing else"
        calibration = replace(calibration, grade=Grade.PRIOR, notes=(*calibration.notes, note))
    return replace(calibration, extras=tuple(_extras(calibration, plain, node, projection, several=several)))


def _size(node: Node) -> ImageSize | None:
    """None where the camera does not say it, or says 0, which OpenSfM means by not saying it."""
    if not any(key in node and node[key].value for key in ("width", "height")):
        return None
    return node.image_size("width", "height")


def _is_untouched(name: str, projection: ProjectionType, numbers: dict[str, float]) -> bool:
    """Whether nothing is known but the focal length that the name ends in."""
    focals = {numbers[key] for key in projection.needed}
    rest = any(value for key, value in numbers.items() if key not in projection.needed)
    return not rest and len(focals) == 1 and str(focals.pop())[:6] == name.rsplit(" ", maxsplit=1)[-1]


def _ignored(node: Node, projection: ProjectionType) -> Iterator[str]:
    """Numbers that mean something in another type, where they are not zero."""
    meaningful = {key for item in PROJECTIONS for key in item.keys[3:]} - set(projection.keys) - {"focal"}
    given = [key for key in sorted(meaningful) if key in node and node[key].value]
    if given:
        yield f"OpenSfM does not look at {', '.join(given)} of a {projection.name} camera, nor was it read"


def _extras(
    calibration: Calibration, name: str, node: Node, projection: ProjectionType, *, several: bool
) -> Iterator[tuple[str, str]]:
    if not several:
        yield NAME, name
    if opensfm_camera(calibration)["projection_type"] != projection.name:
        yield PROJECTION, projection.name
    for key, value in node.entries():
        text = extra(value.value) if key not in projection.keys else None
        if text is not None:
            yield PREFIX + key, text
