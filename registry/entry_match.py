"""Matching of an entry with a camera: whether it applies, at which image size, and how specific it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from datetime import date
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey, Provenance, SourceFile
from calibrary.errors import InputError
from calibrary.evidence.frame import Adapted, adapt
from calibrary.evidence.metadata import ImageMetadata
from calibrary.image_size import same_aspect
from calibrary.known_camera import match_key, normalise_sub_camera
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status, noted
from calibrary.registry.paths import is_proposal

__all__ = ["FOCAL_TOLERANCE", "ONLY_PROPOSED", "EntryMatch", "match_entry"]

FOCAL_TOLERANCE: Final = 0.02
"""Cameras round the focal length that they write, and zoom lenses do not stop exactly at the same position."""

ONLY_PROPOSED: Final = "it is only a proposal, which nothing uses before it is approved"

Rank = tuple[float, ...]


class EntryMatch(Struct, frozen=True, kw_only=True):
    """An entry that applies to a camera.

    Attributes:
        path: path of the entry.
        entry: the entry, as in its file.
        adapted: its K at the camera's image size.
        states: properties of the camera that it states and another entry might not.
        alias: whether the camera has another name in this entry.
        rank: sort key, the most specific first.
    """

    path: str
    entry: Entry
    adapted: Adapted
    states: tuple[str, ...]
    alias: bool
    rank: Rank

    def calibration(self, key: CameraKey) -> Calibration:
        """Return the entry's calibration for the camera; the provenance is the entry and its source."""
        calibration, adapted = noted(self.entry), self.adapted
        quality, (width, height) = calibration.quality, adapted.reference_size
        size = adapted.intrinsics.image_size
        if quality is not None and adapted.steps and same_aspect((width, height), size):
            quality = quality.scaled(size[0] / width, size[1] / height)
        return replace(
            calibration,
            camera=replace(key, image_size=size),
            intrinsics=adapted.intrinsics,
            quality=quality,
            provenance=_behind(self.path, calibration.provenance, adapted),
        )


def match_entry(
    path: str, entry: Entry, key: CameraKey, on: date | None, statuses: Collection[Status]
) -> EntryMatch | str | None:
    """Match an entry with a camera; return the reason if it does not apply, None for another make or model.

    A field that the entry does not state matches every camera. A stated field must be known of the camera and equal,
    except for the focal length: an unknown one is accepted.
    """
    if not _is_of(entry, key):
        return None
    for rule in _RULES:
        if (reason := rule(entry, key)) is not None:
            return reason
    if entry.status not in statuses:
        if is_proposal(path):
            return ONLY_PROPOSED
        return f"it is {entry.status.value}" + (f": {entry.reason}" if entry.reason else "")
    if on is not None and entry.validity is not None and not entry.validity.holds(on):
        return f"it is valid {entry.validity}, not on {on}"
    K = entry.calibration.intrinsics
    try:
        adapted = adapt(K, ImageMetadata(size=key.image_size or K.image_size))
    except InputError as error:
        return error.message
    return EntryMatch(
        path=path,
        entry=entry,
        adapted=adapted,
        states=_states(entry),
        alias=not _same(entry.calibration.camera.model, key.model)
        or not _same(entry.calibration.camera.make, key.make),
        rank=_rank(entry, key),
    )


def _is_of(entry: Entry, key: CameraKey) -> bool:
    camera = entry.calibration.camera
    names = [(camera.make, camera.model), *((alias.make, alias.model) for alias in entry.aliases)]
    return any(_same(make, key.make) and _same(model, key.model) for make, model in names)


def _unit(entry: Entry, key: CameraKey) -> str | None:
    serial = entry.calibration.camera.serial
    if serial is None or _same(serial, key.serial):
        return None
    return "it is of one unit, and the camera's serial number is " + (
        "not known" if key.serial is None else "another"
    )


def _firmware(entry: Entry, key: CameraKey) -> str | None:
    if entry.firmware is None:
        return None
    if key.firmware is None:
        return f"it is of {entry.firmware}, and the camera's is not known"
    try:
        holds = entry.firmware.holds(key.firmware)
    except InputError as error:
        return error.message
    return None if holds else f"it is of {entry.firmware}, not {key.firmware}"


def _focal(entry: Entry, key: CameraKey) -> str | None:
    stated, seen = entry.calibration.camera.focal_mm, key.focal_mm
    if stated is None or seen is None or abs(seen / stated - 1.0) <= FOCAL_TOLERANCE:
        return None
    return f"it is of {stated:g} mm, not {seen:g} mm"


def _sub_camera(entry: Entry, key: CameraKey) -> str | None:
    stated, seen = entry.calibration.camera.sub_camera, key.sub_camera
    if stated is None or (seen is not None and _sub_camera_key(stated) == _sub_camera_key(seen)):
        return None
    return f"it is of the {stated} camera" + (
        ", and the image's sub-camera is not known" if seen is None else ""
    )


def _lens(entry: Entry, key: CameraKey) -> str | None:
    stated = entry.calibration.camera.lens
    if stated is None or _same(stated, key.lens):
        return None
    return f"it is of the lens {stated}" + (", and the lens is not known" if key.lens is None else "")


def _mode(entry: Entry, key: CameraKey) -> str | None:
    # An image processed by the camera (dewarped, zoomed) is of another camera unless the entry states the same mode.
    stated, seen = entry.calibration.camera.capture_mode, key.capture_mode
    if stated is None and seen is None:
        return None
    if stated is not None and _same(stated, seen):
        return None
    return (
        f"it is of images without a capture mode, not {seen}"
        if stated is None
        else f"it is of {stated} images"
    )


_RULES: Final[tuple[Callable[[Entry, CameraKey], str | None], ...]] = (
    _unit,
    _firmware,
    _lens,
    _focal,
    _sub_camera,
    _mode,
)


def _rank(entry: Entry, key: CameraKey) -> Rank:
    """Return the rank: serial, firmware, lens, focal length, sub-camera; then similarity of size, then focal length."""
    camera = entry.calibration.camera
    compared = camera.focal_mm is not None and key.focal_mm is not None
    stated = (
        camera.serial is not None,
        entry.firmware is not None,
        camera.lens is not None,
        compared,
        camera.sub_camera is not None,
    )
    apart = (
        abs(math.log(key.focal_mm / camera.focal_mm))
        if compared and key.focal_mm and camera.focal_mm
        else 0.0
    )
    return (
        *(not is_stated for is_stated in stated),
        *_frame_rank(camera, key),
        camera.focal_mm is not None,
        apart,
    )


def _frame_rank(camera: CameraKey, key: CameraKey) -> tuple[float, float]:
    """Return the rank of the image size: the same, resized (the less the better), then a crop."""
    if camera.image_size is None or key.image_size is None or camera.image_size == key.image_size:
        return 0, 0.0
    scale = abs(math.log(key.image_size[0] / camera.image_size[0]))
    return (1, scale) if same_aspect(camera.image_size, key.image_size) else (2, scale)


def _states(entry: Entry) -> tuple[str, ...]:
    camera = entry.calibration.camera
    said = (
        "this unit" if camera.serial is not None else None,
        str(entry.firmware) if entry.firmware is not None else None,
        f"the lens {camera.lens}" if camera.lens is not None else None,
        f"{camera.focal_mm:g} mm" if camera.focal_mm is not None else None,
        f"the {camera.sub_camera} camera" if camera.sub_camera is not None else None,
        f"{camera.capture_mode} frames" if camera.capture_mode is not None else None,
    )
    return tuple(text for text in said if text is not None)


def _behind(path: str, made: Provenance, adapted: Adapted) -> Provenance:
    """Return the provenance: the entry, with what it states about its own origin."""
    files = made.sources
    if not files and made.source is not None and made.sha256 is not None:
        files = (SourceFile(name=made.source, sha256=made.sha256),)
    stated = (made.kind, made.source, made.tag)
    return replace(
        made,
        kind="registry",
        source=path,
        tag=" ".join(text for text in stated if text is not None),
        reference_size=adapted.reference_size,
        adaptation="; ".join(text for text in (made.adaptation, *adapted.steps) if text) or None,
        assumptions=(*made.assumptions, *adapted.assumptions),
        sha256=None,
        sources=files,
    )


def _same(stated: str | None, seen: str | None) -> bool:
    return stated is not None and seen is not None and match_key(stated) == match_key(seen)


def _sub_camera_key(text: str) -> str:
    return normalise_sub_camera(text) or match_key(text)
